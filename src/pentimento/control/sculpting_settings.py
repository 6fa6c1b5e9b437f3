"""Settings of sculpting, which the pipeline and the lean runner share."""

from __future__ import annotations

from dataclasses import dataclass

from pentimento.contracts.ranges import above_zero, at_least
from pentimento.planning.pushes.config import SculptorConfig
from pentimento.planning.pushes.goal import GoalSettings


@dataclass(frozen=True)
class Execution:
    """How a plan is executed."""

    replan_every: int
    """Actions between two plans."""
    patience: int
    """Actions that may pass without a new minimum of the measured objective."""
    dwell_s: float
    retract_speed_m_s: float

    def __post_init__(self) -> None:
        at_least(self, 1, "replan_every", "patience")
        at_least(self, 0, "dwell_s")
        above_zero(self, "retract_speed_m_s")


@dataclass(frozen=True)
class SculptingSettings:
    """How one material is sculpted: size and depth of goals, planning and execution."""

    actions: int
    """Maximum number for each goal."""
    side_share: float
    """Fraction of the area's side that a goal covers."""
    edge_blur_m: float
    """Standard deviation of the Gaussian that blurs a goal's edges: about a third of the end-effector's rounding."""
    fit: GoalSettings
    planner: SculptorConfig
    execution: Execution
    feeder: str | None = None
    """Name of the feeder that places pellets of the material; None for pushes alone."""

    def __post_init__(self) -> None:
        at_least(self, 1, "actions")
        above_zero(self, "side_share")
        at_least(self, 0, "edge_blur_m")
