"""Two scenes on one sheet: the things of one beside or above those of the other, each in its half."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Final, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

_SHARES: Final = (0.44, 0.52)  # of the sheet's side: the longer side of what is put into a half
_EXECUTION_NOISE: Final = 0.03  # of the sheet's side: how far it may lie from its half's middle


class Half(NamedTuple):
    """The middle of a half of the sheet, as shares of its sides: x to the right, y down."""

    x: float
    y: float


HALVES: Final = ((Half(0.26, 0.5), Half(0.74, 0.5)), (Half(0.5, 0.26), Half(0.5, 0.74)))
"""Left and right, upper and lower."""


def random_halves(generator: np.random.Generator) -> tuple[Half, Half]:
    """Two halves that leave room for each other, in either order."""
    one, other = HALVES[int(generator.integers(len(HALVES)))]
    return (one, other) if generator.random() < 0.5 else (other, one)


def put(
    sheet: NDArray[np.uint8],
    picture: NDArray[np.uint8],
    regions: NDArray[np.uint8],
    half: Half,
    generator: np.random.Generator,
) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
    """The sheet, sRGB [H, W, 3], with all things of a picture [h, w, 3] in one half; and where they are, [H, W].

    What `regions` [h, w] labels above 0 is cut out together and resized. A picture without things changes nothing.
    """
    height, width = sheet.shape[:2]
    things = regions > 0
    if not things.any():
        return sheet.copy(), np.zeros((height, width), bool)
    rows, columns = np.flatnonzero(things.any(1)), np.flatnonzero(things.any(0))
    extent = max(rows[-1] - rows[0], columns[-1] - columns[0]) + 1
    scale = generator.uniform(*_SHARES) * min(height, width) / extent
    execution_noise = generator.uniform(-_EXECUTION_NOISE, _EXECUTION_NOISE, 2)
    middle = (half.x + execution_noise[0]) * width, (half.y + execution_noise[1]) * height
    centre = (columns[0] + columns[-1] + 1) / 2, (rows[0] + rows[-1] + 1) / 2
    # OpenCV's pixel centres are at whole numbers.
    shift = [middle[axis] - 0.5 - scale * (centre[axis] - 0.5) for axis in range(2)]
    moved = np.array([[scale, 0, shift[0]], [0, scale, shift[1]]])
    size, way = (width, height), cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    image = cv2.warpAffine(picture, moved, size, flags=way, borderMode=cv2.BORDER_REPLICATE)
    share = cv2.warpAffine(things.astype(np.float32), moved, size, flags=cv2.INTER_LINEAR)[..., None]
    mixed = np.round(sheet + (image.astype(np.float64) - sheet) * share).astype(np.uint8)
    return mixed, share[..., 0] >= 0.5


def close_up(sheet: NDArray[np.uint8], half: Half) -> NDArray[np.uint8]:
    """The square about a half's middle that holds whatever `put` put there, as large as the sheet [H, W, 3] itself."""
    height, width = sheet.shape[:2]
    rows, columns = (round((_SHARES[1] + 2 * _EXECUTION_NOISE) * side) for side in (height, width))
    top = int(np.clip(round(half.y * height - rows / 2), 0, height - rows))
    left = int(np.clip(round(half.x * width - columns / 2), 0, width - columns))
    part = np.ascontiguousarray(sheet[top : top + rows, left : left + columns])
    return np.asarray(cv2.resize(part, (width, height), interpolation=cv2.INTER_CUBIC), dtype=np.uint8)


def pairs_shown(objects: Iterable[Sequence[str]]) -> set[frozenset[str]]:
    """Which kinds of things some scene shows together: sets of two, or of one that is there twice."""
    return {
        frozenset((one, other))
        for kinds in objects
        for number, one in enumerate(kinds)
        for other in kinds[number + 1 :]
    }  # fmt: skip
