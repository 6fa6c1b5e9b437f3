"""The noise floor of pushes is what repeats differ by, and of single pushes what theirs would."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pentimento.diagnosis.pushes.floor import floor_of_test_split, floor_while_searching, noise_floor
from pentimento.diagnosis.pushes.jacobian import action_losses
from pentimento.diagnosis.pushes.measured import measure
from pentimento.dynamics.pushes.analytic import first_model
from tests.dynamics.pushes.played_pushes import blank


def test_the_floor_is_the_scatter_of_repeats() -> None:
    samples = blank(12, 3)
    rng = np.random.default_rng(0)
    noisy = samples._replace(after=samples.after + 1e-4 * rng.standard_normal(samples.after.shape).astype(np.float32))
    measured = measure(noisy, 0.006)
    floor = noise_floor(first_model(measured.scene), measured, 0)
    assert floor is not None
    assert floor.mse == pytest.approx(0.01, rel=0.05)  # 0.1 mm of noise in the scan after; none in the one before


def test_without_repeats_the_floor_is_unknown() -> None:
    measured = measure(blank(12, 1), 0.006)
    assert noise_floor(first_model(measured.scene), measured, 0) is None
    assert floor_of_test_split(first_model(measured.scene), measured, np.arange(4), 0) is None


def test_sealed_repeats_have_their_own_floor_and_sealed_single_pushes_that_of_all_repeats() -> None:
    samples = blank(12, 3)
    measured = measure(samples, 0.006)
    repeated = np.unique(measured.action)[np.unique(measured.action, return_counts=True)[1] > 1]
    rng = np.random.default_rng(0)
    loud = measured.action == repeated[0]  # one action is noisier than all others
    noise_m = np.where(loud, 4e-4, 1e-4)[:, None, None] * rng.standard_normal(measured.after.shape)
    measured = replace(measured, after=measured.after + noise_m.astype(np.float32))
    model = first_model(measured.scene)

    def floor(*actions: int) -> float:
        found = floor_of_test_split(model, measured, np.flatnonzero(np.isin(measured.action, actions)), 0)
        assert found is not None and found.interval[0] <= found.mse <= found.interval[1]
        return found.mse

    single = np.setdiff1d(measured.action, repeated)
    everywhere = noise_floor(model, measured, 0)
    assert everywhere is not None
    assert floor(repeated[0]) == pytest.approx(0.16, rel=0.1)
    assert floor(repeated[1]) == pytest.approx(0.01, rel=0.1)
    assert floor(*single) == pytest.approx(everywhere.mse, rel=0.1)
    assert floor(repeated[1], single[0]) == pytest.approx((0.01 + everywhere.mse) / 2, rel=0.1)


def test_while_searching_the_floor_is_no_higher_than_what_is_searched() -> None:
    measured = measure(blank(12, 3), 0.006)
    repeats = [np.flatnonzero(measured.action == action) for action in np.unique(measured.action)]
    loud = np.isin(np.arange(len(measured)), np.concatenate([rows for rows in repeats if len(rows) > 1]))
    noise_m = 8e-4 * loud[:, None, None] * np.random.default_rng(0).standard_normal(measured.after.shape)
    measured = replace(measured, after=measured.after + noise_m.astype(np.float32))
    model = first_model(measured.scene)
    everywhere = noise_floor(model, measured, 0)
    assert everywhere is not None
    assert floor_while_searching(model, measured, np.flatnonzero(loud), 0) == pytest.approx(everywhere.mse)
    quiet = np.flatnonzero(~loud)
    error = float(action_losses(model, measured.pick(quiet)).mean())
    assert error < everywhere.mse
    assert floor_while_searching(model, measured, quiet, 0) == pytest.approx(error)
