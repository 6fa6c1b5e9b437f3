"""Polygons of any shape as triangles."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def triangulated(points: FloatArray, polygon: list[int]) -> list[list[int]]:
    """Triangles of a simple polygon, convex or not, whose corners are indices of ``points`` [V, 3] (ear clipping)."""
    if len(polygon) == 3:
        return [polygon]
    corners = points[polygon]
    after = np.roll(corners, -1, axis=0)
    normal = np.cross(corners - corners[0], after - corners[0]).sum(axis=0)
    axis = int(np.abs(normal).argmax())
    flat = np.delete(corners, axis, axis=1) if axis != 1 else corners[:, [2, 0]]
    if normal[axis] < 0:
        flat = flat[:, ::-1]  # so that the corners run counter-clockwise
    left, triangles = list(range(len(polygon))), []
    while len(left) > 3:
        # A polygon that is not simple may have no ear; its first corner is cut.
        ear = next((at for at in range(len(left)) if _is_ear(flat, left, at)), 0)
        triangles.append([polygon[left[ear - 1]], polygon[left[ear]], polygon[left[(ear + 1) % len(left)]]])
        del left[ear]
    return [*triangles, [polygon[corner] for corner in left]]


def _is_ear(flat: FloatArray, left: list[int], at: int) -> bool:
    """Whether the corner at this place is convex and its triangle holds no other corner."""
    here = (left[at - 1], left[at], left[(at + 1) % len(left)])
    a, b, c = flat[list(here)]
    if _turn(a, b, c) <= 0:
        return False
    others = flat[[corner for corner in left if corner not in here]]
    inside = (_turn(a, b, others) > 0) & (_turn(b, c, others) > 0) & (_turn(c, a, others) > 0)
    return not bool(np.any(inside))


def _turn(a: FloatArray, b: FloatArray, c: FloatArray) -> FloatArray:
    """Twice the signed area of a, b, c [..., 2]."""
    return np.asarray((b[0] - a[0]) * (c[..., 1] - a[1]) - (b[1] - a[1]) * (c[..., 0] - a[0]))
