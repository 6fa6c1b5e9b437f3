"""Kubelka and Munk's films against their closed forms."""

import numpy as np
import pytest

from pentimento.studio.strokes.sheet import film_over, lay_film, pigment, refresh
from pentimento.studio.strokes.world import load_world

ACRYLIC, INK = load_world("plain").paint, load_world("marker").paint


@pytest.mark.parametrize("masstone", [0.02, 0.2, 0.5, 0.9])
@pytest.mark.parametrize("background", [0.03, 0.6, 0.95])
def test_an_infinitely_thick_film_shows_the_masstone(masstone: float, background: float) -> None:
    paint = pigment(np.full(3, masstone), ACRYLIC)
    seen = film_over(1e4 * paint.absorption[0], 1e4 * paint.scattering[0], background)
    assert seen == pytest.approx(masstone, abs=1e-6)


@pytest.mark.parametrize("background", [0.03, 0.6, 0.95])
def test_no_film_shows_the_background(background: float) -> None:
    assert film_over(0.0, 0.0, background) == background
    assert film_over(1e-5, 1e-5, background) == pytest.approx(background, abs=1e-4)


def test_a_film_that_only_scatters_is_known_in_closed_form() -> None:
    # K = 0: R = (R_g + (1 - R_g) S) / (1 + (1 - R_g) S)
    for s in (0.1, 1.0, 10.0):
        expected = (0.2 + 0.8 * s) / (1 + 0.8 * s)
        assert film_over(0.0, s, 0.2) == pytest.approx(expected, abs=1e-5)


def test_two_films_equal_one_of_their_thickness() -> None:
    paint = pigment(np.full(3, 0.3), ACRYLIC)
    k, s = paint.absorption[0], paint.scattering[0]
    once = film_over(0.7 * k, 0.7 * s, 0.9)
    twice = film_over(0.5 * k, 0.5 * s, film_over(0.2 * k, 0.2 * s, 0.9))
    assert twice == pytest.approx(once, abs=1e-6)


def test_a_nominal_film_of_white_hides_black_and_a_dye_does_not() -> None:
    white = pigment(np.full(3, 0.9), ACRYLIC)
    assert film_over(white.absorption[0], white.scattering[0], 0.02) > 0.7
    yellow = pigment(np.array([0.9, 0.8, 0.1]), INK)
    assert film_over(yellow.absorption[0], yellow.scattering[0], 0.02) < 0.06


def _layers(film_volume: float, colour: float) -> list[np.ndarray]:
    paint = pigment(np.full(3, colour), ACRYLIC)
    film = np.zeros((1, 1, 7), dtype=np.float32)
    film[0, 0] = film_volume * np.concatenate([[1.0], paint.absorption, paint.scattering])
    return [
        film,
        np.zeros((1, 1, 7), np.float32),
        np.full((1, 1, 3), 0.9, np.float32),
        np.zeros((1, 1), np.float32),
    ]


@pytest.mark.parametrize(("stirring", "age_s", "mixes"), [(0.0, 1.0, False), (0.5, 1.0, True), (0.5, 2000.0, False)])
def test_only_wet_paint_is_stirred(stirring: float, age_s: float, mixes: bool) -> None:
    first, wet, below, painted = _layers(1.0, 0.6)
    second = _layers(1.0, 0.1)[0]
    lay_film(first, wet, below, painted, 0.0, 90.0, 0.0, stirring)
    alone = second[0, 0].copy()
    lay_film(second, wet, below, painted, age_s, 90.0, 0.0, stirring)
    assert (abs(wet[0, 0, 0] - alone[0]) > 0.1) == mixes
    seen = np.zeros((1, 1, 3), np.float32)
    refresh(seen, np.full((1, 1), 2.0, np.float32), wet, below, painted, age_s, 90.0, 0.0)
    pure = film_over(alone[1], alone[4], 0.6)
    assert (seen[0, 0, 0] > pure + 0.01) == mixes


def test_drying_darkens_light_paint_and_then_stops() -> None:
    film, wet, below, painted = _layers(0.5, 0.7)
    below[:] = 0.1
    lay_film(film, wet, below, painted, 0.0, 90.0, 0.3, 0.0)
    seen, liquid = np.zeros((1, 1, 3), np.float32), np.full((1, 1), 2.0, np.float32)
    looks = []
    for clock_s in (0.0, 60.0, 200.0, 1000.0, 5000.0):
        refresh(seen, liquid, wet, below, painted, clock_s, 90.0, 0.3)
        looks.append(float(seen[0, 0, 0]))
    assert looks[0] > looks[1] > looks[2] > looks[4]
    assert looks[3] == pytest.approx(looks[4], abs=2e-3)
