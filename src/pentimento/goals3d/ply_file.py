"""Vertices and triangles of a PLY file (Turk, "The PLY Polygon File Format", 1994): ASCII, and binary of either order.

Its header says how much follows, so that a file that was cut off is noticed.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pentimento.goals3d.polygons import triangulated

FloatArray = NDArray[np.float64]

_TYPES: Final = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4",
    "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4",
    "float32": "f4", "float64": "f8",
}  # fmt: skip
_ORDERS: Final = {"binary_little_endian": "<", "binary_big_endian": ">", "ascii": ""}
_CORNERS: Final = ("vertex_indices", "vertex_index")
_LONGEST_HEADER: Final = 100_000
_CUT_OFF: Final = "it ends before its last face, or a list has a wrong length: it may be cut off"

_WRONG_FACE: Final = "a face has less than three corners, or one that is no vertex"


class _Property(NamedTuple):
    name: str
    kind: str
    """NumPy's name of its type."""
    counted_by: str | None
    """Of a list, the type of its length."""


class _Element(NamedTuple):
    name: str
    rows: int
    properties: list[_Property]


def read_ply(path: Path) -> tuple[FloatArray, NDArray[np.int64]]:
    """Vertices [V, 3] and triangles [T, 3]; normals, colours, textures and edges are passed over.

    Raises:
        OSError: the file cannot be opened.
        ValueError: it is no whole PLY file of polygons; the message says why.
    """
    data = path.read_bytes()
    order, elements, start = _header(data)
    body: _Body = _Words(data[start:]) if order == "ascii" else _Bytes(data[start:], _ORDERS[order])
    vertices = np.zeros((0, 3))
    faces = np.zeros((0, 3), np.int64)
    polygons: list[list[int]] = []
    for element in elements:
        columns = body.columns(element)
        if element.name == "tristrips":
            raise ValueError("its faces are strips of triangles; export plain triangles")
        if element.name == "vertex":
            if not {"x", "y", "z"} <= set(columns):
                raise ValueError("its vertices have no x, y and z")
            vertices = np.column_stack([columns[axis] for axis in "xyz"]).astype(np.float64)
        elif element.name == "face":
            corners = next((columns[name] for name in _CORNERS if name in columns), None)
            if corners is None:
                raise ValueError("its faces have no list vertex_indices")
            if isinstance(corners, np.ndarray) and corners.shape[1:] == (3,):
                faces = corners.astype(np.int64)
            else:
                polygons = [[int(index) for index in polygon] for polygon in corners]
    body.require_end()
    if any(len(polygon) < 3 or min(polygon) < 0 or max(polygon) >= len(vertices) for polygon in polygons):
        raise ValueError(_WRONG_FACE)
    if faces.size:
        if faces.min() < 0 or faces.max() >= len(vertices):
            raise ValueError(_WRONG_FACE)
        return vertices, faces
    triangles = [triangle for polygon in polygons for triangle in triangulated(vertices, polygon)]
    return vertices, np.array(triangles, dtype=np.int64).reshape(-1, 3)


def _header(data: bytes) -> tuple[str, list[_Element], int]:
    """The format, the elements, and where these begin."""
    if not data.startswith(b"ply"):
        raise ValueError("it does not begin with 'ply'")
    end = data.find(b"end_header", 0, _LONGEST_HEADER)
    if end < 0:
        raise ValueError("its header has no end; it may be cut off")
    start = end + len(b"end_header")
    start += 2 if data[start : start + 2] == b"\r\n" else 1
    order = ""
    elements: list[_Element] = []
    for line in data[:end].decode("latin-1").splitlines():
        words = line.split()
        try:
            match words[:1]:
                case ["format"]:
                    order = words[1]
                case ["element"]:
                    elements.append(_Element(words[1], int(words[2]), []))
                case ["property"]:
                    is_list = words[1] == "list"
                    kind, counted_by = _TYPES[words[-2]], _TYPES[words[2]] if is_list else None
                    elements[-1].properties.append(_Property(words[-1], kind, counted_by))
        except (LookupError, ValueError) as error:
            raise ValueError(f"its header has the line {line[:60]!r}, which is not understood") from error
    if order not in _ORDERS:
        raise ValueError(f"its format {order[:30]!r} is none of {', '.join(_ORDERS)}")
    if any(not 0 <= each.rows <= len(data) or not each.properties for each in elements):
        raise ValueError("an element has no properties, or more rows than the file has bytes: it may be cut off")
    return order, elements, start


class _Body(ABC):
    """What follows the header."""

    def columns(self, element: _Element) -> dict[str, Any]:
        """The values of each property: scalars [N], and of lists N sequences."""
        rows = [[self._value(each) for each in element.properties] for _ in range(element.rows)]
        values = zip(*rows, strict=True) if rows else ((),) * len(element.properties)
        return dict(zip((each.name for each in element.properties), values, strict=True))

    def _value(self, of: _Property) -> Any:
        if of.counted_by is None:
            return self._take(of.kind, 1)[0]
        return self._take(of.kind, int(self._take(of.counted_by, 1)[0]))

    @abstractmethod
    def _take(self, kind: str, count: int) -> Any:
        """The next values of a type."""

    @abstractmethod
    def require_end(self) -> None:
        """Raise ValueError where more follows."""


class _Words(_Body):
    """Of an ASCII file."""

    def __init__(self, data: bytes) -> None:
        self._words, self._at = data.split(), 0

    def _take(self, kind: str, count: int) -> list[float]:
        taken = self._words[self._at : self._at + max(count, 0)]
        if count < 0 or len(taken) < count:
            raise ValueError(_CUT_OFF)
        self._at += count
        return [float(word) for word in taken]

    def require_end(self) -> None:
        if self._at != len(self._words):
            raise ValueError("more values follow than its header tells")


class _Bytes(_Body):
    """Of a binary file."""

    def __init__(self, data: bytes, order: str) -> None:
        self._data, self._order, self._at = data, order, 0

    def columns(self, element: _Element) -> dict[str, Any]:
        return self._alike(element) or super().columns(element)

    def _alike(self, element: _Element) -> dict[str, Any] | None:
        """All rows at once, where lists are as long as in the first one; else None."""
        if element.rows == 0:
            return None
        begin = self._at
        fields: list[tuple[str, str, tuple[int, ...]]] = []
        for number, each in enumerate(element.properties):
            if each.counted_by is None:
                fields.append((str(number), self._order + each.kind, ()))
                self._take(each.kind, 1)
            else:
                count = int(self._take(each.counted_by, 1)[0])
                self._take(each.kind, count)
                fields.append((f"count {number}", self._order + each.counted_by, ()))
                fields.append((str(number), self._order + each.kind, (count,)))
        self._at, layout = begin, np.dtype(fields)
        if begin + element.rows * layout.itemsize > len(self._data):
            return None
        rows = np.frombuffer(self._data, layout, element.rows, begin)
        counts = [rows[name] for name in layout.names or () if name.startswith("count")]
        if any((count != count[0]).any() for count in counts):
            return None
        self._at += element.rows * layout.itemsize
        return {each.name: rows[str(number)] for number, each in enumerate(element.properties)}

    def _take(self, kind: str, count: int) -> NDArray[Any]:
        size = int(kind[1]) * count
        if count < 0 or self._at + size > len(self._data):
            raise ValueError(_CUT_OFF)
        taken = np.frombuffer(self._data, self._order + kind, count, self._at)
        self._at += size
        return taken

    def require_end(self) -> None:
        if self._data[self._at :].strip():
            raise ValueError("more bytes follow than its header tells")
