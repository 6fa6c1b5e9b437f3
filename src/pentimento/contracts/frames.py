"""Canvas, image and stroke frames, and the maps between them.

canvas frame: metres, right-handed, origin at the canvas's lower left corner, x right, y up, z out of
the canvas (z < 0 presses). An image covers a window `[x_min, y_min, x_max, y_max]` of it and its
row 0 is the top. Pixel coordinates are (column, row) floats, and the centre of the pixel in row r and
column c is exactly (c, r):  c = (x - x_min) k - 1/2,  r = (y_max - y) k - 1/2,  k pixels per metre.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from pentimento.contracts.errors import ContractError

FloatArray = npt.NDArray[np.float64]
Window = Sequence[float] | npt.NDArray[np.floating[Any]]

_ALIGNED_PX = 0.01  # windows come back from float32 columns: 1e-4 px off; a real misfit is larger

_ONE_SCALE = 0.01  # pixel sizes that differ by less are one


def check_window(window_m: Window) -> tuple[float, float, float, float]:
    """The window as four floats.

    Raises:
        ContractError: not four finite numbers with x_min < x_max and y_min < y_max.
    """
    values = [float(v) for v in window_m]
    if len(values) != 4 or not all(math.isfinite(v) for v in values):
        raise ContractError(f"Window {values} is not four finite numbers [x_min, y_min, x_max, y_max] in m.")
    x_min, y_min, x_max, y_max = values
    if not (x_min < x_max and y_min < y_max):
        raise ContractError(f"Window {values} is empty; its order is [x_min, y_min, x_max, y_max] in metres.")
    return x_min, y_min, x_max, y_max


def canvas_to_pixel(xy_m: npt.ArrayLike, window_m: Window, pixels_per_m: float) -> FloatArray:
    """Canvas points [..., 2] (x, y) in metres -> pixel coordinates [..., 2] (column, row)."""
    x_min, _, _, y_max = check_window(window_m)
    xy = np.asarray(xy_m, dtype=np.float64)
    column = (xy[..., 0] - x_min) * pixels_per_m - 0.5
    row = (y_max - xy[..., 1]) * pixels_per_m - 0.5
    return np.stack([column, row], axis=-1)


def pixel_to_canvas(column_row: npt.ArrayLike, window_m: Window, pixels_per_m: float) -> FloatArray:
    """Pixel coordinates [..., 2] (column, row) -> canvas points [..., 2] (x, y) in metres."""
    x_min, _, _, y_max = check_window(window_m)
    cr = np.asarray(column_row, dtype=np.float64)
    x = x_min + (cr[..., 0] + 0.5) / pixels_per_m
    y = y_max - (cr[..., 1] + 0.5) / pixels_per_m
    return np.stack([x, y], axis=-1)


def image_shape(window_m: Window, pixels_per_m: float) -> tuple[int, int]:
    """(height, width) in pixels of the image of a window, rounded to whole pixels.

    Raises:
        ContractError: bad window, or less than one pixel.
    """
    x_min, y_min, x_max, y_max = check_window(window_m)
    height, width = round((y_max - y_min) * pixels_per_m), round((x_max - x_min) * pixels_per_m)
    if height < 1 or width < 1:
        raise ContractError(
            f"Window {[x_min, y_min, x_max, y_max]} m at {pixels_per_m} pixels a metre is {height} x {width} "
            "pixels; use a larger window or a finer resolution (and check metres against millimetres)."
        )
    return height, width


def pixels_per_m(shape: Sequence[int], window_m: Window) -> float:
    """Pixels a metre of an image of `shape` (H, W, ...) that covers the window (mean of x and y).

    Raises:
        ContractError: bad window, or x and y disagree by more than 1 % beyond the rounding of the
            image to whole pixels.
    """
    x_min, y_min, x_max, y_max = check_window(window_m)
    height, width = int(shape[0]), int(shape[1])
    if height < 1 or width < 1:
        raise ContractError(f"An image of {height} x {width} pixels covers no window.")
    along_x, along_y = width / (x_max - x_min), height / (y_max - y_min)
    rounding = 0.5 / width + 0.5 / height
    if abs(along_x - along_y) > (0.01 + rounding) * max(along_x, along_y):
        raise ContractError(
            f"An image of {height} x {width} pixels (H x W) over the window {[x_min, y_min, x_max, y_max]} m "
            f"has {along_x:.0f} pixels a metre along x and {along_y:.0f} along y; pixels must be square."
        )
    return (along_x + along_y) / 2


def coarsening(scales: npt.ArrayLike, pixels_per_m: float) -> npt.NDArray[np.int64]:
    """Whole factors [B], at least 1, by which images are averaged down to about ``pixels_per_m``.

    Images whose own pixels a metre (`scales` [B], NaN where unknown) agree within 1 % have one factor: windows are
    stored in single precision, whose rounding must not decide for each image.
    """
    given = np.asarray(scales, dtype=np.float64)
    factors = np.ones(given.shape, dtype=np.int64)
    order = np.argsort(given)[: int(np.isfinite(given).sum())]
    starts = np.flatnonzero(np.diff(given[order]) > _ONE_SCALE * given[order][1:]) + 1
    for alike in np.split(order, starts):
        if len(alike):
            ratio = round(float(np.median(given[alike])) / pixels_per_m, 3)
            factors[alike] = max(math.floor(ratio + 0.5), 1)
    return factors


def _rotated(xy: FloatArray, theta_rad: float) -> FloatArray:
    cos, sin = math.cos(theta_rad), math.sin(theta_rad)
    x, y = xy[..., 0], xy[..., 1]
    return np.stack([cos * x - sin * y, sin * x + cos * y], axis=-1)


def stroke_to_canvas(points: npt.ArrayLike, x_m: float, y_m: float, theta_rad: float) -> FloatArray:
    """Move points from the stroke's frame (origin at its start, +x along `theta_rad`) to the canvas.

    `points` [..., >=2] has x and y in its first two components; the others are returned unchanged (a
    full path is (t, x, y, z, yaw): pass `path[:, 1:]` and add `theta_rad` to its yaw).
    """
    moved = np.array(points, dtype=np.float64)
    moved[..., :2] = _rotated(moved[..., :2], theta_rad) + np.array([x_m, y_m])
    return moved


def canvas_to_stroke(points: npt.ArrayLike, x_m: float, y_m: float, theta_rad: float) -> FloatArray:
    """The inverse of `stroke_to_canvas`."""
    moved = np.array(points, dtype=np.float64)
    moved[..., :2] = _rotated(moved[..., :2] - np.array([x_m, y_m]), -theta_rad)
    return moved


def window_around(path: npt.ArrayLike, margin_m: float) -> FloatArray:
    """The bounding window [4] of a path [N, 5] (t, x, y, z, yaw), grown by `margin_m` on every side."""
    xy = np.asarray(path, dtype=np.float64)[:, 1:3]
    if len(xy) == 0 or not np.isfinite(xy).all():
        raise ContractError("There is no window around a path that is empty or has a NaN position.")
    return np.concatenate([xy.min(axis=0) - margin_m, xy.max(axis=0) + margin_m])


def snap_window(window_m: Window, image_window_m: Window, shape: Sequence[int]) -> FloatArray:
    """The smallest window [4] of whole pixels of an image that contains `window_m`, cut at the image's edge.

    `shape` (H, W, ...) and `image_window_m` are the image's.

    Raises:
        ContractError: the two windows do not overlap.
    """
    height, width = shape[0], shape[1]
    left, top, right, bottom = _edges_px(window_m, image_window_m, shape)
    first_column, first_row = max(0, math.floor(left + _ALIGNED_PX)), max(0, math.floor(top + _ALIGNED_PX))
    end_column, end_row = (
        min(width, math.ceil(right - _ALIGNED_PX)),
        min(height, math.ceil(bottom - _ALIGNED_PX)),
    )
    if first_column >= end_column or first_row >= end_row:
        raise ContractError(
            f"Window {_listed(window_m)} m does not overlap the image's window {_listed(image_window_m)} m; "
            "check that both are in the canvas frame."
        )
    x_min, y_min, x_max, y_max = check_window(image_window_m)
    pixel_x_m, pixel_y_m = (x_max - x_min) / width, (y_max - y_min) / height
    return np.array(
        [
            x_min + first_column * pixel_x_m,
            y_max - end_row * pixel_y_m,
            x_min + end_column * pixel_x_m,
            y_max - first_row * pixel_y_m,
        ]
    )


def crop(image: npt.NDArray[Any], image_window_m: Window, window_m: Window) -> npt.NDArray[Any]:
    """The part of an image [H, W, ...] of `image_window_m` that shows `window_m`; a view, no resampling.

    Raises:
        ContractError: the window reaches beyond the image or is not aligned with its pixels
            (`snap_window` makes one that is).
    """
    edges = _edges_px(window_m, image_window_m, image.shape)
    left, top, right, bottom = (round(edge) for edge in edges)
    if max(abs(edge - round(edge)) for edge in edges) > _ALIGNED_PX:
        raise ContractError(
            f"Window {list(window_m)} m is not aligned with the pixels of the image over "
            f"{list(image_window_m)} m; pass it through snap_window first."
        )
    if left < 0 or top < 0 or right > image.shape[1] or bottom > image.shape[0]:
        raise ContractError(
            f"Window {list(window_m)} m reaches beyond the image's window {list(image_window_m)} m; "
            "pass it through snap_window first."
        )
    return image[top:bottom, left:right]


def _listed(window_m: Window) -> list[float]:
    """The window for a sentence, to a micrometre."""
    return [round(float(value), 6) for value in window_m]


def _edges_px(window_m: Window, image_window_m: Window, shape: Sequence[int]) -> tuple[float, ...]:
    """left, top, right, bottom of a window in pixel edges of an image (0 = the image's first edge).

    Each axis has its own scale, so that the image's own edges are whole numbers even where its window
    is not a whole number of pixels.
    """
    pixels_per_m(shape, image_window_m)  # square within 1 %, or an error
    x_min, y_min, x_max, y_max = check_window(image_window_m)
    left, low, right, high = check_window(window_m)
    along_x, along_y = shape[1] / (x_max - x_min), shape[0] / (y_max - y_min)
    return (
        (left - x_min) * along_x,
        (y_max - high) * along_y,
        (right - x_min) * along_x,
        (y_max - low) * along_y,
    )
