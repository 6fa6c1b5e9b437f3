"""Ink tones, pen drawings, random strokes and the recall of ink."""

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from pentimento.copainting.scenes.ink import (
    InkTones,
    Pen,
    ink_mask,
    ink_recall,
    ink_tones,
    pen_drawing,
    random_pen,
    random_strokes,
)


def drawing(*rows: int) -> np.ndarray:
    picture = np.full((20, 20, 3), 245, np.uint8)
    for row in rows:
        picture[row, 3:17] = 20
    return picture


@pytest.mark.parametrize(("moved", "survives"), [(0, 1.0), (1, 1.0), (2, 0.0), (-1, 1.0)])
def test_ink_recall_tolerates_a_shift_of_one_pixel(moved: int, survives: float) -> None:
    assert ink_recall(drawing(8), drawing(8 + moved)) == survives


def test_ink_recall_is_the_fraction_of_kept_ink() -> None:
    assert ink_recall(drawing(4, 14), drawing(4)) == 0.5
    assert ink_recall(np.stack([drawing(4), drawing(14)]), np.stack([drawing(4), drawing()])) == 0.5


def test_ink_recall_ignores_added_ink_and_loses_faded_ink() -> None:
    assert ink_recall(drawing(4), drawing(4, 9, 14)) == 1.0
    faded = np.where(drawing(4) < 128, np.uint8(160), drawing(4)).astype(np.uint8)
    assert ink_recall(drawing(4), faded) == 0.0


def test_ink_recall_of_blank_paper_is_nan() -> None:
    assert not ink_mask(drawing()).any()
    assert math.isnan(ink_recall(drawing(), drawing(4)))


CONFIG = InkTones(line_m=1e-3, contrast=0.15, tone=0.2)
K = 1000.0


def disc(inside: float, outside: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """A disc of radius 20 px in 80 x 80, linear light, and each pixel's distance from its border, inwards."""
    rows, columns = np.mgrid[:80, :80] - 39.5
    inwards = 20 - np.hypot(rows, columns)
    grey = np.where(inwards > 0, inside, outside)
    return np.repeat(grey[..., None], 3, axis=-1), inwards


def test_ink_tones_of_a_dark_disc_are_a_black_ring_on_white() -> None:
    picture, inwards = disc(0.05, 0.8)
    tones = ink_tones(picture, K, CONFIG)[..., 0]
    assert tones[(inwards > 0.5) & (inwards < 2)].max() < 0.2
    assert 0.5 < tones[inwards > 12].min() < tones[inwards < -12].min() > 0.95


def test_ink_tone_parameter_darkens_surfaces() -> None:
    picture, inwards = disc(0.05, 0.8)
    middle = [ink_tones(picture, K, InkTones(1e-3, 0.15, tone))[inwards > 15].mean() for tone in (0.0, 0.3, 0.6)]
    assert middle[0] == pytest.approx(1, abs=0.01) and middle[0] > middle[1] > middle[2]


def test_ink_lines_have_the_same_width_in_metres_at_any_resolution() -> None:
    picture, _ = disc(0.05, 0.8)
    fine = np.kron(picture, np.ones((2, 2, 1)))
    coarse, finer = (ink_tones(p, k, CONFIG)[..., 0] for p, k in ((picture, K), (fine, 2 * K)))
    assert (finer < 0.3).mean() == pytest.approx((coarse < 0.3).mean(), rel=0.1)


def test_ink_tones_depend_on_relative_lightness_only() -> None:
    picture, _ = disc(0.05, 0.8)
    faint = 0.6 + 0.05 * picture  # stretched over its own lightness
    assert np.abs(ink_tones(faint, K, CONFIG) - ink_tones(picture, K, CONFIG)).mean() < 0.05
    plain = np.full((16, 16, 3), 1.0)
    assert np.allclose(ink_tones(plain, K, CONFIG), 1.0)
    with pytest.raises(ValueError, match="tone is 2"):
        InkTones(1e-3, 0.15, 2)


PEN = Pen(0.01, 0.15, 0.0, 0.0, 1.0)


def ring() -> np.ndarray:
    """A pale disc with a dark outline on a pale ground; two of them."""
    rows, columns = np.mgrid[:64, :64]
    image = np.full((64, 64, 3), 235, np.uint8)
    for x in (16, 48):
        away = np.hypot(rows - 32, columns - x)
        image[away < 11] = (240, 210, 120)
        image[np.abs(away - 11) < 0.8] = (60, 40, 20)
    return image


def test_pen_drawing_inks_outlines_only() -> None:
    ink = ink_mask(pen_drawing(ring(), np.ones((64, 64), bool), PEN))
    rows, columns = np.nonzero(ink)
    away = np.minimum(np.hypot(rows - 32, columns - 16), np.hypot(rows - 32, columns - 48))
    assert len(rows) > 100 and np.abs(away - 11).max() < 2.5


def test_pen_drawing_stays_within_its_mask() -> None:
    left = np.zeros((64, 64), bool)
    left[:, :32] = True
    half, whole = pen_drawing(ring(), left, PEN), pen_drawing(ring(), np.ones((64, 64), bool), PEN)
    assert (half[:, :32] == whole[:, :32]).all() and (half[:, 36:] == 255).all()


def test_pen_parameters_set_tone_width_and_greys() -> None:
    everywhere = np.ones((64, 64), bool)
    plain = pen_drawing(ring(), everywhere, PEN)
    assert pen_drawing(ring(), everywhere, replace(PEN, tone=0.5)).mean() < plain.mean() - 1
    assert pen_drawing(ring(), everywhere, replace(PEN, width=0.02)).mean() < plain.mean() - 1
    grey = pen_drawing(ring(), everywhere, replace(PEN, ink=0.2, paper=0.9))
    assert grey.min() == 51 and abs(grey.max() - 0.9 * 255) <= 1


def test_random_pens_differ_by_seed() -> None:
    assert len({random_pen(np.random.default_rng(seed)) for seed in range(10)}) == 10


def drawn(strokes: int, width: float, seed: int) -> np.ndarray:
    return random_strokes(48, strokes, (width, width), np.random.default_rng(seed))


def inked(picture: np.ndarray) -> float:
    return float((picture.max() - picture.astype(float)).mean() / (picture.max() - picture.min() + 1e-9))


def test_random_strokes_leave_more_ink_with_number_and_width() -> None:
    for seed in range(5):
        assert inked(drawn(20, 2, seed)) > 2 * inked(drawn(3, 2, seed)) > 0
        assert inked(drawn(8, 4, seed)) > 1.5 * inked(drawn(8, 1.5, seed))


def test_random_strokes_are_dark_on_light_and_repeatable() -> None:
    for seed in range(12):
        picture = drawn(10, 2.5, seed)
        assert (picture == drawn(10, 2.5, seed)).all()
        assert picture.max() >= 220 and np.median(picture) > 200
    assert (drawn(10, 2.5, 0) != drawn(10, 2.5, 1)).any()
