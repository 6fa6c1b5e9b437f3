"""Co-paintings to look at: each scene beside what was made of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from pentimento.contracts.copaintings import CONTRACT
from pentimento.contracts.images import decode_png
from pentimento.contracts.tables import read_table
from pentimento.copainting.synthesis.pairs import Image

_CELL_PX = 96
_FRAME_PX = 2
_SHOWN = {"all": 1, "random": 2, "salient": 2, "semantic": 2}
_NONE = 190


def preview(scenes: Sequence[Mapping[str, Any]], files: Sequence[Path]) -> Image:
    """A line for each scene: itself, its full painting, then partial ones: one of all, two of the other strategies.

    Args:
        scenes: rows of the ``scenes`` contract.
        files: shards of the ``copaintings`` contract; those of their pairs that a filter left out are shown, too.
    """
    wanted = {row["scene_id"]: row for row in scenes}
    found: dict[str, list[dict[str, Any]]] = {}
    for file in files:
        table = read_table(file, CONTRACT).table
        for row in table.filter(pc.is_in(table["scene_id"], pa.array(wanted))).to_pylist():
            found.setdefault(row["scene_id"], []).append(row)
        if len(found) == len(wanted):
            break
    return np.concatenate([_line(wanted[scene_id], rows) for scene_id, rows in found.items()])


def _line(scene: Mapping[str, Any], rows: Sequence[Mapping[str, Any]]) -> Image:
    cells = [_cell(scene["image"]), _cell(rows[0]["full"])]
    for strategy, number in _SHOWN.items():
        shown = [_cell(row["partial"]) for row in rows if row["strategy"] == strategy][:number]
        cells += shown + [np.full_like(cells[0], _NONE)] * (number - len(shown))
    return np.concatenate(cells, axis=1)


def _cell(image: Mapping[str, Any]) -> Image:
    """The picture, whole, in a square of white."""
    picture = decode_png(image["bytes"])
    scale = _CELL_PX / max(picture.shape[:2])
    height, width = (max(round(side * scale), 1) for side in picture.shape[:2])
    side = _CELL_PX + 2 * _FRAME_PX
    framed = np.full((side, side, 3), 255, np.uint8)
    top, left = (side - height) // 2, (side - width) // 2
    framed[top : top + height, left : left + width] = cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA)
    return framed
