"""Boosted trees: they say of an action what they learnt from others, and take one thread."""

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


def test_what_was_not_grown_on_is_told_and_believed() -> None:
    features, missing, fold = drawn(0)
    _, said, share = cross_fitted(features, missing, np.ones(1200), fold, 40)
    assert np.corrcoef(said, missing)[0, 1] > 0.95 and share > 0.95


def test_elsewhere_they_say_what_they_learnt_of_others() -> None:
    features, missing, fold = drawn(0)
    grown, said, _ = cross_fitted(features, missing, np.ones(1200), fold, 40)
    np.testing.assert_allclose(predict_held_out(grown, features, fold), said)
    beyond = predict_held_out(grown, np.abs(features) + 1.0, fold)
    assert beyond.min() > 0.8
    unknown = np.arange(1200) < 30
    assert not predict_held_out(grown, features, np.where(unknown, -1, fold))[unknown].any()


def test_noise_is_hardly_believed() -> None:
    features, _, fold = drawn(1)
    noise = np.random.default_rng(2).normal(size=1200)
    assert cross_fitted(features, noise, np.ones(1200), fold, 40)[2] < 0.15


def test_they_take_one_thread_whatever_was_set(monkeypatch: pytest.MonkeyPatch) -> None:
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
        cross_fitted(features, missing, np.ones(1200), fold, 2)
    assert threads == [1] * 6
