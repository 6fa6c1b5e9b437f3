"""Objectives of plans: the print objective (thesis 4.3), weighted sums (eq. 4.5), and the clay objective (eq. 7.7)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.errors import ConfigError, ContractError
from pentimento.contracts.frames import Window, pixels_per_m
from pentimento.contracts.ranges import at_least
from pentimento.planning.slopes import Slopes, scan_noise_m, slope_scale_m
from pentimento.render.reconstruction_loss import seen, squared_error, srgb_of

Array = NDArray[np.float32]


class Objective(Protocol):
    """A function of an image that a plan minimises."""

    def __call__(self, image: Array) -> tuple[float, Array]:
        """The value for an image [H, W, 3] in linear light, and its gradient [H, W, 3]."""


class PrintObjective:
    """Mean squared difference in sRGB between an image and a target, averaged over viewing distances.

    A viewing distance is modelled as the side of a square over which light is averaged before the comparison. The
    thesis (4.3) compares single pixels (1 px). Larger squares compare tone, where single pixels compare black lines
    with grey.
    """

    def __init__(self, target: Array, distances_px: tuple[int, ...]) -> None:
        """Average ``target`` [H, W, 3] (linear light) over each distance.

        Raises:
            ConfigError: the picture is smaller than a viewing distance.
        """
        height, width = target.shape[:2]
        if max(distances_px) > min(height, width):
            raise ConfigError(
                f"A viewing distance of {max(distances_px)} px is larger than the picture of {height} x {width} px: "
                "lower the planner's distances_px or raise its pixels_per_m."
            )
        self._seen = [(distance, srgb_of(seen(target, distance))) for distance in distances_px]

    def __call__(self, image: Array) -> tuple[float, Array]:
        """The value for an image [H, W, 3] in linear light, and its gradient, in the image's precision."""
        gradient = np.zeros_like(image)
        share = 1 / len(self._seen)
        value = sum(
            share * squared_error(image, target.astype(image.dtype, copy=False), distance, gradient, share)
            for distance, target in self._seen
        )
        return float(value), gradient


class Term(NamedTuple):
    """One objective of a sum."""

    name: str
    weight: float
    objective: Objective


class WeightedObjective:
    """Σ wᵢ · lᵢ over terms, wᵢ ≥ 0 (the thesis uses 0 and 1). Terms of weight 0 are not computed."""

    def __init__(self, terms: tuple[Term, ...]) -> None:
        """Keep the terms of weight above 0.

        Raises:
            ValueError: no weight is above 0, one is below, or two terms share a name.
        """
        names = [term.name for term in terms]
        if len(set(names)) < len(names):
            raise ValueError(f"Two of the objectives {names} share a name; give each its own.")
        if not all(term.weight >= 0 for term in terms):
            raise ValueError(f"The weights of {names} are {[term.weight for term in terms]}: each must be 0 or more.")
        self._terms = tuple(term for term in terms if term.weight > 0)
        if not self._terms:
            raise ValueError(f"No objective of {names} has a weight above 0; give one of them a weight.")

    def __call__(self, image: Array) -> tuple[float, Array]:
        """The sum for an image [H, W, 3] in linear light, and its gradient."""
        total, gradient = 0.0, np.zeros_like(image)
        for term in self._terms:
            value, slope = term.objective(image)
            total += term.weight * value
            gradient += np.float32(term.weight) * slope
        return total, gradient

    def values(self, image: Array) -> dict[str, float]:
        """Each term's value by name, not weighted, for the log."""
        return {term.name: term.objective(image)[0] for term in self._terms}


FloatArray = NDArray[np.float64]

_MM = 1e3


@dataclass(frozen=True)
class Weights:
    """Weights of the two errors in the clay objective (thesis eq. 7.7)."""

    error_3d: float
    """Per mm²."""
    visual: float
    """Per squared slope (dimensionless, rise over run)."""
    slope_scale_m: float = 0.0
    """Scale at which slopes are taken (``planning.slopes``): 0 takes central differences, which noise of scans enters
    in full. Two scans can choose it (``weights_for_scans``)."""

    def __post_init__(self) -> None:
        if not (self.error_3d >= 0 and self.visual >= 0 and self.error_3d + self.visual > 0):
            raise ValueError(f"The weights are {self.error_3d} and {self.visual}; each is 0 or more, one above 0.")
        at_least(self, 0, "slope_scale_m")


