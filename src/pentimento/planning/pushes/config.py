"""Settings of the sculptor: every number that it needs, with its unit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from pentimento.contracts.ranges import above_zero, at_least
from pentimento.planning.pushes.objective import Weights


@dataclass(frozen=True)
class PushRates:
    """Adam's step for each number of an action, at its largest: half a cosine lowers all alike."""

    place_m: float
    theta_rad: float
    length_m: float
    depth_m: float

    def __post_init__(self) -> None:
        at_least(self, 0, "place_m", "theta_rad", "length_m", "depth_m")


@dataclass(frozen=True)
class SculptorConfig:
    """How pushes are planned."""

    weights: Weights
    caution: float
    """For the disagreement of an ensemble; see ``rollout.Foresight``."""
    horizon: int
    """Actions planned ahead."""
    candidates: int
    """So many are tried for each new action."""
    rounds: int
    """So many times as many again are tried, each round nearer about the best of the last."""
    guided: float
    """Share of the first candidates that start where there is too much material; the others start anywhere."""
    refine: Literal["gradient", "cross_entropy", "none"]
    """How a plan is improved as a whole, once its actions were chosen one by one."""
    iterations: int
    """Of that."""
    rates: PushRates
    """Of ``gradient``."""
    samples: int
    """Plans drawn in each iteration of ``cross_entropy``."""
    elite: float
    """Share of the samples that the next iteration is drawn around."""
    min_gain: float
    """No action follows one that lowers the value by less than this share of what it was."""
    edge_m: float
    """Pushes start and end this far from the area's edge."""
    seed: int

    def __post_init__(self) -> None:
        at_least(self, 0, "caution", "rounds", "guided", "iterations", "min_gain", "edge_m", "seed")
        at_least(self, 1, "horizon", "candidates")
        at_least(self, 2, "samples")
        above_zero(self, "elite")
        for name in ("guided", "elite", "min_gain"):
            if getattr(self, name) > 1:
                raise ValueError(f"{name} is {getattr(self, name)}; it is a share, at most 1.")
