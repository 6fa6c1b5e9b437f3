"""The benchmark's series of worlds and their seeds (docs/blind_tests.md)."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

Stratum = Literal["none", "one", "two", "outside", "raster"]
"""What a world hides: nothing, one cause, two causes, an effect outside the vocabulary, one cause in raster order."""
Second = Literal["more actions", "shuffled covariate", "doubled effect", "deleted candidate"]


@dataclass(frozen=True)
class Series:
    """Worlds of one stratum."""

    name: str
    worlds: int
    stratum: Stratum
    q: float | None = None
    """Effect energy over the noise floor; None: drawn by each world's seed."""
    causes: Sequence[str] = ()
    """The worlds hide these in turn; empty: drawn by each world's seed."""
    second: Second | None = None
    """The intervention before each world's second verdict."""
    shifted: bool = False
    """Whether the fraction of the gap closed is also measured out of distribution."""


COLUMNS: dict[str, tuple[str, ...]] = {
    "ink_depletion": ("since_reload", "reload_id", "ink_since_reload_m"),
    "tool_wear": ("order", "t_before_s", "t_start_s", "t_after_s", "tool_age_m", "surface_id"),
    "drying_shift": ("order", "t_before_s", "t_start_s", "t_after_s", "tool_age_m", "surface_id"),
    "wet_mixing": ("wet_age_s",),
    "adhesion_lift": ("retract_speed_m_s", "dwell_s"),
    "stiffness_drift": ("order", "t_before_s", "t_start_s", "t_after_s", "temperature_c"),
}
"""Causes whose covariate is a column of the table, and all columns that carry it."""

STROKES = (
    Series("one cause", 100, "one", shifted=True),
    Series("one faint cause", 60, "one", q=0.05),
    Series("two causes", 60, "two", shifted=True),
    Series("none", 150, "none"),
    Series("outside", 60, "outside"),
    Series("raster", 60, "raster", second="more actions"),
    Series(
        "shuffled", 6, "one", 0.4, ("ink_depletion", "tool_wear", "drying_shift", "wet_mixing"), "shuffled covariate"
    ),
    Series("doubled", 6, "one", q=0.1, second="doubled effect"),
    Series("deleted", 6, "one", q=0.4, second="deleted candidate"),
)
PUSHES = (
    Series("one cause", 45, "one"),
    Series("two causes", 15, "two"),
    Series("none", 40, "none"),
    Series("outside", 15, "outside"),
    Series("shuffled", 4, "one", q=0.4, causes=("adhesion_lift", "stiffness_drift"), second="shuffled covariate"),
    Series("doubled", 4, "one", q=0.1, second="doubled effect"),
    Series("deleted", 4, "one", q=0.4, second="deleted candidate"),
)


def seed_of(commit: str, series: str, index: int) -> int:
    """A world's seed, 31 bits. It follows from the commit's hash, so that no code can be tuned to it."""
    digest = hashlib.sha256(f"{commit} {series} {index}".encode()).digest()
    return int.from_bytes(digest[:4], "big") >> 1


def wanted(series: Series, share: float) -> int:
    """How many of its worlds make a `share` of the benchmark: at least one."""
    return max(round(series.worlds * share), 1)
