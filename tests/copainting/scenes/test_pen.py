"""Pen drawings: contours where a picture has them, within what is drawn, on clean paper."""

from dataclasses import replace

import numpy as np

from pentimento.copainting.scenes.ink import ink_mask
from pentimento.copainting.scenes.pen import Pen, pen_drawing, random_pen

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


def test_outlines_are_inked_and_surfaces_stay_paper() -> None:
    ink = ink_mask(pen_drawing(ring(), np.ones((64, 64), bool), PEN))
    rows, columns = np.nonzero(ink)
    away = np.minimum(np.hypot(rows - 32, columns - 16), np.hypot(rows - 32, columns - 48))
    assert len(rows) > 100 and np.abs(away - 11).max() < 2.5


def test_only_what_is_drawn_gets_ink() -> None:
    left = np.zeros((64, 64), bool)
    left[:, :32] = True
    half, whole = pen_drawing(ring(), left, PEN), pen_drawing(ring(), np.ones((64, 64), bool), PEN)
    assert (half[:, :32] == whole[:, :32]).all() and (half[:, 36:] == 255).all()


def test_tone_and_width_add_ink_and_ink_and_paper_are_the_greys_that_were_asked_for() -> None:
    everywhere = np.ones((64, 64), bool)
    plain = pen_drawing(ring(), everywhere, PEN)
    assert pen_drawing(ring(), everywhere, replace(PEN, tone=0.5)).mean() < plain.mean() - 1
    assert pen_drawing(ring(), everywhere, replace(PEN, width=0.02)).mean() < plain.mean() - 1
    grey = pen_drawing(ring(), everywhere, replace(PEN, ink=0.2, paper=0.9))
    assert grey.min() == 51 and abs(grey.max() - 0.9 * 255) <= 1


def test_hands_differ() -> None:
    assert len({random_pen(np.random.default_rng(seed)) for seed in range(10)}) == 10
