"""Vertices and triangles of a Wavefront OBJ file: polygons of any shape, indices from the start or from the end."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def read_obj(path: Path) -> tuple[FloatArray, NDArray[np.int64]]:
    """Vertices [V, 3] and triangles [T, 3] of all objects in the file; textures, normals and lines are passed over.

    Raises:
        OSError: the file cannot be opened.
        ValueError: a line is broken; the message names its number.
    """
    vertices: list[list[float]] = []
    polygons: list[list[int]] = []
    text = path.read_text(encoding="utf-8-sig", errors="replace").replace("\\\n", " ").replace("\\\r\n", " ")
    for number, line in enumerate(text.splitlines(), 1):
        words = line.partition("#")[0].split()
        if not words or words[0] not in ("v", "f"):
            continue
        try:
            if words[0] == "v":
                x, y, z = (float(word) for word in words[1:4])  # a weight or a colour may follow
                vertices.append([x, y, z])
            else:
                polygons.append([_index(word.partition("/")[0], len(vertices)) for word in words[1:]])
        except ValueError as error:
            raise ValueError(f"line {number}, {line[:60]!r}, is broken") from error
        if words[0] == "f" and len(words) < 4:
            raise ValueError(f"line {number}, {line[:60]!r}, is a face of less than three corners")
    points = np.array(vertices, dtype=np.float64).reshape(-1, 3)
    if any(max(polygon) >= len(points) for polygon in polygons):
        raise ValueError("a face has a corner that is no vertex; the file may be cut off")
    triangles = [triangle for polygon in polygons for triangle in triangulated(points, polygon)]
    return points, np.array(triangles, dtype=np.int64).reshape(-1, 3)


def _index(word: str, known: int) -> int:
    """From 0. Negative numbers count back from the last vertex before the face."""
    number = int(word)
    index = number - 1 if number > 0 else known + number
    if number == 0 or index < 0:
        raise ValueError("no vertex")
    return index


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
