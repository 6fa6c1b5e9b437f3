"""The interface of a scanner that looks at a slab, and the way from what it measures to a height map.

A driver of a scanner measures points, or a depth picture; the functions here do the rest. See docs/writing_a_driver.md.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.errors import PentimentoError
from pentimento.contracts.frames import Window, canvas_to_pixel, check_window, pixel_to_canvas, pixels_per_m
from pentimento.contracts.observations import Scan
from pentimento.robots.rig import rotation_of

FloatArray = NDArray[np.float64]

MIN_SEEN: Final = 0.5
"""Minimum share of a slab's height map that a scan has measured."""


class ScannerError(PentimentoError):
    """The scanner gave no height map that can be used."""


class Scanner(Protocol):
    """A scanner that sees a whole slab. The robot takes its tool out of the view before each scan."""

    def scan(self) -> Scan:
        """The slab as it is now; ``t_s`` may be NaN, the robot sets it. Raises ScannerError."""
        ...

    def close(self) -> None:
        """Let go of the device."""
        ...


@dataclass(frozen=True)
class Pose:
    """Of a scanner, in the canvas frame."""

    origin_m: tuple[float, float, float]
    turn_rad: tuple[float, float, float]
    """Roll, pitch, yaw: R = Rz(yaw) Ry(pitch) Rx(roll). A camera that looks straight down, its picture's right along
    the canvas's x, has a roll of 180 degrees."""


@dataclass(frozen=True)
class DepthCamera:
    """A pinhole camera without distortion. Its frame: x to the picture's right, y down, z along the view."""

    focal_px: tuple[float, float]
    centre_px: tuple[float, float]
    """Column and row of the optical axis; the centre of the pixel in row r and column c is (c, r)."""
    to_canvas: Pose


def depth_points(depth_m: FloatArray, camera: DepthCamera) -> FloatArray:
    """Points [N, 3] of the canvas frame of a depth picture [H, W]: metres along the view, NaN = hole."""
    rows, columns = np.nonzero(np.isfinite(depth_m))
    depth = depth_m[rows, columns]
    x = (columns - camera.centre_px[0]) / camera.focal_px[0] * depth
    y = (rows - camera.centre_px[1]) / camera.focal_px[1] * depth
    turn = rotation_of(*camera.to_canvas.turn_rad)
    return np.column_stack([x, y, depth]) @ turn.T + np.array(camera.to_canvas.origin_m)


def height_points(height_m: FloatArray, window_m: Window) -> FloatArray:
    """Points [N, 3] of the canvas frame of heights [H, W] over a window, row 0 at the top, NaN = hole.

    Raises:
        ContractError: pixels that are not square.
    """
    rows, columns = np.nonzero(np.isfinite(height_m))
    places = pixel_to_canvas(np.column_stack([columns, rows]), window_m, pixels_per_m(height_m.shape, window_m))
    return np.column_stack([places, height_m[rows, columns]])


def scan_of_points(points_m: FloatArray, area_m: tuple[float, float], shape: tuple[int, int], scanner_id: str) -> Scan:
    """The scan of a slab: each pixel is the mean height of the points in it, and a hole where there is none.

    Args:
        points_m: [N, 3], canvas frame, z above the table; points beside the slab are left out.
        area_m: width and height of the slab.
        shape: [H, W] of the height map.

    Raises:
        ScannerError: more than half of the height map are holes.
    """
    window = (0.0, 0.0, *area_m)
    column_row = np.rint(canvas_to_pixel(points_m[:, :2], window, pixels_per_m(shape, window))).astype(np.int64)
    inside = ((column_row >= 0) & (column_row < (shape[1], shape[0]))).all(axis=1)
    cells = column_row[inside, 1] * shape[1] + column_row[inside, 0]
    counts = np.bincount(cells, minlength=shape[0] * shape[1])
    sums = np.bincount(cells, points_m[inside, 2], minlength=shape[0] * shape[1])
    seen = float((counts > 0).mean())
    if seen < MIN_SEEN:
        raise ScannerError(
            f"The scan shows {100 * seen:.0f} % of the {shape[1]} x {shape[0]} pixels of the slab of {area_m[0]:g} by "
            f"{area_m[1]:g} m, and at least {100 * MIN_SEEN:.0f} % are needed; check the scanner's place and what "
            "hides the slab, or scan with fewer pixels."
        )
    height = np.where(counts > 0, sums / np.maximum(counts, 1), np.nan).reshape(shape)
    return Scan(height, np.array(check_window(window)), np.full(3, np.nan), scanner_id, math.nan)
