"""The series of worlds of the blind table of pushes (docs/blind_pushes.md)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from studies.blind_pushes.worlds import Stratum

Second = Literal["shuffled covariate", "doubled effect", "deleted candidate"]


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


WITH_A_COLUMN = ("adhesion_lift", "stiffness_drift")
"""Causes whose covariate is a column of the table, which can be shuffled."""
COLUMNS: dict[str, tuple[str, ...]] = {
    "adhesion_lift": ("retract_speed_m_s", "dwell_s"),
    "stiffness_drift": ("order", "t_before_s", "t_start_s", "t_after_s", "temperature_c"),
}

SERIES = (
    Series("one cause", 45, "one"),
    Series("two causes", 15, "two"),
    Series("none", 40, "none"),
    Series("outside", 15, "outside"),
    Series("shuffled", 4, "one", q=0.4, causes=WITH_A_COLUMN, second="shuffled covariate"),
    Series("doubled", 4, "one", q=0.1, second="doubled effect"),
    Series("deleted", 4, "one", q=0.4, second="deleted candidate"),
)
