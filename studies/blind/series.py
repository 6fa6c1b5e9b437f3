"""The blind table's series of worlds, and the seeds that nobody can choose (docs/blind_tests.md)."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from studies.blind.worlds import Stratum

Second = Literal["more actions", "shuffled covariate", "doubled effect", "deleted candidate"]


@dataclass(frozen=True)
class Series:
    """Worlds of one kind. `second`: what is done to each for a second verdict."""

    name: str
    worlds: int
    stratum: Stratum
    q: float | None = None
    """Energy over the noise floor; None: drawn by each world's seed."""
    causes: Sequence[str] = ()
    """The hidden cause goes round these; empty: drawn by each world's seed."""
    second: Second | None = None
    shifted: bool = False
    """Whether the share of the gap that is closed is measured under a shifted context, too."""


WITH_A_COLUMN = ("ink_depletion", "tool_wear", "drying_shift", "wet_mixing")
"""Causes whose covariate is a column of the table, which can be shuffled."""

SERIES = (
    Series("one cause", 100, "one", shifted=True),
    Series("one faint cause", 60, "one", q=0.05),
    Series("two causes", 60, "two", shifted=True),
    Series("none", 150, "none"),
    Series("outside", 60, "outside"),
    Series("raster", 60, "raster", second="more actions"),
    Series("shuffled", 6, "one", q=0.4, causes=WITH_A_COLUMN, second="shuffled covariate"),
    Series("doubled", 6, "one", q=0.1, second="doubled effect"),
    Series("deleted", 6, "one", q=0.4, second="deleted candidate"),
)


def seed_of(commit: str, series: str, index: int) -> int:
    """A world's seed, 31 bits: it follows from the code's commit, so that no code can be tuned to it."""
    digest = hashlib.sha256(f"{commit} {series} {index}".encode()).digest()
    return int.from_bytes(digest[:4], "big") >> 1


def wanted(series: Series, share: float) -> int:
    """How many of its worlds make a `share` of the table: at least one."""
    return max(round(series.worlds * share), 1)
