"""Temporal drift is separated from noise, and from the variance of repeats."""

import numpy as np
import pytest
from numpy.typing import NDArray

from pentimento.diagnosis.residual_structure import ModeScores
from pentimento.diagnosis.temporal_drift import TemporalDrift, temporal_drift

Array = NDArray[np.float64]

ROWS, REPEATED, TIMES = 168, 24, 3
ENERGY, ERROR = 0.02, 0.05
NOISE = 0.5
TURN = np.arange(ROWS)


def actions(rng: np.random.Generator, back_to_back: bool = False) -> NDArray[np.int64]:
    """Single actions and repeated ones in random order, or each one's repeats directly after one another."""
    single = np.arange(ROWS - REPEATED * TIMES)
    repeated = np.arange(REPEATED) + len(single)
    if back_to_back:
        return np.concatenate([np.repeat(repeated, TIMES), single])
    return rng.permutation(np.concatenate([single, np.repeat(repeated, TIMES)]))


def state(period: float) -> Array:
    return np.sqrt(2) * np.sin(2 * np.pi * np.arange(ROWS) / period)


def scored(amounts: Array, error: float = ERROR) -> ModeScores:
    return ModeScores(amounts, np.full(amounts.shape, ENERGY), error)


def found_in(scores: Array, action: NDArray[np.int64], seed: int = 0) -> TemporalDrift | None:
    return temporal_drift(("blur", "width"), scored(scores), action, turn=TURN, seed=seed)


@pytest.mark.parametrize("period", [15.0, 40.0])
def test_finds_drift_in_its_mode_with_its_error(period: float) -> None:
    rng = np.random.default_rng(1)
    scores = NOISE * rng.standard_normal((ROWS, 2))
    scores[:, 1] += state(period)
    found = found_in(scores, actions(rng))
    assert found is not None and found.mode == "width" and found.p < 0.001
    # Neighbours are a step apart: they share cos(2 pi / period) of it.
    assert found.mse == pytest.approx(ENERGY * np.cos(2 * np.pi / period), rel=0.15)
    assert found.mse_of_repeats == pytest.approx(found.mse, rel=0.25)
    assert np.corrcoef(found.amount, state(period))[0, 1] > 0.8


def test_drift_does_not_depend_on_the_row_order_in_the_table() -> None:
    rng = np.random.default_rng(2)
    scores, action = NOISE * rng.standard_normal((ROWS, 2)), actions(rng)
    scores[:, 1] += state(20)
    shuffled = rng.permutation(ROWS)
    found = temporal_drift(("blur", "width"), scored(scores[shuffled]), action[shuffled], turn=shuffled, seed=0)
    unshuffled = found_in(scores, action)
    assert found is not None and unshuffled is not None and found.mse == pytest.approx(unshuffled.mse, rel=1e-9)
    assert found.amount == pytest.approx(unshuffled.amount)


def test_consecutive_repeats_contain_no_drift() -> None:
    rng = np.random.default_rng(3)
    scores = NOISE * rng.standard_normal((ROWS, 2))
    scores[:, 1] += state(60)
    found = found_in(scores, actions(rng, back_to_back=True))
    assert found is not None and found.mse > 0.8 * ENERGY
    assert found.mse_of_repeats < 0.15 * found.mse


def test_action_specific_misfit_is_no_drift() -> None:
    """Consecutive repeats share the model's error about their action."""
    rng = np.random.default_rng(4)
    action = actions(rng, back_to_back=True)
    own = rng.standard_normal((ROWS, 2))[action]
    assert found_in(own + NOISE * rng.standard_normal((ROWS, 2)), action) is None


def test_noise_is_no_drift() -> None:
    found = []
    for seed in range(40):
        rng = np.random.default_rng([5, seed])
        found.append(found_in(rng.standard_normal((ROWS, 2)), actions(rng), seed))
    assert sum(one is not None for one in found) <= 2


def test_tiny_drift_is_not_reported() -> None:
    rng = np.random.default_rng(7)
    scores = NOISE * rng.standard_normal((ROWS, 2))
    scores[:, 1] += state(20)
    assert temporal_drift(("blur", "width"), scored(scores, 100 * ERROR), actions(rng), turn=TURN, seed=0) is None


def test_zero_residual_has_no_drift() -> None:
    rng = np.random.default_rng(8)
    nothing, single = np.zeros((ROWS, 2)), np.zeros(1, int)
    assert temporal_drift(("blur", "width"), scored(nothing, 0.0), actions(rng), turn=TURN, seed=0) is None
    one = ModeScores(np.ones((1, 1)), np.ones((1, 1)), 1.0)
    assert temporal_drift(("width",), one, single, turn=single, seed=0) is None
