"""Contact sheet of an import: its first rows in one picture, to be looked at before anything is trained.

A mirrored axis, a wrong unit and a photograph of another place are seen here at once.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import cv2
import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pentimento.contracts.atomic import command_folder
from pentimento.contracts.frames import canvas_to_pixel
from pentimento.contracts.images import decode_png, encode_png, ink_encoded_to_srgb
from pentimento.contracts.schema import TableContract, columns_markdown
from pentimento.contracts.tables import write_shards
from pentimento.io.stroke_rows import COMMAND

Picture = NDArray[np.uint8]
FloatArray = NDArray[np.float64]

SHEET: Final = "contact_sheet.png"
"""In the folder of the table."""
_ACROSS: Final = 3
SHOWN: Final = _ACROSS**2
"""Rows on a sheet."""
_CELL_PX: Final = 260
_GAP_PX: Final = 4
_GAP: Final = 200  # sRGB grey
_LINE: Final = (220, 40, 160)  # sRGB: no paint on white paper is likely to have it
_START: Final = (20, 150, 60)
_TEXT: Final = (90, 90, 90)
_FINE: Final = 4
"""Bits of the fraction of a pixel in OpenCV's coordinates."""
_AROUND: Final = 0.15
"""Paper beside a path without a picture, of its size."""


class Shown(NamedTuple):
    """One cell of a sheet."""

    path_m: FloatArray
    """[N, 2] x, y (up)."""
    window_m: FloatArray
    """[4] what the cell shows, in the frame of the path."""
    picture: Picture | None
    """sRGB [H, W, 3] of that window; None: blank paper."""


def shown_strokes(table: pa.Table) -> list[Shown]:
    """The first rows of a strokes table: the photograph after each stroke, and its commanded path."""
    rows: list[dict[str, Any]] = table.slice(0, SHOWN).select(["path", "window_m", "after"]).to_pylist()
    return [
        Shown(
            np.array(row["path"], dtype=np.float64)[:, 1:3],
            np.array(row["window_m"], dtype=np.float64),
            ink_encoded_to_srgb(decode_png(row["after"]["bytes"])),
        )
        for row in rows
    ]


def shown_paths(paths_m: Sequence[FloatArray]) -> list[Shown]:
    """The first paths [N, 2], each in the middle of a square of blank paper."""
    cells = []
    for path in paths_m[:SHOWN]:
        half = (0.5 + _AROUND) * max(float(np.ptp(path, axis=0).max()), 1e-6)
        middle = (path.min(axis=0) + path.max(axis=0)) / 2
        cells.append(Shown(path, np.concatenate([middle - half, middle + half]), None))
    return cells


def contact_sheet(cells: Sequence[Shown]) -> Picture:
    """Cells in rows of three, each with its path, a dot at the start and the cell's width in mm: sRGB [H, W, 3]."""
    drawn = [_cell(each) for each in cells[:SHOWN]]
    blank = np.full((_CELL_PX, _CELL_PX, 3), 255, np.uint8)
    drawn += [blank] * (-len(drawn) % _ACROSS)
    framed = [np.pad(each, ((0, _GAP_PX), (0, _GAP_PX), (0, 0)), constant_values=_GAP) for each in drawn]
    return np.vstack([np.hstack(framed[first : first + _ACROSS]) for first in range(0, len(framed), _ACROSS)])


def _cell(shown: Shown) -> Picture:
    size_m = shown.window_m[2:] - shown.window_m[:2]
    scale = _CELL_PX / float(size_m.max())
    width, height = (max(round(float(side) * scale), 1) for side in size_m)
    cell = np.full((_CELL_PX, _CELL_PX, 3), 255, np.uint8)
    if shown.picture is not None:
        smaller = shown.picture.shape[0] > height
        cell[:height, :width] = cv2.resize(
            shown.picture, (width, height), interpolation=cv2.INTER_AREA if smaller else cv2.INTER_LINEAR
        )
    pixels = np.rint(canvas_to_pixel(shown.path_m, shown.window_m, scale) * 2**_FINE).astype(np.int32)
    cv2.polylines(cell, [pixels], False, _LINE, 1, cv2.LINE_AA, _FINE)
    cv2.circle(cell, pixels[0].tolist(), 4 << _FINE, _START, -1, cv2.LINE_AA, _FINE)
    text = f"{1e3 * size_m[0]:.3g} mm"
    cv2.putText(cell, text, (4, _CELL_PX - 6), cv2.FONT_HERSHEY_SIMPLEX, 0.4, _TEXT, 1, cv2.LINE_AA)
    return cell


def write_with_sheet(
    out: Path, table: pa.Table, contract: TableContract, card: str, shown: Callable[[pa.Table], Sequence[Shown]]
) -> None:
    """Write a table as a folder of shards with README.md and the contact sheet, atomically.

    Args:
        shown: the cells of the sheet, of a table that keeps the contract.

    Raises:
        ContractError: a row breaks the contract; nothing is written.
        ConfigError: the folder holds what `pentimento import` did not write.
    """
    with command_folder(out, COMMAND) as folder:
        write_shards(folder, table, contract)
        (folder / "README.md").write_text(
            f"{card.rstrip()}\n\n## Columns\n\n{columns_markdown(contract)}", encoding="utf-8"
        )
        (folder / SHEET).write_bytes(encode_png(contact_sheet(shown(table))))
