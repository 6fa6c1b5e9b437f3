import numpy as np
import pytest

from pentimento.collection.pushes import repeat_floor_mm2, volume_figures

BEFORE = np.full((3, 10, 10), 0.04)
KNOWN = np.ones(BEFORE.shape, np.bool_)


def test_material_that_only_moves_is_kept() -> None:
    after = BEFORE.copy()
    after[:, 2, 2:6] -= 0.004
    after[:, 7, 2:6] += 0.004
    figures = volume_figures(BEFORE, after, KNOWN, np.zeros(3))
    assert figures["volume_change_mean"] == pytest.approx(0.0, abs=1e-12)
    assert figures["dent_volume_lost"] == pytest.approx(0.0, abs=1e-9)


def test_half_of_a_dent_that_comes_up_nowhere() -> None:
    after = BEFORE.copy()
    after[:, 2, 2:6] -= 0.004
    after[:, 7, 2:6] += 0.002
    figures = volume_figures(BEFORE, after, KNOWN, np.array([0.0, 1.0, np.nan]))
    assert figures["volume_change_mean"] == pytest.approx(-0.008 / 4.0)
    assert figures["volume_change_sd"] == pytest.approx(0.0, abs=1e-12)
    assert figures["dent_volume_lost"] == pytest.approx(0.5)
    assert figures["volume_change_between_smoothings"] == pytest.approx(-0.008 / 4.0)


def test_between_smoothings_counts_from_the_first_to_the_last_push() -> None:
    before = np.stack([BEFORE[0], BEFORE[0] * 0.9, BEFORE[0] * 0.8])
    after = np.stack([BEFORE[0] * 0.9, BEFORE[0] * 0.8, BEFORE[0] * 0.6])
    figures = volume_figures(before, after, KNOWN, np.zeros(3))
    assert figures["volume_change_between_smoothings"] == pytest.approx(-0.4)
    assert "volume_change_between_smoothings" not in volume_figures(before, after, KNOWN, np.full(3, np.nan))


def test_holes_do_not_count() -> None:
    after, known = BEFORE.copy(), KNOWN.copy()
    after[:, 0, 0] = 7.0
    known[:, 0, 0] = False
    assert volume_figures(BEFORE, after, known, np.zeros(3))["volume_change_mean"] == 0.0
    assert repeat_floor_mm2(BEFORE, after, known, np.zeros(3)) == 0.0


def test_the_floor_is_the_unbiased_scatter_of_repeats() -> None:
    rng = np.random.default_rng(0)
    before = np.full((600, 8, 8), 0.04)
    after = before + 1e-4 * rng.standard_normal(before.shape)
    actions = np.repeat(np.arange(200), 3)
    floor = repeat_floor_mm2(before, after, np.ones(before.shape, np.bool_), actions)
    assert floor == pytest.approx(0.01, rel=0.03)
    assert repeat_floor_mm2(before, after, np.ones(before.shape, np.bool_), np.arange(600)) is None
