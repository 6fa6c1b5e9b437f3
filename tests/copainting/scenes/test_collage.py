"""Two scenes on one sheet: each in its half, nothing lost, nothing else touched."""

import numpy as np
import pytest

from pentimento.copainting.scenes.collage import HALVES, Half, close_up, pairs_shown, put, random_halves

WHITE = np.full((40, 40, 3), 255, np.uint8)


def square(side: int) -> tuple[np.ndarray, np.ndarray]:
    """A dark square in a corner of a grey picture, and its region."""
    image, regions = np.full((40, 40, 3), 128, np.uint8), np.zeros((40, 40), np.uint8)
    image[2 : 2 + side, 2 : 2 + side], regions[2 : 2 + side, 2 : 2 + side] = 10, 1
    return image, regions


@pytest.mark.parametrize("half", [half for both in HALVES for half in both])
@pytest.mark.parametrize("side", [8, 17, 30])
def test_a_thing_of_any_size_fills_its_half_and_stays_within(half: Half, side: int) -> None:
    sheet, there = put(WHITE, *square(side), half, np.random.default_rng(0))
    rows, columns = np.nonzero(there)
    assert abs(columns.mean() + 0.5 - 40 * half.x) < 2.5 and abs(rows.mean() + 0.5 - 40 * half.y) < 2.5
    assert 0.4 * 40 <= np.ptp(rows) + 1 <= 0.56 * 40
    assert sheet[there].mean() < 40  # nothing of the grey ground comes with it
    apart = np.hypot(columns[:, None] - 39 * (1 - half.x), rows[:, None] - 39 * (1 - half.y))
    assert apart.min() > 4  # the other half's middle is free


def test_what_is_outside_is_untouched_and_no_thing_changes_nothing() -> None:
    sheet, there = put(WHITE, *square(12), HALVES[0][0], np.random.default_rng(1))
    assert (sheet[:, 26:] == 255).all() and there[:, :26].any()
    image, regions = square(12)
    same, nowhere = put(WHITE, image, np.zeros_like(regions), HALVES[0][0], np.random.default_rng(1))
    assert (same == WHITE).all() and not nowhere.any()


@pytest.mark.parametrize("half", [half for both in HALVES for half in both])
def test_a_close_up_shows_all_that_was_put_there_and_larger(half: Half) -> None:
    for seed in range(5):
        sheet, there = put(WHITE, *square(17), half, np.random.default_rng(seed))
        near = close_up(sheet, half)
        assert near.shape == sheet.shape
        dark = (near < 128).mean() / (sheet < 128).mean()
        assert there.any() and dark == pytest.approx((40 / 23) ** 2, rel=0.12)


def test_halves_face_each_other() -> None:
    for seed in range(20):
        one, other = random_halves(np.random.default_rng(seed))
        assert one.x + other.x == pytest.approx(1) and one.y + other.y == pytest.approx(1)
        assert max(abs(one.x - other.x), abs(one.y - other.y)) > 0.4


def test_pairs_are_those_of_each_scene() -> None:
    shown = pairs_shown([["cat"], ["cat", "dog"], ["sun", "sun"], ["a", "b", "c"]])
    assert shown == {frozenset(pair) for pair in (("cat", "dog"), ("sun",), ("a", "b"), ("a", "c"), ("b", "c"))}
