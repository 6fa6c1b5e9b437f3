"""Plans for scans that are finer than the push models' maps, with the objective of the scan (thesis 7.2: 512 × 512).

A push model predicts at the pixel size that it was trained at, which resolves the dent of its tool. So the plan is made
on the model's grid [h, w]. From clay S [H, W] on the scan's grid, and its resampling C₀ [h, w], predicted clay C [h, w]
means

    S + P (C − C₀) Qᵀ

on the scan's pixels, where P [H, h] and Q [W, w] interpolate linearly. The clay objective (thesis eq. 7.7) of that map
is a quadratic form of C − C₀ with matrices of the small grid. Values and gradients at the scan's resolution therefore
cost what they cost on the model's grid.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pentimento.planning.objectives import ClayObjective, changed_windows
from pentimento.planning.pushes.config import Reach, SculptorConfig
from pentimento.planning.pushes.plan import PushPlan, plan
from pentimento.planning.pushes.rollout import EnsembleRollout

Array = NDArray[np.float32]
FloatArray = NDArray[np.float64]

_MM = 1e3


def area_means(fine: int, coarse: int) -> FloatArray:
    """[coarse, fine] matrix of means over equal intervals; a pixel on an edge counts in proportion to its overlap."""
    edges, pixel = np.arange(coarse + 1) * fine / coarse, np.arange(fine)
    overlap = np.minimum(edges[1:, None], pixel + 1) - np.maximum(edges[:-1, None], pixel)
    return np.maximum(overlap, 0.0) * coarse / fine


def interpolation(coarse: int, fine: int) -> FloatArray:
    """[fine, coarse] matrix of linear interpolation between pixel centres; constant beyond the outermost ones."""
    place = np.clip((np.arange(fine) + 0.5) * coarse / fine - 0.5, 0, coarse - 1)
    return np.maximum(1 - np.abs(place[:, None] - np.arange(coarse)), 0.0)


def resampling(given: int, wanted: int) -> FloatArray:
    """[wanted, given]: means where that is coarser, linear interpolation where it is finer."""
    return area_means(given, wanted) if wanted <= given else interpolation(given, wanted)


def resampled(height_m: Array, shape: tuple[int, int]) -> Array:
    """Heights [H, W] on another grid [h, w] of the same window, with the mean height kept."""
    rows, columns = (resampling(given, wanted) for given, wanted in zip(height_m.shape, shape, strict=True))
    mean_m = height_m.mean(dtype=np.float64)
    relative = rows @ (height_m - mean_m) @ columns.T  # heights differ little from their mean: sums stay exact
    return (relative - relative.mean() + mean_m).astype(np.float32)


class Spread:
    """Changes of height on a model's grid [h, w], brought to a scan's grid [H, W]."""

    def __init__(self, grid: tuple[int, int], shape: tuple[int, int]) -> None:
        self.rows, self.columns = (resampling(few, many) for few, many in zip(grid, shape, strict=True))
        """[H, h] and [W, w]"""

    def add(self, height_m: Array, change_m: Array) -> None:
        """Add a change [h, w] to heights [H, W], in place, in the window where it is not zero."""
        window = changed_windows(change_m[None])[0]
        if window is None:
            return
        parts = [matrix[:, part] for matrix, part in zip((self.rows, self.columns), window, strict=True)]
        reached = [np.flatnonzero(part.any(axis=1)) for part in parts]
        rows, columns = (slice(pixels[0], pixels[-1] + 1) for pixels in reached)
        height_m[rows, columns] += (parts[0][rows] @ change_m[window] @ parts[1][columns].T).astype(height_m.dtype)

    def maps(self, height_m: Array, predicted_m: Array) -> Array:
        """Heights [N + 1, H, W]: ``height_m`` [H, W] with the changes from one to the next of [N + 1, h, w]."""
        maps = np.empty((len(predicted_m), *height_m.shape), dtype=np.float32)
        maps[0] = height_m
        for number in range(1, len(maps)):
            maps[number] = maps[number - 1]
            self.add(maps[number], predicted_m[number] - predicted_m[number - 1])
        return maps


@dataclass(frozen=True, eq=False)
class _Square:
    """Sum of squares of ``base`` + P Δ Qᵀ as a function of Δ [h, w]: c + ⟨2 l + PᵀP Δ QᵀQ, Δ⟩, l = Pᵀ base Q."""

    constant: float
    linear: FloatArray
    of_rows: FloatArray
    """PᵀP [h, h]"""
    of_columns: FloatArray
    """QᵀQ [w, w]"""

    @staticmethod
    def of(base: FloatArray, rows: FloatArray, columns: FloatArray, weight: float) -> _Square:
        """``weight`` times the sum, for P = rows [H, h], Q = columns [W, w]."""
        linear = weight * (rows.T @ base @ columns)
        return _Square(weight * float(np.square(base).sum()), linear, weight * (rows.T @ rows), columns.T @ columns)

    def curved(self, change: FloatArray, window: tuple[slice, slice]) -> FloatArray:
        """PᵀP Δ QᵀQ within a window [r, c] of which Δ [r, c] is zero outside."""
        rows, columns = window
        return np.asarray(self.of_rows[rows, rows] @ change @ self.of_columns[columns, columns])


class ScanObjective(ClayObjective):
    """The clay objective on a scan's grid, for clay on a model's grid."""

    def __init__(self, of_scan: ClayObjective, scan_m: Array, start_m: Array) -> None:
        """Take the objective of the scan, heights [H, W], and the same clay ``start_m`` [h, w] as the plan starts from.

        Raises:
            ContractError: the grid has fewer than 3 pixels a side, or other proportions than the window.
        """
        grid, shape = (start_m.shape[0], start_m.shape[1]), (scan_m.shape[0], scan_m.shape[1])
        window_m = (0.0, 0.0, shape[1] / of_scan.pixels_per_m, shape[0] / of_scan.pixels_per_m)
        super().__init__(resampled(of_scan.goal_m, grid), window_m, of_scan.weights)
        self._start_m, spread = start_m.astype(np.float64), Spread(grid, shape)
        rows, columns, slopes = spread.rows, spread.columns, of_scan.slopes
        error = (scan_m - of_scan.goal_m).astype(np.float64)
        right, up = slopes.of(error)
        self._height = _Square.of(error, rows, columns, _MM**2 / error.size)
        self._slopes = (
            _Square.of(right, slopes.rows.smooth(rows), slopes.columns.slope(columns), 1 / right.size),
            _Square.of(up, -slopes.rows.slope(rows), slopes.columns.smooth(columns), 1 / up.size),
        )

    def error_3d_mm2(self, height_m: Array) -> FloatArray:
        """Mean squared difference of height [...] on the scan's grid for clay [..., h, w], mm²."""
        return self._total((self._height,), height_m)

    def visual_error(self, height_m: Array) -> FloatArray:
        """Mean squared difference of slope [...] on the scan's grid for clay [..., h, w], summed over both axes."""
        return self._total(self._slopes, height_m)

    def values_from(self, before_m: Array, after_m: Array) -> FloatArray:
        """See ``ClayObjective``; for clay [h, w] and [K, h, w]."""
        value, gradient = self._value_and_gradient(before_m)
        values = np.full(len(after_m), value)
        for number, window in enumerate(changed_windows(after_m - before_m)):
            if window is not None:
                change = (after_m[number][window] - before_m[window]).astype(np.float64)
                curved = sum(weight * part.curved(change, window) for weight, part in self._parts)
                values[number] += float(((gradient[window] + curved) * change).sum())
        return values

    def __call__(self, height_m: Array) -> tuple[float, Array]:
        """The objective of clay [h, w], and its gradient [h, w] with respect to it, per metre."""
        value, gradient = self._value_and_gradient(height_m)
        return value, gradient.astype(height_m.dtype)

    @property
    def _parts(self) -> list[tuple[float, _Square]]:
        weights = [self.weights.error_3d, self.weights.visual, self.weights.visual]
        return [pair for pair in zip(weights, (self._height, *self._slopes), strict=True) if pair[0] > 0]

    def _value_and_gradient(self, height_m: Array) -> tuple[float, FloatArray]:
        change, value, gradient = height_m - self._start_m, 0.0, np.zeros(height_m.shape)
        for weight, part in self._parts:
            curved = part.of_rows @ change @ part.of_columns
            value += weight * (part.constant + float(((2 * part.linear + curved) * change).sum()))
            gradient += 2 * weight * (part.linear + curved)
        return value, gradient

    def _total(self, parts: tuple[_Square, ...], height_m: Array) -> FloatArray:
        change = height_m - self._start_m
        total = np.zeros(height_m.shape[:-2])
        for part in parts:
            curved = part.of_rows @ change @ part.of_columns
            total += part.constant + ((2 * part.linear + curved) * change).sum(axis=(-2, -1))
        return total


def plan_for_scan(
    height_m: Array,
    foresight: EnsembleRollout,
    reach: Reach,
    *,
    grid: tuple[int, int],
    config: SculptorConfig,
    count: int,
    item: tuple[int, ...],
    begun: FloatArray | None = None,
) -> PushPlan:
    """As ``plan`` does, for a scan [H, W] of any resolution.

    Args:
        height_m: [H, W] the scan.
        foresight: push models, whose maps have the shape ``grid`` [h, w], and the objective of the scan [H, W].

    Returns:
        The plan, with values and predicted clay on the scan's grid.
    """
    if height_m.shape == grid:
        return plan(height_m, foresight, reach, config=config, count=count, item=item, begun=begun)
    start_m = resampled(height_m, grid)
    on_grid = foresight.towards(ScanObjective(foresight.objective, height_m, start_m))
    made = plan(start_m, on_grid, reach, config=config, count=count, item=item, begun=begun)
    spread = Spread(grid, (height_m.shape[0], height_m.shape[1]))
    return replace(made, predicted_m=spread.maps(height_m, made.predicted_m))
