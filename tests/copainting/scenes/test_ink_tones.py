"""Ink: contours are black, surfaces light, a ground stays white."""

import numpy as np
import pytest
from numpy.typing import NDArray

from pentimento.copainting.scenes.ink_tones import InkTones, ink_tones

CONFIG = InkTones(line_m=1e-3, contrast=0.15, tone=0.2)
K = 1000.0


def disc(inside: float, outside: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """A disc of radius 20 px in 80 x 80, linear light, and each pixel's distance from its border, inwards."""
    rows, columns = np.mgrid[:80, :80] - 39.5
    inwards = 20 - np.hypot(rows, columns)
    grey = np.where(inwards > 0, inside, outside)
    return np.repeat(grey[..., None], 3, axis=-1), inwards


def test_a_dark_disc_is_a_black_ring_around_a_light_surface_on_white() -> None:
    picture, inwards = disc(0.05, 0.8)
    tones = ink_tones(picture, K, CONFIG)[..., 0]
    assert tones[(inwards > 0.5) & (inwards < 2)].max() < 0.2
    assert 0.5 < tones[inwards > 12].min() < tones[inwards < -12].min() > 0.95


def test_more_tone_makes_surfaces_darker_and_none_leaves_them_white() -> None:
    picture, inwards = disc(0.05, 0.8)
    middle = [ink_tones(picture, K, InkTones(1e-3, 0.15, tone))[inwards > 15].mean() for tone in (0.0, 0.3, 0.6)]
    assert middle[0] == pytest.approx(1, abs=0.01) and middle[0] > middle[1] > middle[2]


def test_lines_are_as_wide_in_metres_at_any_resolution() -> None:
    picture, _ = disc(0.05, 0.8)
    fine = np.kron(picture, np.ones((2, 2, 1)))
    coarse, finer = (ink_tones(p, k, CONFIG)[..., 0] for p, k in ((picture, K), (fine, 2 * K)))
    assert (finer < 0.3).mean() == pytest.approx((coarse < 0.3).mean(), rel=0.1)


def test_colours_and_a_tinted_ground_do_not_matter_but_lightness_does() -> None:
    picture, _ = disc(0.05, 0.8)
    faint = 0.6 + 0.05 * picture  # stretched over its own lightness
    assert np.abs(ink_tones(faint, K, CONFIG) - ink_tones(picture, K, CONFIG)).mean() < 0.05
    plain = np.full((16, 16, 3), 1.0)
    assert np.allclose(ink_tones(plain, K, CONFIG), 1.0)
    with pytest.raises(ValueError, match="tone is 2"):
        InkTones(1e-3, 0.15, 2)
