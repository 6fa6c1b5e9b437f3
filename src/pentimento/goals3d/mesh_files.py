"""Vertices and triangles of mesh files: STL (binary, text), PLY (binary, text) and Wavefront OBJ."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pentimento.goals3d.obj_file import read_obj, triangulated
from pentimento.planning.pushes.goal import GoalError

FloatArray = NDArray[np.float64]
MESHES = (".stl", ".obj", ".ply")
"""Suffixes of mesh files."""
MAX_BYTES = 2**29
"""Larger files are refused: a goal has as many places as a scan has pixels, and a tenth of this shows them all."""
_HEADER_BYTES = 80
_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_NUMBERS = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2",
    "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4",
    "double": "f8", "float64": "f8",
}  # fmt: skip
"""PLY's types."""
_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">", "ascii": "="}


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
        read = {".stl": _read_stl, ".ply": _read_ply, ".obj": read_obj}[path.suffix.lower()]
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
        rows = [line.split() for line in data.decode("utf-8", "replace").splitlines()]
        numbers = [[float(word) for word in row[1:4]] for row in rows if row[:1] == ["vertex"]]
        if any(len(row) != 3 for row in numbers) or len(numbers) % 3:
            raise ValueError("a facet has not three corners of three numbers; the file may be cut off")
        corners = np.array(numbers).reshape(-1, 3)
    else:
        raise ValueError(
            f"it is neither a text STL nor a binary one: {count} facets are announced and {max(facets, 0)} bytes follow"
        )
    return corners.astype(np.float64), np.arange(len(corners)).reshape(-1, 3)


def _read_ply(path: Path) -> tuple[FloatArray, NDArray[np.int64]]:
    """Raises OSError, ValueError, LookupError."""
    data = path.read_bytes()
    end = data.find(b"end_header")
    if not data.startswith(b"ply") or end < 0:
        raise ValueError("it has no PLY header")
    words = [line.split() for line in data[:end].decode("ascii", "replace").splitlines()]
    order = _ORDERS[next(row[1] for row in words if row[:1] == ["format"])]
    body = data[data.index(b"\n", end) + 1 :]
    numbers = _TextNumbers(body) if order == "=" else _BinaryNumbers(body, order)
    vertices, faces = np.zeros((0, 3)), np.zeros((0, 3), np.int64)
    for name, count, properties in _elements(words):
        if name == "vertex" and not any(kind.startswith("list") for kind in properties.values()):
            columns = numbers.table(count, properties)
            vertices = np.stack([columns[axis] for axis in "xyz"], axis=1).astype(np.float64)
        else:
            triangles = numbers.triangles(count, properties) if name == "face" else None
            if triangles is not None:
                faces = triangles
                continue
            lists = [numbers.row(properties) for _ in range(count)]
            if name == "face":
                polygons = [row.get("vertex_indices", row.get("vertex_index", [])) for row in lists]
                if any(len(p) < 3 or not 0 <= min(p) <= max(p) < len(vertices) for p in polygons):
                    raise ValueError("a face has a corner that is no vertex; the file may be cut off")
                parts = [part for polygon in polygons for part in triangulated(vertices, polygon)]
                faces = np.array(parts, np.int64).reshape(-1, 3)
    return vertices, faces


def _elements(words: list[list[str]]) -> list[tuple[str, int, dict[str, str]]]:
    """Name, count and properties (by name, the type, or ``list <count type> <type>``) of each element of a header."""
    elements: list[tuple[str, int, dict[str, str]]] = []
    for row in words:
        if row[:1] == ["element"]:
            elements.append((row[1], int(row[2]), {}))
        elif row[:1] == ["property"]:
            elements[-1][2][row[-1]] = " ".join(row[1:-1])
    return elements


class _TextNumbers:
    """Numbers of a PLY in text."""

    def __init__(self, body: bytes) -> None:
        self._words = body.split()
        self._at = 0

    def table(self, count: int, properties: dict[str, str]) -> dict[str, FloatArray]:
        """Columns [count] of an element without lists."""
        size = count * len(properties)
        values = np.array(self._words[self._at : self._at + size], dtype=np.float64).reshape(count, len(properties))
        self._at += size
        return dict(zip(properties, values.T, strict=True))

    def triangles(self, count: int, properties: dict[str, str]) -> NDArray[np.int64] | None:
        """Triangles [count, 3], where the faces are lists of three corners and nothing else; else None."""
        words = self._words[self._at : self._at + 4 * count]
        if len(properties) != 1 or len(words) != 4 * count or any(word != b"3" for word in words[::4]):
            return None
        self._at += 4 * count
        return np.array(words).reshape(count, 4)[:, 1:].astype(np.int64)

    def row(self, properties: dict[str, str]) -> dict[str, list[int]]:
        """Lists of one row of an element; other properties are passed over."""
        lists = {}
        for name, kind in properties.items():
            count = int(self._next(1)[0]) if kind.startswith("list") else 1
            lists[name] = [int(float(word)) for word in self._next(count)]
        return lists

    def _next(self, count: int) -> list[bytes]:
        words = self._words[self._at : self._at + count]
        if len(words) != count:
            raise ValueError("it is cut off")
        self._at += count
        return words


class _BinaryNumbers:
    """Numbers of a binary PLY."""

    def __init__(self, body: bytes, order: str) -> None:
        self._body, self._order, self._at = body, order, 0

    def table(self, count: int, properties: dict[str, str]) -> dict[str, FloatArray]:
        """Columns [count] of an element without lists."""
        kind = np.dtype([(name, self._order + _NUMBERS[what]) for name, what in properties.items()])
        values = np.frombuffer(self._body, kind, count, self._at)
        self._at += count * kind.itemsize
        return {name: values[name] for name in properties}

    def triangles(self, count: int, properties: dict[str, str]) -> NDArray[np.int64] | None:
        """Triangles [count, 3], where the faces are lists of three corners and nothing else; else None."""
        kinds = [kind.split() for kind in properties.values()]
        if len(kinds) != 1 or len(kinds[0]) != 3:
            return None
        one = np.dtype(
            [("count", self._order + _NUMBERS[kinds[0][1]]), ("corners", self._order + _NUMBERS[kinds[0][2]], 3)]
        )
        if len(self._body) - self._at < count * one.itemsize:
            return None
        rows = np.frombuffer(self._body, one, count, self._at)
        if (rows["count"] != 3).any():
            return None
        self._at += rows.nbytes
        return rows["corners"].astype(np.int64)

    def row(self, properties: dict[str, str]) -> dict[str, list[int]]:
        """Lists of one row of an element; other properties are passed over."""
        lists = {}
        for name, kind in properties.items():
            *_, what = kind.split()
            count = int(self._next(kind.split()[1], 1)[0]) if kind.startswith("list") else 1
            lists[name] = [int(value) for value in self._next(what, count)]
        return lists

    def _next(self, what: str, count: int) -> NDArray[np.float64]:
        values = np.frombuffer(self._body, self._order + _NUMBERS[what], count, self._at)
        self._at += values.nbytes
        return values
