"""Pictures in rows and columns, with a title for each column and a caption for each row."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

Pictures = NDArray[np.uint8] | Sequence[NDArray[np.uint8]]

_PAPER: Final = 255
_TEXT_SRGB: Final = (40, 40, 40)
_TEXT_SCALE: Final = 0.38  # of OpenCV's font, about 9 px high


@dataclass(frozen=True)
class Layout:
    """Distances on a sheet of pictures, in pixels."""

    line_px: int = 22
    """Height of a line of text."""
    column_gap_px: int = 6
    row_gap_px: int = 6
    title_baseline_px: int = 15
    """From the top of its line."""
    caption_baseline_px: int = 15


def side_by_side(
    columns: Mapping[str, Pictures], captions: Sequence[str], size_px: tuple[int, int], layout: Layout | None = None
) -> NDArray[np.uint8]:
    """Columns of pictures, uint8 [H, W, 3] each, resized to (height, width), rows under their captions.

    As many rows as captions are shown; the sheet is uint8 [H', W', 3].
    """
    layout = layout or Layout()
    height, width = size_px
    step_y, step_x = height + layout.line_px + layout.row_gap_px, width + layout.column_gap_px
    sheet = np.full((layout.line_px + len(captions) * step_y, len(columns) * step_x, 3), _PAPER, np.uint8)
    for column, (title, pictures) in enumerate(columns.items()):
        x = column * step_x
        _write(sheet, title, (x, layout.title_baseline_px))
        for row, picture in enumerate(pictures[: len(captions)]):
            y = 2 * layout.line_px + row * step_y
            sheet[y : y + height, x : x + width] = _resized(picture, size_px)
    for row, caption in enumerate(captions):
        _write(sheet, caption, (0, layout.line_px + row * step_y + layout.caption_baseline_px))
    return sheet


def _resized(picture: NDArray[np.uint8], size_px: tuple[int, int]) -> NDArray[np.uint8]:
    method = cv2.INTER_AREA if size_px[0] < picture.shape[0] else cv2.INTER_NEAREST
    return np.asarray(cv2.resize(picture, size_px[::-1], interpolation=method), dtype=np.uint8)


def _write(sheet: NDArray[np.uint8], text: str, at: tuple[int, int]) -> None:
    ascii_text = text.encode("ascii", "replace").decode()  # OpenCV's font has no other characters
    cv2.putText(sheet, ascii_text, at, cv2.FONT_HERSHEY_SIMPLEX, _TEXT_SCALE, _TEXT_SRGB, 1, cv2.LINE_AA)
