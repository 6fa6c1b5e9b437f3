"""Paint is neither made nor lost between the bristles and the sheet."""

import numpy as np
import pytest

from pentimento.studio.strokes.sweep import sweep

BRISTLES = 40


def _sweep(capacity: float, roughness: float = 0.5, load: float = 1.0, wet_volume: float = 0.0, pickup: float = 0.0):
    """A bundle drawn 60 cells to the right through the middle of 50 by 100 cells."""
    rng = np.random.default_rng(0)
    film = np.zeros((50, 100, 7), np.float32)
    wet = np.zeros_like(film)
    wet[..., 0], wet[..., 1:4] = wet_volume, 5 * wet_volume
    loads, belly = np.full(BRISTLES, load), np.array([load])
    centre = np.column_stack([np.linspace(20, 80, 60), np.full(60, 25.0)])
    colour = np.tile([1.0, 1.0, 1.0, 4.0, 4.0, 4.0], (BRISTLES, 1))
    each, pool = np.full(BRISTLES, capacity / BRISTLES), capacity
    sweep(
        film, wet, np.ones((50, 100), np.float32), rng.random((50, 100), dtype=np.float32), roughness,
        centre, np.full(60, 0.002), np.tile(np.eye(2) * 8, (60, 1, 1)), np.zeros((60, 2)), np.ones(60),
        rng.uniform(-0.7, 0.7, (BRISTLES, 2)), np.zeros(BRISTLES), np.ones(BRISTLES), colour,
        loads, np.full(BRISTLES, load), belly, each, pool, 1.1, pickup, 0.0,
    )  # fmt: skip
    return film, wet, loads, belly, colour


@pytest.mark.parametrize("capacity", [100.0, 1000.0, 10000.0])
def test_what_the_tool_loses_is_on_the_sheet(capacity: float) -> None:
    film, _, loads, belly, _ = _sweep(capacity)
    lost = capacity * (1 - loads.mean()) + capacity * (1 - belly[0])
    assert lost > 50
    assert film[..., 0].sum() == pytest.approx(lost, rel=1e-3)


def test_a_film_does_not_grow_beyond_what_a_full_tool_lays_down() -> None:
    film = _sweep(1e6)[0]
    assert film[..., 0].max() <= 1.0 + 1e-5
    assert np.median(film[25, 30:70, 0]) > 0.9


def test_an_empty_tool_leaves_nothing() -> None:
    assert not _sweep(1000.0, load=0.0)[0].any()


def test_a_tool_that_runs_dry_catches_only_the_grain() -> None:
    full, dry = _sweep(1e6)[0][..., 0], _sweep(1e6, load=0.1)[0][..., 0]
    core = np.s_[22:28, 30:70]
    assert (full[core] > 0.05).mean() > 0.99
    assert 0.02 < (dry[core] > 0.05).mean() < 0.9


def test_wet_paint_goes_into_the_bristles_volume_for_volume() -> None:
    _, wet, _, _, colour = _sweep(1e6, wet_volume=1.0, pickup=0.1)
    assert np.allclose(wet[..., 0], 1.0)
    assert colour[:, 0].mean() > 1.1
    assert wet[25, 50, 1] < 5
    clean = _sweep(1e6, wet_volume=1.0, pickup=0.0)
    assert np.all(clean[4][:, 0] == 1.0)


@pytest.mark.parametrize("load", [0.6, 0.9])
def test_an_endless_load_stays_as_it_was_filled(load: float) -> None:
    """What flows after replaces what was laid down: else every load would begin thin and grow."""
    _, _, loads, belly, _ = _sweep(1e30, load=load)
    np.testing.assert_array_equal(loads, load)
    assert belly[0] == load
