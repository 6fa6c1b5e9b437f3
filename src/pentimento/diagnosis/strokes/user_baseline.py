"""A stroke model that somebody plans with, beside the finder's own base: what it misses on sealed strokes.

Inference never sees it. The finder's base has its nuisances free (GAP.md, rule 2), and a given model has them where its
own training left them; how much of the given one's error the free base takes up without any cause is what calibrating
it better would gain.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pentimento.diagnosis.strokes.measured import Measured
from pentimento.diagnosis.strokes.predict import mean_squared_error
from pentimento.dynamics.strokes.traj2stroke import Traj2StrokeParameters

Array = NDArray[Any]


class Given(NamedTuple):
    """On sealed strokes."""

    predicted: Array
    """sRGB float32[B, H, W, 3]"""
    losses: Array
    """Mean squared error of each action over its rows and their windows, sRGB, in the order of the actions' numbers."""

    @property
    def mse(self) -> float:
        """Over actions."""
        return float(self.losses.mean())


def given_on(parameters: Traj2StrokeParameters, test_split: Measured) -> Given:
    """What a given model foretells of strokes, and by how much it misses them."""
    from pentimento.dynamics.strokes.evaluation import predict_with  # imports Lightning, which takes seconds

    predicted = predict_with(parameters, test_split.samples).numpy()
    missed = (test_split.samples.after.numpy() - predicted) * test_split.samples.valid.numpy()[..., None]
    _, group = np.unique(test_split.action, return_inverse=True)
    losses = np.bincount(group, mean_squared_error(missed, test_split)) / np.bincount(group)
    return Given(predicted, losses)
