"""What may be asked of an end-effector: the bounds of actions, and the place of each push in the area."""

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
"""Columns of an action."""


@dataclass(frozen=True)
class Reach:
    """Which actions an end-effector may be asked for: ranges are (least, most)."""

    window_m: tuple[float, float, float, float]
    """Pushes start and end within it, canvas frame."""
    length_m: tuple[float, float]
    depth_m: tuple[float, float]
    width_m: float
    """Of the mark that it leaves, roughly: where candidates are looked for, not what the model says."""
    travels: bool
    """A push ends its length away from its start; a pinch closes around it."""

    def __post_init__(self) -> None:
        x_min, y_min, x_max, y_max = check_window(self.window_m)
        for name, (minimum, most) in (("length_m", self.length_m), ("depth_m", self.depth_m)):
            if not 0 <= minimum <= most:
                raise ValueError(f"{name} is {minimum} to {most}; it must be 0 or more, and the least first.")
        if self.travels and self.length_m[1] > min(x_max - x_min, y_max - y_min):
            raise ValueError(f"Pushes of {self.length_m[1]:g} m do not fit a window {list(self.window_m)} m.")

    def draw(self, count: int, rng: np.random.Generator) -> FloatArray:
        """Actions [K, 5], uniform over everything."""
        low = (*self.window_m[:2], -np.pi, self.length_m[0], self.depth_m[0])
        high = (*self.window_m[2:], np.pi, self.length_m[1], self.depth_m[1])
        return self.keep_within(rng.uniform(low, high, (count, 5)))

    def keep_within(self, actions: FloatArray) -> FloatArray:
        """The nearest allowed lengths and depths [K, 5], and each push moved as a whole to where it fits."""
        kept = np.array(actions, dtype=np.float64)
        kept[:, LENGTH] = np.clip(kept[:, LENGTH], *self.length_m)
        kept[:, DEPTH] = np.clip(kept[:, DEPTH], *self.depth_m)
        kept[:, THETA] = np.remainder(kept[:, THETA] + np.pi, 2 * np.pi) - np.pi
        way = ends(kept) - kept[:, :2] if self.travels else np.zeros((len(kept), 2))
        low = np.array(self.window_m[:2]) - np.minimum(way, 0)
        high = np.array(self.window_m[2:]) - np.maximum(way, 0)
        kept[:, :2] = np.clip(kept[:, :2], low, high)
        return kept


def ends(actions: FloatArray) -> FloatArray:
    """Where pushes [K, 5] end, [K, 2], canvas frame."""
    heading = np.stack([np.cos(actions[:, THETA]), np.sin(actions[:, THETA])], axis=1)
    return np.asarray(actions[:, :2] + actions[:, LENGTH, None] * heading)


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
    """For the disagreement of an ensemble; see ``rollout.EnsembleRollout``."""
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
