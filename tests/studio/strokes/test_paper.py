"""The sheet's fields, and liquid that spreads without being lost."""

import numpy as np
import pytest

from pentimento.studio.strokes.sheet import absorbency_field, grain_field, spread, surface_height_m
from tests.studio.strokes.worlds import world_with

PAPER = world_with().paper


def test_grain_is_uniform_by_rank() -> None:
    grain = grain_field(PAPER, np.random.default_rng(0))
    assert grain.shape == (800, 1200)
    assert np.quantile(grain, [0.1, 0.5, 0.9]) == pytest.approx([0.1, 0.5, 0.9], abs=0.03)


def test_absorbency_varies_over_the_sheet_and_is_bounded() -> None:
    absorbency = absorbency_field(PAPER, np.random.default_rng(0))
    assert 0 <= absorbency.min() < absorbency.max() <= 1
    assert absorbency.std() > 0.05 * absorbency.mean()


def test_spreading_conserves_volume_and_widens() -> None:
    film = np.zeros((40, 40, 7), dtype=np.float32)
    film[20, 20] = 1.0
    grain = np.full((40, 40), 0.5, dtype=np.float32)
    spread(film, np.full((40, 40), 3.0, dtype=np.float32), grain)
    assert film.sum(axis=(0, 1)) == pytest.approx(np.ones(7), abs=1e-5)
    columns = np.arange(40) - 20
    assert np.sqrt((film[..., 0].sum(axis=0) * columns**2).sum()) == pytest.approx(3.0, rel=0.02)


def test_no_reach_leaves_the_film_alone() -> None:
    film = np.random.default_rng(0).random((9, 9, 7), dtype=np.float32)
    before = film.copy()
    spread(film, np.zeros((9, 9), dtype=np.float32), np.zeros((9, 9), dtype=np.float32))
    assert np.array_equal(film, before)


def test_the_sheet_lies_level_without_tilt_and_bowed_with_it() -> None:
    places = np.array([[0.0, 0.1], [0.15, 0.1], [0.3, 0.1]])
    assert not surface_height_m(PAPER, world_with().effects, places).any()
    low, middle, high = surface_height_m(PAPER, world_with(canvas_tilt=1.0).effects, places)
    assert high - low == pytest.approx(2 * PAPER.tilt_m[0])
    assert middle - (low + high) / 2 == pytest.approx(PAPER.bow_m)
