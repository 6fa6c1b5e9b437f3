"""Models on strokes they were not fitted to: out-of-distribution evaluation, and a user-supplied baseline model."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pentimento.diagnosis.diagnose import gap_closed_on
from pentimento.diagnosis.strokes.measured import Measured
from pentimento.diagnosis.strokes.model import Model
from pentimento.diagnosis.strokes.predict import mean_squared_error
from pentimento.diagnosis.strokes.problem import FittedStrokes, StrokeProblem, StrokeResult
from pentimento.dynamics.strokes.evaluation import predict_with
from pentimento.dynamics.strokes.traj2stroke import Traj2StrokeParameters

Array = NDArray[Any]


def paints_of(measured: Measured) -> Array:
    """The distinct paints, sRGB [K, 3], in the order of ``measured.paint``; a colour with a mix for each session
    repeats.
    """
    _, first = np.unique(measured.paint, return_index=True)
    paints: Array = measured.samples.color.double().numpy()[first].round(3)
    return paints


def with_joint_paints(model: Model, paints: Array, measured: Measured) -> tuple[Model, Measured]:
    """Model and strokes with a joint numbering of paints: the model's, then the strokes'.

    Each paint of the strokes gets the mean offset of the model's mixes of its colour; an unknown colour gets none.

    Args:
        paints: [K, 3] sRGB, those of the model's colour offsets.
    """
    same = (paints_of(measured)[:, None] == paints.round(3)).all(-1)
    own = same @ model.color_offset / np.maximum(same.sum(1, keepdims=True), 1)
    offsets = np.concatenate([model.color_offset, own])
    return replace(model, color_offset=offsets), replace(
        measured, paint=len(paints) + measured.paint, paints=len(offsets)
    )


def gap_closed_outside(outside: Measured, problem: StrokeProblem, result: StrokeResult) -> float | None:
    """Fraction of the gap that the extension closes on strokes of another table; see ``gap_closed_on``.

    Raises:
        NotObservable: the table lacks a column that the extended model depends on.
    """
    paints = paints_of(problem.measured)
    base, extended = (with_joint_paints(fitted.model, paints, outside) for fitted in (result.base, result.extended))
    other = replace(problem, measured=base[1], base=base[0])
    return gap_closed_on(other, result, base=FittedStrokes(base[0]), extended=FittedStrokes(extended[0]))


class UserBaseline(NamedTuple):
    """A user-supplied baseline model on the test split.

    Inference never uses it. Its error above the base's, whose nuisances are free, is calibration (docs/diagnosis.md
    §10).
    """

    predicted: Array
    """sRGB float32[B, H, W, 3]"""
    losses: Array
    """Error of each action, sRGB, in the order of the action numbers."""

    @property
    def mse(self) -> float:
        """Mean over actions."""
        return float(self.losses.mean())


def evaluate_baseline(parameters: Traj2StrokeParameters, test_split: Measured) -> UserBaseline:
    """Predictions and errors of a user-supplied model on strokes."""
    predicted = predict_with(parameters, test_split.samples).numpy()
    missed = (test_split.samples.after.numpy() - predicted) * test_split.samples.valid.numpy()[..., None]
    _, group = np.unique(test_split.action, return_inverse=True)
    losses = np.bincount(group, mean_squared_error(missed, test_split)) / np.bincount(group)
    return UserBaseline(predicted, losses)
