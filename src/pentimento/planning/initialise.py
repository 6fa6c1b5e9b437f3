"""Where strokes start: at random (thesis 4.3.5), or where the picture still differs from the target."""

from __future__ import annotations

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from pentimento.planning.strokes import StrokeTensors
from pentimento.robots.tools import Tool

FloatArray = NDArray[np.float64]


def random_strokes(
    count: int, tool: Tool, canvas_size_m: tuple[float, float], rng: np.random.Generator
) -> StrokeTensors:
    """Uniform over place, heading, shape, press and colour."""
    return _strokes(
        rng.uniform((0, 0), canvas_size_m, (count, 2)),
        rng.uniform(-np.pi, np.pi, count),
        rng.uniform(*tool.stroke_length_m, count),
        rng.uniform(*tool.press_range_m, count),
        rng.uniform(0, 1, (count, 3)),
    )


def error_guided_strokes(
    count: int,
    tool: Tool,
    canvas_size_m: tuple[float, float],
    image: FloatArray,
    target: FloatArray,
    size: float,
    rng: np.random.Generator,
) -> StrokeTensors:
    """Strokes laid where ``image`` differs most from ``target``, along the target's edges, in its colours.

    Args:
        image, target: [H, W, 3], linear light, of the whole canvas.
        size: 0 for the tool's shortest, lightest strokes, 1 for its longest and fullest.
    """
    width = target.shape[1]
    px_per_m = width / canvas_size_m[0]
    wide_px = max(tool.nominal_width_m * px_per_m, 1.0)
    tone = np.asarray(cv2.GaussianBlur(target, (0, 0), wide_px / 4), dtype=np.float64)
    error = np.abs(np.sqrt(cv2.GaussianBlur(image, (0, 0), wide_px / 4)) - np.sqrt(tone)).mean(-1) ** 2
    along = _edge_heading(np.sqrt(tone), wide_px)
    length: float = tool.stroke_length_m[0] + size * (tool.stroke_length_m[1] - tool.stroke_length_m[0]) * 0.7
    press = tool.press_range_m[0] + size * (tool.press_range_m[1] - tool.press_range_m[0]) * 0.8
    rows, columns = _places(error, count, np.sqrt(length * px_per_m * wide_px) / 2, rng)
    middle = np.stack([(columns + 0.5) / px_per_m, canvas_size_m[1] - (rows + 0.5) / px_per_m], axis=1)
    return _strokes(
        middle,
        along[rows, columns] + rng.normal(0, 0.1, count),
        length * rng.uniform(0.8, 1.2, size=count),
        np.full(count, press),
        tone[rows, columns],
    )


def _places(
    error: FloatArray, count: int, apart_px: float, rng: np.random.Generator
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Rows and columns drawn in proportion to the error, each place taken lowering the error around it."""
    left = error + 1e-4 * error.mean() + 1e-12
    height, width = error.shape
    grid_r, grid_c = np.mgrid[:height, :width]
    rows, columns = np.empty(count, np.int64), np.empty(count, np.int64)
    reach = int(3 * apart_px) + 1
    for i in range(count):
        total = np.cumsum(left)
        at = min(int(np.searchsorted(total, rng.uniform(0, total[-1]))), left.size - 1)
        r, c = divmod(at, width)
        rows[i], columns[i] = r, c
        near = np.s_[max(r - reach, 0) : r + reach + 1, max(c - reach, 0) : c + reach + 1]
        distance2 = (grid_r[near] - r) ** 2 + (grid_c[near] - c) ** 2
        left[near] *= 1 - 0.9 * np.exp(-distance2 / (2 * apart_px**2))
    return rows, columns


def _edge_heading(tone: FloatArray, scale_px: float) -> FloatArray:
    """[H, W] heading along the strongest edges nearby, canvas frame (y up), from the structure tensor."""
    grey = tone.mean(-1)
    right, down = cv2.Sobel(grey, cv2.CV_64F, 1, 0), cv2.Sobel(grey, cv2.CV_64F, 0, 1)
    xx, yy, xy = (cv2.GaussianBlur(p, (0, 0), scale_px) for p in (right * right, down * down, right * down))
    steepest = 0.5 * np.arctan2(2 * xy, xx - yy)
    return -(steepest + np.pi / 2)


def _strokes(
    middle_m: FloatArray, theta_rad: FloatArray, length_m: FloatArray, press_m: FloatArray, color: FloatArray
) -> StrokeTensors:
    def leaf(array: FloatArray) -> torch.Tensor:
        return torch.tensor(array, dtype=torch.float32)

    return StrokeTensors(
        leaf(middle_m),
        leaf(theta_rad),
        leaf(length_m),
        torch.zeros(len(theta_rad)),
        leaf(np.repeat(press_m[:, None], 3, axis=1)),
        leaf(color),
    )
