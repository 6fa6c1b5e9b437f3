"""Exact statements about a share of which only some were counted."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from scipy.stats import binomtest

LEVEL = 0.05


@dataclass(frozen=True)
class Bar:
    """What a share must be."""

    way: Literal["at least", "at most"]
    share: float

    def __str__(self) -> str:
        return f"{'≥' if self.way == 'at least' else '≤'} {100 * self.share:.3g} %"


def interval(hits: int, of: int) -> tuple[float, float]:
    """95 % of the share (Clopper and Pearson 1934); all of [0, 1] where nothing was counted."""
    if of == 0:
        return 0.0, 1.0
    found = binomtest(hits, of).proportion_ci(0.95, method="exact")
    return float(found.low), float(found.high)


def standing(hits: int, of: int, bar: Bar) -> str:
    """In a word or two, how a counted share stands to its bar."""
    if falls_short(hits, of, bar):
        return "falls short"
    share = hits / of if of else bar.share
    met = share >= bar.share if bar.way == "at least" else share <= bar.share
    return "meets" if met else "undecided"


def falls_short(hits: int, of: int, bar: Bar) -> bool:
    """Whether an exact one-sided test rejects at 5 % that the share meets its bar."""
    if of == 0:
        return False
    worse: Literal["less", "greater"] = "less" if bar.way == "at least" else "greater"
    return bool(binomtest(hits, of, bar.share, alternative=worse).pvalue < LEVEL)
