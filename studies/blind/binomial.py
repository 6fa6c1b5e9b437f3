"""Exact binomial inference on the share of worlds that meet a criterion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from scipy.stats import binomtest

LEVEL = 0.05  # of the one-sided test


@dataclass(frozen=True)
class Bar:
    """A bound that a share should meet."""

    way: Literal["at least", "at most"]
    share: float

    def __str__(self) -> str:
        return f"{'≥' if self.way == 'at least' else '≤'} {100 * self.share:.3g} %"


def interval(hits: int, of: int) -> tuple[float, float]:
    """95 % interval of the share (Clopper and Pearson 1934); [0, 1] where nothing was counted."""
    if of == 0:
        return 0.0, 1.0
    found = binomtest(hits, of).proportion_ci(0.95, method="exact")
    return float(found.low), float(found.high)


def standing(hits: int, of: int, bar: Bar) -> Literal["meets", "undecided", "falls short"]:
    """How a counted share compares with its bar."""
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
