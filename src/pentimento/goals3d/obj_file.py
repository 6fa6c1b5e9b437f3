"""Vertices and triangles of a Wavefront OBJ file: polygons of any shape, indices from the start or from the end."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from pentimento.goals3d.polygons import triangulated

FloatArray = NDArray[np.float64]

_COUNT: Final = re.compile(r"#\s*(?:(\d+)\s+(vertices|faces)|(vertices|faces)\s*:?\s*(\d+))\s*", re.IGNORECASE)
"""A comment such as `# 8 vertices` or `# Faces: 12`."""


def read_obj(path: Path) -> tuple[FloatArray, NDArray[np.int64]]:
    """Vertices [V, 3] and triangles [T, 3] of all objects in the file; textures, normals and lines are passed over.

    A file that was cut off between two lines is a sound one for its format. It is recognised by vertices that nothing
    uses, and by the numbers of vertices and faces that many programs write into its comments.

    Raises:
        OSError: the file cannot be opened.
        ValueError: a line is broken; the message names its number. Or the file seems to be cut off.
    """
    vertices: list[list[float]] = []
    polygons: list[list[int]] = []
    others: set[int] = set()  # vertices of lines and points
    told: Counter[str] = Counter()
    text = path.read_text(encoding="utf-8-sig", errors="replace").replace("\\\n", " ").replace("\\\r\n", " ")
    for number, line in enumerate(text.splitlines(), 1):
        if count := _COUNT.fullmatch(line):
            told[(count[2] or count[3]).lower()] += int(count[1] or count[4])
        words = line.partition("#")[0].split()
        if not words or words[0] not in ("v", "f", "l", "p"):
            continue
        try:
            if words[0] == "v":
                x, y, z = (float(word) for word in words[1:4])  # a weight or a colour may follow
                vertices.append([x, y, z])
            else:
                corners = [_index(word.partition("/")[0], len(vertices)) for word in words[1:]]
                if words[0] == "f":
                    polygons.append(corners)
                else:
                    others.update(corners)
        except ValueError as error:
            raise ValueError(f"line {number}, {line[:60]!r}, is broken") from error
        if words[0] == "f" and len(words) < 4:
            raise ValueError(f"line {number}, {line[:60]!r}, is a face of less than three corners")
    points = np.array(vertices, dtype=np.float64).reshape(-1, 3)
    if any(max(polygon) >= len(points) for polygon in polygons):
        raise ValueError("a face has a corner that is no vertex; the file may be cut off")
    _require_whole(len(points), polygons, others, told)
    triangles = [triangle for polygon in polygons for triangle in triangulated(points, polygon)]
    return points, np.array(triangles, dtype=np.int64).reshape(-1, 3)


def _require_whole(vertices: int, polygons: list[list[int]], others: set[int], told: Counter[str]) -> None:
    unused = vertices - len(others.union(*polygons))
    if polygons and unused:
        raise ValueError(
            f"{unused} of its {vertices} vertices are in no face, so the file may be cut off; if it is whole, remove "
            "its loose vertices"
        )
    for name, found in (("vertices", vertices), ("faces", len(polygons))):
        if told[name] > found:
            raise ValueError(f"its comments tell of {told[name]} {name}, and it has {found}: it is cut off")


def _index(word: str, known: int) -> int:
    """From 0. Negative numbers count back from the last vertex before the face."""
    number = int(word)
    index = number - 1 if number > 0 else known + number
    if number == 0 or index < 0:
        raise ValueError("no vertex")
    return index
