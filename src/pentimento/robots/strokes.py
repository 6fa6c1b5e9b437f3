"""The Bézier stroke, the robot's action (thesis 4.3.1): a shape in the stroke's own frame and a pose on the canvas.

In the stroke's frame the tip goes from (−l/2, 0) to (l/2, 0) on a cubic Bézier curve whose two inner control points lie
``bend`` to the left; the press depth follows a quadratic one through depths at start, middle and end. The pose is that
of the curve's middle, so that turning a stroke does not swing it about its end.

The curves are linear in these parameters. The matrices are here, so that the planner differentiates the same stroke.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def shape_basis(points: int) -> tuple[FloatArray, FloatArray]:
    """[N], [N]: along = length · first, across = bend · second, for a Bézier stroke of ``points`` points."""
    t = np.linspace(0.0, 1.0, points)
    # Inner control points at thirds make the curve linear in x; both at height `bend` give 3t(1−t).
    return t - 0.5, 3 * t * (1 - t)


def press_basis(points: int) -> FloatArray:
    """[N, 3]: press depth = basis @ (start, middle, end)."""
    t = np.linspace(0.0, 1.0, points)
    return np.stack([(1 - t) ** 2, 2 * t * (1 - t), t**2], axis=1)


def stroke_points(
    middle_m: FloatArray,
    theta_rad: float,
    length_m: float,
    *,
    bend_m: float,
    press_m: FloatArray,
    yaw_rad: float,
    points: int,
) -> FloatArray:
    """A stroke's points, float64[N, 4]: x_m, y_m, z_m, yaw_rad in the canvas frame.

    Args:
        middle_m: [2], the middle of the line between the stroke's ends.
        theta_rad: heading from start to end.
        bend_m: height of the inner control points, left of the heading positive; the curve reaches ¾ of it.
        press_m: [3], press depth at start, middle and end, positive into the canvas.
        yaw_rad: of a flat tool's broad edge against the canvas's x axis.
    """
    along, across = shape_basis(points)
    along, across = along * length_m, across * bend_m
    cos, sin = np.cos(theta_rad), np.sin(theta_rad)
    x = middle_m[0] + cos * along - sin * across
    y = middle_m[1] + sin * along + cos * across
    return np.stack([x, y, -press_basis(points) @ press_m, np.full(points, yaw_rad)], axis=1)
