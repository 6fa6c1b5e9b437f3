"""Reliefs from meshes (STL, OBJ, PLY): what lies on top, seen straight from above."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numba
import numpy as np
from numpy.typing import NDArray

from pentimento.planning.pushes.goal import GoalError

FloatArray = NDArray[np.float64]

_MIN_PROPORTION = 1e-3


def mesh_relief(path: Path, side_px: int, up: Literal["x", "y", "z"] = "z") -> FloatArray:
    """The highest point of a mesh in each pixel [h, w], its longer side ``side_px``; the lowest where there is none.

    Args:
        up: the axis of the file that points up; the other two lie right and up in the picture, in cyclic order.

    Raises:
        GoalError: unreadable, without faces, vertices that are no numbers, or no extent from above.
    """
    import trimesh

    try:
        mesh = trimesh.load_mesh(path)
    except (OSError, ValueError, LookupError, ArithmeticError, AttributeError, TypeError) as error:
        reason = " ".join(str(error).split()).rstrip(".")
        raise GoalError(f"{path} cannot be read as a mesh ({reason}); export it again as STL, OBJ or PLY.") from error
    faces, vertices = np.asarray(mesh.faces), np.asarray(mesh.vertices, dtype=np.float64)
    if faces.size == 0:
        raise GoalError(
            f"{path} has no faces; a mesh to sculpt needs triangles (a point cloud is another kind of file)."
        )
    if vertices.ndim != 2 or vertices.shape[1] != 3 or faces.max() >= len(vertices):
        raise GoalError(f"{path} has vertices without three coordinates, or faces without vertices; repair the mesh.")
    if not np.isfinite(vertices).all():
        raise GoalError(f"{path} has vertices that are not finite numbers; repair the mesh.")
    axis = "xyz".index(up)
    return top_of(vertices[:, [(axis + 1) % 3, (axis + 2) % 3, axis]][faces], side_px)


def top_of(triangles: FloatArray, side_px: int) -> FloatArray:
    """The z-buffer [h, w] of triangles [T, 3, 3] (x right, y up, z towards the eye), orthographic.

    Raises:
        GoalError: seen from above, the triangles are a line or a point.
    """
    low, high = triangles[..., :2].min(axis=(0, 1)), triangles[..., :2].max(axis=(0, 1))
    extent = high - low
    if not extent.min() > _MIN_PROPORTION * extent.max():
        raise GoalError(
            f"Seen from above, the mesh measures {extent[0]:g} by {extent[1]:g}; turn it so that it shows a face."
        )
    k = side_px / extent.max()
    width, height = (max(round(side), 2) for side in k * extent)
    pixels = triangles.copy()
    pixels[..., 0] = (triangles[..., 0] - low[0]) * k - 0.5
    pixels[..., 1] = (high[1] - triangles[..., 1]) * k - 0.5
    top = np.full((height, width), -np.inf)
    _rasterise(pixels, top)
    return np.where(np.isfinite(top), top, triangles[..., 2].min())


@numba.njit(cache=True)
def _rasterise(triangles, top):  # type: ignore[no-untyped-def]  # pragma: no cover
    """Raise each pixel of ``top`` to the triangles [T, 3, 3] (column, row, z) that cover its centre."""
    height, width = top.shape
    for t in range(len(triangles)):
        (ax, ay, az), (bx, by, bz), (cx, cy, cz) = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if area == 0.0:  # seen edge-on
            continue
        for row in range(max(int(np.ceil(min(ay, by, cy))), 0), min(int(np.floor(max(ay, by, cy))), height - 1) + 1):
            first, last = max(int(np.ceil(min(ax, bx, cx))), 0), min(int(np.floor(max(ax, bx, cx))), width - 1)
            for column in range(first, last + 1):
                b = ((column - ax) * (cy - ay) - (row - ay) * (cx - ax)) / area
                c = ((bx - ax) * (row - ay) - (by - ay) * (column - ax)) / area
                if b >= -1e-9 and c >= -1e-9 and b + c <= 1 + 1e-9:
                    top[row, column] = max(top[row, column], az + b * (bz - az) + c * (cz - az))
