"""Means over seeds with Student's t intervals."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.stats import t

from pentimento.contracts.statistics import Estimate

_LEVEL = 0.95


def mean_interval(values: Sequence[float]) -> Estimate:
    """Mean of independent values and its 95 % interval; the bounds of a single value are NaN."""
    mean, count = float(np.mean(values)), len(values)
    if count == 1:
        return Estimate(mean, float("nan"), float("nan"))
    half = float(t.ppf((1 + _LEVEL) / 2, count - 1) * np.std(values, ddof=1) / np.sqrt(count))
    return Estimate(mean, mean - half, mean + half)
