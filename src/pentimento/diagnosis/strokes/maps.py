"""Residuals of many strokes laid over one another: on the canvas, and along a straightened stroke."""

from __future__ import annotations

from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from pentimento.diagnosis.strokes.measured import Measured

Array = NDArray[Any]

_CANVAS_PX = 220
_ALONG, _ACROSS = 120, 60
_BEYOND = 0.25
"""Of a stroke's length: what is shown before its start and after its end."""

_HALF_WIDTHS = 4.0


class ResidualMap(NamedTuple):
    """Mean and worst residual at each place; NaN where nothing was seen."""

    mean: Array
    """[H, W]"""
    worst: Array
    """[H, W] the residual of largest size."""
    extent: tuple[float, float, float, float]
    """left, right, bottom, top."""


def places_known(measured: Measured) -> bool:
    """Whether the strokes' places on the canvas were recorded (they do not all start at one point)."""
    start = measured.samples.path[:, 0, 1:3]
    return float((start.amax(0) - start.amin(0)).max()) > 1e-3


def canvas_map(residual: Array, measured: Measured) -> ResidualMap:
    """Residuals [B, H, W] (NaN outside the windows) at their places on the canvas, mm."""
    samples = measured.samples
    k = samples.pixels_per_m.double().numpy()
    x_min, y_max = samples.top_left_m.double().numpy().T
    height, width = residual.shape[1:]
    x = x_min[:, None] + (np.arange(width) + 0.5) / k[:, None]
    y = y_max[:, None] - (np.arange(height) + 0.5) / k[:, None]
    seen = np.isfinite(residual)
    b, r, c = np.nonzero(seen)
    xs, ys, values = x[b, c], y[b, r], residual[seen]
    left, right, bottom, top = xs.min(), xs.max(), ys.min(), ys.max()
    cell = max(right - left, top - bottom) / _CANVAS_PX
    columns, rows = int((right - left) / cell) + 1, int((top - bottom) / cell) + 1
    at = ((top - ys) / cell).astype(int) * columns + ((xs - left) / cell).astype(int)
    # A cell's residual of one stroke is the mean of its pixels.
    key = b * (rows * columns) + at
    cells, group, count = np.unique(key, return_inverse=True, return_counts=True)
    of_stroke = np.bincount(group, values) / count
    mean, worst = _mean_and_worst(cells % (rows * columns), of_stroke, rows * columns)
    extent = (left * 1e3, right * 1e3, bottom * 1e3, top * 1e3)
    return ResidualMap(mean.reshape(rows, columns), worst.reshape(rows, columns), extent)


def stroke_map(residual: Array, measured: Measured) -> ResidualMap:
    """Residuals [B, H, W] along straightened strokes: share of the length from start to end, mm to the left."""
    samples = measured.samples
    half_m = min(float(np.median(np.minimum(*_sides_m(measured)))) / 2, _reach_m(measured))
    share = np.linspace(-_BEYOND, 1 + _BEYOND, _ALONG)
    across = np.linspace(half_m, -half_m, _ACROSS)
    maps = []
    for b, path in enumerate(samples.path[..., 1:3].double().numpy()):
        points = _straightened(path, share, across)
        x = (points[..., 0] - float(samples.top_left_m[b, 0])) * float(samples.pixels_per_m[b]) - 0.5
        y = (float(samples.top_left_m[b, 1]) - points[..., 1]) * float(samples.pixels_per_m[b]) - 0.5
        maps.append(
            cv2.remap(
                residual[b].astype(np.float32), x.astype(np.float32), y.astype(np.float32), cv2.INTER_LINEAR,
                borderMode=cv2.BORDER_CONSTANT, borderValue=(np.nan,),
            )
        )  # fmt: skip
    values = np.stack(maps)
    seen = np.isfinite(values)
    _, row, column = np.nonzero(seen)
    mean, worst = _mean_and_worst(row * _ALONG + column, values[seen], _ACROSS * _ALONG)
    extent = (-_BEYOND, 1 + _BEYOND, -half_m * 1e3, half_m * 1e3)
    return ResidualMap(mean.reshape(_ACROSS, _ALONG), worst.reshape(_ACROSS, _ALONG), extent)


def _straightened(path: Array, share: Array, across: Array) -> Array:
    """Places [A, S, 2] at shares of a path's [N, 2] length and distances to its left."""
    steps = np.hypot(*np.diff(path, axis=0).T)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    length = max(along[-1], 1e-9)
    tangent = np.gradient(path, axis=0)
    tangent /= np.maximum(np.hypot(*tangent.T), 1e-12)[:, None]
    at = np.clip(share, 0, 1) * length
    on_path = np.stack([np.interp(at, along, path[:, i]) for i in (0, 1)], 1)
    heading = np.stack([np.interp(at, along, tangent[:, i]) for i in (0, 1)], 1)
    on_path = on_path + (share * length - at)[:, None] * heading
    left = np.stack([-heading[:, 1], heading[:, 0]], 1)
    places: Array = on_path[None] + across[:, None, None] * left[None]
    return places


def _mean_and_worst(cell: Array, values: Array, cells: int) -> tuple[Array, Array]:
    count = np.bincount(cell, minlength=cells)
    mean = np.where(count > 0, np.bincount(cell, values, minlength=cells) / np.maximum(count, 1), np.nan)
    worst = np.full(cells, np.nan)
    order = np.argsort(np.abs(values), kind="stable")
    worst[cell[order]] = values[order]  # the last one written is the largest
    return mean, worst


def _reach_m(measured: Measured) -> float:
    """How far to a side strokes are shown: four times their usual half-width; without bound where no ink is seen."""
    samples = measured.samples
    area = samples.ink.flatten(1).sum(1).double().numpy() / samples.pixels_per_m.double().numpy() ** 2
    length = samples.path[..., 1:3].diff(dim=1).norm(dim=-1).sum(1).double().numpy()
    half = float(np.median(area / np.maximum(length, 1e-6))) / 2
    return _HALF_WIDTHS * half if half > 0 else np.inf


def _sides_m(measured: Measured) -> tuple[Array, Array]:
    valid = measured.samples.valid
    k = measured.samples.pixels_per_m.double().numpy()
    return valid.amax(1).sum(1).numpy() / k, valid.amax(2).sum(1).numpy() / k
