"""A recorded stroke, and its standard frame (thesis 5.3.2): from the origin to an end on the positive x axis.

The standard frame removes place and heading, so that few demonstrations show a handwriting style.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.errors import ContractError

FloatArray = NDArray[np.float64]

T: Final = 0
XY: Final = slice(1, 3)
Z: Final = 3
PRESSURE: Final = 4


@dataclass(frozen=True, eq=False)
class Recording:
    """One stroke, from touch-down to lift-off of the pen, before any repair."""

    session: str
    """One uninterrupted recording."""
    hand: str
    """Identifier of the writer."""
    points: FloatArray
    """[K, 5] t_s, x_m, y_m (up), z_m (height of the tip over the paper), pressure in 0..1. NaN in t, z or pressure: not
    recorded. NaN in x or y: the tracker lost the pen."""


def recording(
    session: str,
    hand: str,
    xy_m: FloatArray,
    *,
    t_s: FloatArray | None = None,
    z_m: FloatArray | None = None,
    pressure: FloatArray | None = None,
) -> Recording:
    """A recording of these columns, ``xy_m`` [K, 2] and the others [K]. None: not recorded."""
    points = np.full((len(xy_m), 5), np.nan)
    points[:, XY] = xy_m
    for column, values in ((T, t_s), (Z, z_m), (PRESSURE, pressure)):
        if values is not None:
            points[:, column] = values
    return Recording(session, hand, points)


_SPEEDS_M_S: Final = (1e-3, 10.0)
"""Of a person's strokes, as the median of a file. Milliseconds taken for seconds give a thousandth, and the reverse."""


def plausible(path: Path, strokes: list[Recording]) -> list[Recording]:
    """The strokes of a file, if there are any and a person can have drawn them at these speeds.

    Raises:
        ContractError: there is none, or times or lengths are in another unit than the file or its settings say.
    """
    if not strokes:
        raise ContractError(
            f"{path} holds no stroke; for motion capture, see that pen and canvas are named and contact_m is right."
        )
    speed = _median_speed_m_s(strokes)
    if speed is not None and not _SPEEDS_M_S[0] < speed < _SPEEDS_M_S[1]:
        raise ContractError(
            f"{path}: by its times, strokes are drawn at {1e3 * speed:.3g} mm/s (median), as no person draws; "
            "see that times are in seconds (of Quick, Draw! in milliseconds) and lengths in their unit."
        )
    return strokes


def _median_speed_m_s(strokes: list[Recording]) -> float | None:
    """None where no stroke has times."""
    speeds = []
    for stroke in strokes:
        known = stroke.points[np.isfinite(stroke.points[:, :3]).all(axis=1)]
        if len(known) > 1 and (duration_s := float(np.ptp(known[:, T]))) > 0:
            speeds.append(float(np.linalg.norm(np.diff(known[:, XY], axis=0), axis=1).sum()) / duration_s)
    moving = [speed for speed in speeds if speed > 0]
    return float(np.median(moving)) if moving else None


_CLOSED = 1e-9
"""Distance of first and last point, m, up to which a stroke is closed."""


def standardise(points: FloatArray, count: int) -> tuple[FloatArray, FloatArray]:
    """A stroke as ``count`` points at equal arc length in the standard frame, and the pose of that frame.

    Args:
        points: [K, 5] t_s, x_m, y_m, z_m, pressure. Unknown columns (NaN) stay unknown.

    Returns:
        The points [count, 5], and the pose x_m, y_m, theta_rad [3] of the standard frame in the source frame. A closed
        stroke keeps its heading.

    Raises:
        ContractError: the stroke has fewer than two distinct places, or ``count`` is below 2.
    """
    even = resample(points, count)
    chord = even[-1, XY] - even[0, XY]
    theta = 0.0 if np.hypot(*chord) < _CLOSED else float(np.arctan2(chord[1], chord[0]))
    transform = np.array([*even[0, XY], theta])
    return np.column_stack([even[:, 0], turned(even[:, XY] - even[0, XY], -theta), even[:, 3:]]), transform


def to_source(points: FloatArray, transform: FloatArray) -> FloatArray:
    """Points [N, 5] of the standard frame in the source frame."""
    placed = turned(points[:, XY], float(transform[2])) + transform[:2]
    return np.column_stack([points[:, 0], placed, points[:, 3:]])


def resample(points: FloatArray, count: int) -> FloatArray:
    """``points`` [K, 5] resampled to ``count`` points at equal arc length in x and y.

    Raises:
        ContractError: the stroke has fewer than two distinct places, or ``count`` is below 2.
    """
    if count < 2:
        raise ContractError(f"A stroke of {count} points has no direction; ask for two or more.")
    step = np.linalg.norm(np.diff(points[:, XY], axis=0), axis=1)
    moved = np.append(True, step > 0)
    along = np.append(0.0, np.cumsum(step))[moved]
    if len(along) < 2:
        raise ContractError("A stroke that stays at one place cannot be resampled; remove it first.")
    at = np.linspace(0.0, along[-1], count)
    return np.column_stack([np.interp(at, along, column) for column in points[moved].T])


def turned(xy: FloatArray, theta_rad: float) -> FloatArray:
    """Places [K, 2], rotated counterclockwise about the origin."""
    cos, sin = np.cos(theta_rad), np.sin(theta_rad)
    return xy @ np.array([[cos, sin], [-sin, cos]])
