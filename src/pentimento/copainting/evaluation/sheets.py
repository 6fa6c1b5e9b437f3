"""Pictures side by side for people, under the names of their columns and beside the words that they answer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from pentimento.copainting.evaluation.answers import NO_CHANGE, Answers

Pictures = NDArray[np.uint8] | Sequence[NDArray[np.uint8]]

_GAP_PX: Final = 6
_HEAD_PX: Final = 22
_PAPER: Final = 255


def side_by_side(columns: Mapping[str, Pictures], captions: Sequence[str], side_px: int) -> NDArray[np.uint8]:
    """Columns of pictures, uint8 [H, W, 3] each, `side_px` large, each row under its caption: uint8 [H', W', 3]."""
    rows = len(captions)
    height = _HEAD_PX + rows * (side_px + _HEAD_PX + _GAP_PX)
    sheet = np.full((height, len(columns) * (side_px + _GAP_PX), 3), _PAPER, np.uint8)
    for column, (name, pictures) in enumerate(columns.items()):
        x = column * (side_px + _GAP_PX)
        _write(sheet, name, (x, 15))
        for row, picture in enumerate(pictures[:rows]):
            y = _HEAD_PX + row * (side_px + _HEAD_PX + _GAP_PX) + _HEAD_PX
            sheet[y : y + side_px, x : x + side_px] = _fitted(picture, side_px)
    for row, caption in enumerate(captions):
        _write(sheet, caption, (0, _HEAD_PX + row * (side_px + _HEAD_PX + _GAP_PX) + 15))
    return sheet


def methods_side_by_side(answers: Answers, captions: Sequence[str], side_px: int) -> NDArray[np.uint8]:
    """Canvases, then each method's goal, where it has one, and plan, for as many cases as there are captions."""
    columns: dict[str, Pictures] = {"canvas": answers.canvases}
    for method, drawings in answers.drawings.items():
        if method in answers.goals:
            columns[f"{method}: goal"] = answers.goals[method]
        if method != NO_CHANGE:
            columns[f"{method}: plan"] = drawings
    return side_by_side(columns, captions[: len(answers.canvases)], side_px)


def _fitted(picture: NDArray[np.uint8], side_px: int) -> NDArray[np.uint8]:
    way = cv2.INTER_AREA if side_px < picture.shape[0] else cv2.INTER_NEAREST
    return np.asarray(cv2.resize(picture, (side_px, side_px), interpolation=way), dtype=np.uint8)


def _write(sheet: NDArray[np.uint8], words: str, at: tuple[int, int]) -> None:
    plain = words.encode("ascii", "replace").decode()  # OpenCV's font has no other letters
    cv2.putText(sheet, plain, at, cv2.FONT_HERSHEY_SIMPLEX, 0.38, (40, 40, 40), 1, cv2.LINE_AA)
