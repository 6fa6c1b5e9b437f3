"""Ink that is where it was has survived; ink that moved further, or faded, has not."""

import math

import numpy as np
import pytest

from pentimento.copainting.scenes.ink import ink_mask, ink_recall


def drawing(*rows: int) -> np.ndarray:
    picture = np.full((20, 20, 3), 245, np.uint8)
    for row in rows:
        picture[row, 3:17] = 20
    return picture


@pytest.mark.parametrize(("moved", "survives"), [(0, 1.0), (1, 1.0), (2, 0.0), (-1, 1.0)])
def test_ink_survives_a_shift_of_one_pixel(moved: int, survives: float) -> None:
    assert ink_recall(drawing(8), drawing(8 + moved)) == survives


def test_half_of_the_ink_gone_is_half_the_recall() -> None:
    assert ink_recall(drawing(4, 14), drawing(4)) == 0.5
    assert ink_recall(np.stack([drawing(4), drawing(14)]), np.stack([drawing(4), drawing()])) == 0.5


def test_added_ink_costs_nothing_and_faded_ink_is_lost() -> None:
    assert ink_recall(drawing(4), drawing(4, 9, 14)) == 1.0
    faded = np.where(drawing(4) < 128, np.uint8(160), drawing(4)).astype(np.uint8)
    assert ink_recall(drawing(4), faded) == 0.0


def test_blank_paper_has_no_ink_to_lose() -> None:
    assert not ink_mask(drawing()).any()
    assert math.isnan(ink_recall(drawing(), drawing(4)))
