"""The noise floor: what even a perfect model would miss, read off repeated actions (GAP.md, rule 6)."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pentimento.gap.foretell import Model, residual
from pentimento.gap.measured import Measured

Array = NDArray[Any]


class Floor(NamedTuple):
    """Mean squared error, sRGB in [0, 1], of rows around the mean of their action."""

    mse: float
    interval: tuple[float, float]
    """95 %, by resampling actions."""


def noise_floor(model: Model, measured: Measured, seed: int) -> Floor | None:
    """None where no action is repeated.

    Of the *residuals*, so that what differs between repeats and is foretold (ink used up, paint below) is not noise.
    """
    rest, valid = residual(model, measured), measured.samples.valid.numpy()
    spreads = []
    for action in np.unique(measured.action):
        rows = np.flatnonzero(measured.action == action)
        same_window = all((valid[r] == valid[rows[0]]).all() for r in rows)
        if len(rows) < 2 or not same_window:
            continue
        pixels = valid[rows[0]].sum() * rest.shape[-1]
        spreads.append(np.square(rest[rows] - rest[rows].mean(0)).sum() / (len(rows) - 1) / pixels)
    if len(spreads) < 3:
        return None
    values = np.array(spreads)
    drawn = np.random.default_rng([seed, 8]).choice(values, (1999, len(values))).mean(1)
    low, high = np.quantile(drawn, [0.025, 0.975])
    return Floor(float(values.mean()), (float(low), float(high)))
