"""Means over strokes with intervals: strokes are drawn with replacement within each seed, then averaged over seeds."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.statistics import Estimate, interval, resamples
from studies.stroke_models.compare import Results

_DRAWS = 2000


def estimate(runs: Sequence[Results], model: str, test: str, score: str) -> Estimate:
    """Of one score of one model over the strokes of a test set, in all runs."""
    drawn, mean = _means(runs, model, test, score)
    return Estimate(mean, *interval(drawn))


def ratio(runs: Sequence[Results], model: str, other: str, test: str, score: str) -> Estimate:
    """Of two models' means, drawn on the same strokes."""
    (drawn, mean), (drawn_other, mean_other) = (_means(runs, name, test, score) for name in (model, other))
    return Estimate(mean / mean_other, *interval(drawn / drawn_other))


def mean_of(run: Results, model: str, test: str, score: str) -> float:
    """In one run; strokes without a score (an IoU without ink) do not count."""
    return float(np.nanmean(run[model]["scores"][test][score]))


def _means(runs: Sequence[Results], model: str, test: str, score: str) -> tuple[NDArray[np.float64], float]:
    """[draws] and the mean itself; the same strokes are drawn for every model."""
    drawn, means = [], []
    for number, run in enumerate(runs):
        values = np.array(run[model]["scores"][test][score], dtype=float)
        at = resamples(len(values), _DRAWS, [number, 41])
        drawn.append(np.nanmean(values[at], axis=1))
        means.append(np.nanmean(values))
    return np.mean(drawn, axis=0), float(np.mean(means))
