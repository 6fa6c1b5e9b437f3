"""Vertices and triangles of mesh files: STL (binary, text), PLY (binary, text) and Wavefront OBJ."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pentimento.goals3d.obj_file import read_obj
from pentimento.goals3d.ply_file import read_ply
from pentimento.planning.pushes.goal import GoalError

FloatArray = NDArray[np.float64]
MESHES = (".stl", ".obj", ".ply")
"""Suffixes of mesh files."""
MAX_BYTES = 2**29
"""Larger files are refused: a goal has as many places as a scan has pixels, and a tenth of this shows them all."""
_HEADER_BYTES = 80
_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def read_mesh(path: Path) -> tuple[FloatArray, NDArray[np.int64]]:
    """Vertices [V, 3] and triangles [T, 3] of a file, at least one.

    Raises:
        GoalError: unreadable, too large, or without faces.
    """
    try:
        size = path.stat().st_size
        if size > MAX_BYTES:
            raise GoalError(
                f"{path} has {size / 1e6:.0f} MB and a goal at most {MAX_BYTES / 1e6:.0f}; reduce it to "
                "a few hundred thousand faces, which are finer than any tool."
            )
        read = {".stl": _read_stl, ".ply": read_ply, ".obj": read_obj}[path.suffix.lower()]
        vertices, faces = read(path)
        if faces.size and not 0 <= faces.min() <= faces.max() < len(vertices):
            raise ValueError("a face has a corner that is no vertex; the file may be cut off")
    except (OSError, ValueError, LookupError, MemoryError, OverflowError) as error:
        reason = " ".join(str(error).split()).rstrip(".")
        raise GoalError(f"{path} cannot be read as a mesh ({reason}); export it again as STL, OBJ or PLY.") from error
    if faces.size == 0:
        raise GoalError(
            f"{path} has no faces; a mesh to sculpt needs triangles (a point cloud is another kind of file)."
        )
    return vertices, faces


def _read_stl(path: Path) -> tuple[FloatArray, NDArray[np.int64]]:
    """Raises OSError, ValueError."""
    data = path.read_bytes()
    facets = len(data) - _HEADER_BYTES - 4
    count = int.from_bytes(data[_HEADER_BYTES : _HEADER_BYTES + 4], "little")
    if facets >= 0 and facets == count * _FACET.itemsize:
        corners = np.frombuffer(data, _FACET, count, _HEADER_BYTES + 4)["corners"].reshape(-1, 3)
    elif data.lstrip()[:5].lower() == b"solid" and b"facet" in data:
        rows = [line.split() for line in data.decode("utf-8", "replace").splitlines() if line.strip()]
        numbers = [[float(word) for word in row[1:4]] for row in rows if row[:1] == ["vertex"]]
        if any(len(row) != 3 for row in numbers) or len(numbers) % 3:
            raise ValueError("a facet has not three corners of three numbers; the file may be cut off")
        if not any(row[:1] == ["endsolid"] for row in rows[-3:]):
            raise ValueError("it does not end with 'endsolid'; it is cut off")
        corners = np.array(numbers).reshape(-1, 3)
    else:
        raise ValueError(
            f"it is neither a text STL nor a binary one: {count} facets are announced and {max(facets, 0)} bytes follow"
        )
    return corners.astype(np.float64), np.arange(len(corners)).reshape(-1, 3)
