"""Settings of the push planner, and the bounds of an end-effector's actions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.frames import check_window
from pentimento.contracts.ranges import above_zero, at_least
from pentimento.planning.objectives import Weights

FloatArray = NDArray[np.float64]

X, Y, THETA, LENGTH, DEPTH = range(5)
"""Columns of an action [5]; see ``planning.pushes.rollout``."""


@dataclass(frozen=True)
class Reach:
    """Bounds of the actions of an end-effector. Ranges are (minimum, maximum)."""

    window_m: tuple[float, float, float, float]
    """x_min, y_min, x_max, y_max, canvas frame. Pushes start and end within it."""
    length_m: tuple[float, float]
    depth_m: tuple[float, float]
    width_m: float
    """Approximate width of its mark. It scales the search for candidates; the model does not use it."""
    travels: bool
    """True for a push, which ends its length away from its start. False for a pinch, which closes around it."""

    def __post_init__(self) -> None:
        x_min, y_min, x_max, y_max = check_window(self.window_m)
        for name, (minimum, maximum) in (("length_m", self.length_m), ("depth_m", self.depth_m)):
            if not 0 <= minimum <= maximum:
                raise ValueError(f"{name} is {minimum} to {maximum}; give two values of 0 or more, smaller first.")
        if self.travels and self.length_m[1] > min(x_max - x_min, y_max - y_min):
            raise ValueError(f"Pushes of {self.length_m[1]:g} m do not fit a window {list(self.window_m)} m.")

    def draw(self, count: int, rng: np.random.Generator) -> FloatArray:
        """Random actions [count, 5], uniform over all bounds."""
        low = (*self.window_m[:2], -np.pi, self.length_m[0], self.depth_m[0])
        high = (*self.window_m[2:], np.pi, self.length_m[1], self.depth_m[1])
        return self.keep_within(rng.uniform(low, high, (count, 5)))

    def keep_within(self, actions: FloatArray) -> FloatArray:
        """Actions [K, 5] with lengths and depths clipped to their bounds, and each push moved as a whole into the
        window.
        """
        kept = np.array(actions, dtype=np.float64)
        kept[:, LENGTH] = np.clip(kept[:, LENGTH], *self.length_m)
        kept[:, DEPTH] = np.clip(kept[:, DEPTH], *self.depth_m)
        kept[:, THETA] = np.remainder(kept[:, THETA] + np.pi, 2 * np.pi) - np.pi
        way = ends(kept) - kept[:, :2] if self.travels else np.zeros((len(kept), 2))
        low = np.array(self.window_m[:2]) - np.minimum(way, 0)
        high = np.array(self.window_m[2:]) - np.maximum(way, 0)
        kept[:, :2] = np.clip(kept[:, :2], low, high)
        return kept

    def spread(self) -> FloatArray:
        """[5] a scale for differences of actions: half a mark's width, π/8, a quarter of the other ranges."""
        ranges = (np.pi / 8, np.ptp(self.length_m) / 4, np.ptp(self.depth_m) / 4)
        return np.array([0.5 * self.width_m, 0.5 * self.width_m, *ranges])


def ends(actions: FloatArray) -> FloatArray:
    """End points [K, 2] of pushes [K, 5], canvas frame."""
    heading = np.stack([np.cos(actions[:, THETA]), np.sin(actions[:, THETA])], axis=1)
    return np.asarray(actions[:, :2] + actions[:, LENGTH, None] * heading)


@dataclass(frozen=True)
class PushRates:
    """Adam's largest step for each column of an action. A half cosine scales all by one factor."""

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
    disagreement_weight: float
    """Weight of the ensemble's variance; see ``rollout.EnsembleRollout``."""
    horizon: int
    """Largest number of actions that are planned ahead."""
    candidates: int
    """Candidates for each new action that are drawn around the error or anywhere."""
    rounds: int
    """Rounds in which as many candidates again are tried, each round closer to the best of the last."""
    guided_share: float
    """Share of the drawn candidates that end where there is too much material. The others are uniform."""
    refine: Literal["newton", "gradient", "cross_entropy", "none"]
    """How actions are improved: ``newton`` improves each one before the next is chosen, the others the whole sequence
    at the end."""
    iterations: int
    """Iterations of ``refine``."""
    learning_rates: PushRates
    """Of ``gradient``."""
    samples: int
    """Sequences sampled in each iteration of ``cross_entropy``."""
    elite_share: float
    """Share of the samples to which the next iteration's distribution is fitted."""
    min_relative_gain: float
    """An action is added only if it lowers the value by more than this share."""
    edge_m: float
    """Distance that pushes keep from the area's edge."""
    seed: int
    screened: int = 0
    """Further candidates for each new action, from ``screening.best_of_all_places``; 0 does without screening."""
    count_unexplained: bool = False
    """Whether plans count what the push model leaves of each push, with the same weight as the ensemble's variance; see
    ``rollout.EnsembleRollout``."""

    def __post_init__(self) -> None:
        at_least(
            self,
            0,
            "disagreement_weight",
            "screened",
            "rounds",
            "guided_share",
            "iterations",
            "min_relative_gain",
            "edge_m",
            "seed",
        )
        at_least(self, 1, "horizon", "candidates")
        at_least(self, 2, "samples")
        above_zero(self, "elite_share")
        for name in ("guided_share", "elite_share", "min_relative_gain"):
            if getattr(self, name) > 1:
                raise ValueError(f"{name} is {getattr(self, name)}; it is a share, at most 1.")
