"""Cross-fitted trees predict held-out actions and use one thread."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from sklearn.ensemble import HistGradientBoostingRegressor
from sklearn.utils._openmp_helpers import _openmp_effective_n_threads
from threadpoolctl import threadpool_limits

from pentimento.diagnosis import boosting
from pentimento.diagnosis.boosting import cross_fitted, predict_held_out


def drawn(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Features [n, 2], a step in the first of them under noise, and folds of pixels."""
    rng = np.random.default_rng(seed)
    features = rng.normal(size=(1200, 2))
    return features, np.where(features[:, 0] > 0.3, 1.0, 0.0) + 0.1 * rng.normal(size=1200), np.arange(1200) % 3


def test_held_out_predictions_recover_the_signal() -> None:
    features, missing, fold = drawn(0)
    _, predictions, share = cross_fitted(features, missing, np.ones(1200), fold=fold, count=40)
    assert np.corrcoef(predictions, missing)[0, 1] > 0.95 and share > 0.95


def test_pixels_without_a_fold_get_the_mean_of_all_folds() -> None:
    features, missing, fold = drawn(0)
    trees, predictions, _ = cross_fitted(features, missing, np.ones(1200), fold=fold, count=40)
    np.testing.assert_allclose(predict_held_out(trees, features, fold), predictions)
    beyond = predict_held_out(trees, np.abs(features) + 1.0, fold)
    assert beyond.min() > 0.8
    unknown = np.arange(1200) < 30
    assert not predict_held_out(trees, features, np.where(unknown, -1, fold))[unknown].any()


def test_shrinkage_of_noise_is_near_zero() -> None:
    features, _, fold = drawn(1)
    noise = np.random.default_rng(2).normal(size=1200)
    assert cross_fitted(features, noise, np.ones(1200), fold=fold, count=40).share < 0.15


def test_trees_use_one_openmp_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    threads: list[int] = []

    class Counting(HistGradientBoostingRegressor):
        def fit(self, *given: Any) -> Any:
            threads.append(_openmp_effective_n_threads())
            return super().fit(*given)

        def predict(self, *given: Any) -> Any:
            threads.append(_openmp_effective_n_threads())
            return super().predict(*given)

    monkeypatch.setattr(boosting, "HistGradientBoostingRegressor", Counting)
    features, missing, fold = drawn(3)
    with threadpool_limits(2, "openmp"):
        cross_fitted(features, missing, np.ones(1200), fold=fold, count=2)
    assert threads == [1] * 6
