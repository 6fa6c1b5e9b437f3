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


def falls_short(hits: int, of: int, bar: Bar) -> bool:
    """Whether an exact one-sided test rejects at 5 % that the share meets its bar."""
    if of == 0:
        return False
    worse: Literal["less", "greater"] = "less" if bar.way == "at least" else "greater"
    return bool(binomtest(hits, of, bar.share, alternative=worse).pvalue < LEVEL)