class ClayObjective:
    """w_3D ‖S' − S‖² + w_viz ‖∇S' − ∇S‖², means over pixels. S' is the goal, ∇ are slopes at the weights' scale.

    Slopes are compared, since it is slopes that shading makes visible, under any light.
    """

    def __init__(self, goal_m: Array, window_m: Window, weights: Weights) -> None:
        """Take the goal, heights [H, W] in metres over ``window_m`` (canvas frame).

        Raises:
            ContractError: the goal has a hole or fewer than 3 pixels a side, or does not fit the window.
        """
        if goal_m.ndim != 2 or min(goal_m.shape) < 3:
            raise ContractError(f"A goal is a height map of at least 3 x 3 pixels, not of shape {goal_m.shape}.")
        if not np.isfinite(goal_m).all():
            raise ContractError("The goal has holes (NaN) or infinite heights; fill them before planning.")
        self.goal_m = goal_m
        self.weights = weights
        self.pixels_per_m = pixels_per_m(goal_m.shape, window_m)
        self.slopes = Slopes((goal_m.shape[0], goal_m.shape[1]), self.pixels_per_m, weights.slope_scale_m)

    def of_changes(self, weights: Weights) -> ClayObjective:
        """w_3D ‖c‖² + w_viz ‖∇c‖² of a change c [H, W] of height, with other weights."""
        height, width = self.goal_m.shape
        window_m = (0.0, 0.0, width / self.pixels_per_m, height / self.pixels_per_m)
        return ClayObjective(np.zeros_like(self.goal_m), window_m, weights)

    def error_3d_mm2(self, height_m: Array) -> FloatArray:
        """Mean squared difference of height [...] of maps [..., H, W], mm²."""
        difference = (height_m - self.goal_m) * _MM
        return np.asarray(np.square(difference).mean(axis=(-2, -1), dtype=np.float64))

    def visual_error(self, height_m: Array) -> FloatArray:
        """Mean squared difference of slope [...] of maps [..., H, W], summed over both axes."""
        right, up = self.slopes.of(height_m - self.goal_m)
        of_right = np.square(right).mean(axis=(-2, -1), dtype=np.float64)
        return np.asarray(of_right + np.square(up).mean(axis=(-2, -1), dtype=np.float64))

    def values(self, height_m: Array) -> FloatArray:
        """The objective [...] of maps [..., H, W]."""
        total = np.zeros(height_m.shape[:-2])
        if self.weights.error_3d > 0:
            total = total + self.weights.error_3d * self.error_3d_mm2(height_m)
        if self.weights.visual > 0:
            total = total + self.weights.visual * self.visual_error(height_m)
        return total

    def values_from(self, before_m: Array, after_m: Array) -> FloatArray:
        """The objective [K] of maps [K, H, W] that differ from one map [H, W] only around a push.

        Only the window in which they differ is evaluated.
        """
        if self.weights.slope_scale_m > 0 and self.weights.visual > 0:
            return self._values_by_gradient(before_m, after_m)
        values = np.full(len(after_m), float(self.values(before_m)))
        for number, window in enumerate(changed_windows(after_m - before_m)):
            if window is not None:
                wide = tuple(slice(max(part.start - 2, 0), part.stop + 2) for part in window)  # slopes reach a pixel on
                values[number] += self._sum(after_m[number][wide], wide) - self._sum(before_m[wide], wide)
        return values

    def _values_by_gradient(self, before_m: Array, after_m: Array) -> FloatArray:
        """The same by the value and gradient before and the quadratic part of each change: slopes at a scale depend on
        more than their surroundings near the border."""
        value, gradient = self._value_and_gradient(before_m.astype(np.float64))
        values = np.full(len(after_m), value)
        for number, window in enumerate(changed_windows(after_m - before_m)):
            if window is not None:
                change = (after_m[number][window] - before_m[window]).astype(np.float64)
                height = self.weights.error_3d * _MM**2 * np.square(change).sum()
                slope = sum(np.square(each).sum() for each in self.slopes.of_window(change, window))
                values[number] += float((gradient[window] * change).sum())
                values[number] += (height + self.weights.visual * slope) / self.goal_m.size
        return values

    def _sum(self, height_m: Array, window: tuple[slice, ...]) -> float:
        """Contribution of a window of the map, heights [h, w], to the objective."""
        (rows, columns), difference = self.goal_m.shape, height_m - self.goal_m[window]
        right, up = Slopes((difference.shape[0], difference.shape[1]), self.pixels_per_m).of(difference)
        height = self.weights.error_3d * _MM**2 * np.square(difference).sum(dtype=np.float64) / (rows * columns)
        of_right = np.square(right).sum(dtype=np.float64) / (rows * (columns - 2))
        of_up = np.square(up).sum(dtype=np.float64) / ((rows - 2) * columns)
        return float(height + self.weights.visual * (of_right + of_up))

    def __call__(self, height_m: Array) -> tuple[float, Array]:
        """The objective of one map [H, W], and its gradient [H, W] with respect to the heights, per metre."""
        value, gradient = self._value_and_gradient(height_m)
        return value, gradient.astype(height_m.dtype)

    def _value_and_gradient(self, height_m: NDArray[Any]) -> tuple[float, NDArray[Any]]:
        difference = height_m - self.goal_m
        gradient = (2 * self.weights.error_3d * _MM**2 / difference.size) * difference
        if self.weights.visual > 0:
            right, up = self.slopes.of(difference)
            gradient = gradient + 2 * self.weights.visual * self.slopes.back(right / right.size, up / up.size)
        return float(self.values(height_m)), gradient


NOISE_SHARE = 0.05
"""Share of the visual error before the first action that noise of scans may add to it."""


def weights_for_scans(weights: Weights, goal_m: Array, window_m: Window, scans_m: tuple[Array, Array]) -> Weights:
    """The weights with the scale of slopes that two scans [H, W] of the same clay ask for; a scale above 0 is kept.

    Their difference is the scanner's noise. At that scale it adds no more than ``NOISE_SHARE`` of the visual error
    between clay and goal [H, W]. Where it adds less to slopes of neighbouring pixels, these are taken.
    """
    if weights.slope_scale_m > 0:
        return weights
    objective = ClayObjective(goal_m, window_m, weights)
    noise_m = scan_noise_m(*scans_m)
    seen = float(np.mean([objective.visual_error(scan) for scan in scans_m]))
    error = max(seen - (noise_m * objective.pixels_per_m) ** 2, NOISE_SHARE * seen)
    return replace(weights, slope_scale_m=slope_scale_m(noise_m, objective.pixels_per_m, NOISE_SHARE * error))


def changed_windows(change: Array) -> list[tuple[slice, slice] | None]:
    """Of each map [K, H, W], the smallest window (rows, columns) outside of which it is 0; None where all of it is."""
    windows: list[tuple[slice, slice] | None] = []
    for there in change != 0:
        rows, columns = np.flatnonzero(there.any(axis=1)), np.flatnonzero(there.any(axis=0))
        windows.append((slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)) if len(rows) else None)
    return windows
