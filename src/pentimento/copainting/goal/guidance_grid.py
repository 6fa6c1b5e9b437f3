"""One picture of a goal planner at several guidances: how much it heeds the canvas, and how much the words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.ranges import at_least
from pentimento.copainting.goal.planner import GoalPlanner, complete
from pentimento.copainting.scenes.edits import Pair

_GAP_PX: Final = 4
_HEAD_PX: Final = 26
_PAPER: Final = 255


@dataclass(frozen=True)
class Sampling:
    """How goal pictures are sampled."""

    steps: int
    """DDIM's."""
    image_guidance: tuple[float, ...]
    """Values shown in the grid, each with each of `text_guidance`; 1 or more (less would switch guidance off). The
    first of each is the one in use."""
    text_guidance: tuple[float, ...]
    shown: int
    """Pairs in the grid."""
    scored: int
    """Pairs in the metrics."""
    enlarged: int
    """Pixels of the grid for one of a picture."""
    seed: int

    def __post_init__(self) -> None:
        at_least(self, 1, "steps", "shown", "scored", "enlarged")
        at_least(self, 0, "seed")
        for name in ("image_guidance", "text_guidance"):
            values = getattr(self, name)
            if not values or min(values) < 1:
                raise ValueError(f"{name} is {list(values)}; give values of 1 or more.")


def guidance_grid(planner: GoalPlanner, pairs: Sequence[Pair], sampling: Sampling) -> NDArray[np.uint8]:
    """Rows: pairs. Columns: input, target, then a completion for each image × text guidance. uint8 [H, W, 3]."""
    inputs = np.stack([pair.input for pair in pairs])
    captions = [pair.caption for pair in pairs]
    columns = {"input": inputs, "target": np.stack([pair.target for pair in pairs])}
    for image in sampling.image_guidance:
        for text in sampling.text_guidance:
            made = complete(planner, inputs, captions, sampling.steps, image, text, sampling.seed)
            columns[f"image {image:g} text {text:g}"] = made
    return _laid_out(columns, captions, sampling.enlarged)


def _laid_out(columns: dict[str, NDArray[np.uint8]], captions: Sequence[str], enlarged: int) -> NDArray[np.uint8]:
    """Columns of pictures [B, H, W, 3] under their names; each row's caption above it."""
    side_y, side_x = (enlarged * side for side in next(iter(columns.values())).shape[1:3])
    height = _HEAD_PX + len(captions) * (side_y + _HEAD_PX)
    sheet = np.full((height, len(columns) * (side_x + _GAP_PX), 3), _PAPER, np.uint8)
    for column, (name, pictures) in enumerate(columns.items()):
        x = column * (side_x + _GAP_PX)
        _write(sheet, name, (x, 16))
        for row, picture in enumerate(pictures):
            y = _HEAD_PX + row * (side_y + _HEAD_PX) + _HEAD_PX
            large = cv2.resize(picture, (side_x, side_y), interpolation=cv2.INTER_NEAREST)
            sheet[y : y + side_y, x : x + side_x] = large
    for row, caption in enumerate(captions):
        _write(sheet, caption, (0, _HEAD_PX + row * (side_y + _HEAD_PX) + 18))
    return sheet


def _write(sheet: NDArray[np.uint8], words: str, at: tuple[int, int]) -> None:
    plain = words.encode("ascii", "replace").decode()  # OpenCV's font has no other letters
    cv2.putText(sheet, plain, at, cv2.FONT_HERSHEY_SIMPLEX, 0.38, (40, 40, 40), 1, cv2.LINE_AA)
