"""Fit Traj2Stroke and the causes that extend it jointly, by the loop that trained Traj2Stroke alone."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.optimize import minimize
from torch import Tensor, nn
from torch.nn.utils import parameters_to_vector, vector_to_parameters

from pentimento.dynamics.strokes.evaluation import mean_squared_error
from pentimento.dynamics.strokes.extended import (
    BASE_CAUSES,
    MeasuredStrokes,
    StrokeModel,
    base_model,
    columns_read,
    predict_extended,
    spans,
)
from pentimento.dynamics.strokes.simulation import Mechanism
from pentimento.dynamics.strokes.training import Log, TrainingConfig, descend, predict, weighted_l1
from pentimento.dynamics.strokes.traj2stroke import Traj2Stroke, Traj2StrokeParameters
from pentimento.planning.strokes.brush import StrokeTiming


@dataclass(frozen=True)
class JointFit:
    """What came of it."""

    model: StrokeModel
    """The extended model, or the base where that foretells the validation strokes no worse."""
    kept: bool
    """Whether it is the extended one."""
    validation_l1: tuple[float, float]
    """Weighted L1 of the base and of the extended model."""


def fit_jointly(
    base: Traj2StrokeParameters,
    causes: Sequence[Mechanism],
    training: MeasuredStrokes,
    validation: MeasuredStrokes,
    timing: StrokeTiming,
    config: TrainingConfig,
    log: Log,
) -> JointFit:
    """Extend a trained base by ``causes``, which start from the values of a diagnosis.

    The values of the epoch that foretells the validation strokes best are taken, or what ``polish`` makes of them on
    the training strokes, where that foretells the others better still, by squared error, too: the pixels of few thin
    marks can be made to fit by chance. Scale and offset start where the diagnosis saw them, at none where it did not:
    those of the base had to make up for what the causes now say.
    """
    mechanisms = [mechanism for mechanism in causes if mechanism.cause not in BASE_CAUSES]

    def judged(predicted: Tensor) -> float:
        return float(weighted_l1(predicted, validation.samples, config.ink_weight))

    with torch.no_grad():
        before = judged(predict(Traj2Stroke(base), validation.samples))
    if not mechanisms:
        return JointFit(base_model(base), False, (before, before))
    torch.manual_seed(config.seed)
    model = _Joint(_start(base, causes), mechanisms)
    minimum, best = float("inf"), model.state_dict()

    def keep_best(epoch: int) -> None:
        nonlocal minimum, best
        with torch.no_grad():
            now = judged(model(validation))
        log("validation_l1", now, epoch)
        if now < minimum:
            minimum, best = now, {name: value.clone() for name, value in model.state_dict().items()}

    descend(model, lambda index: model(training.pick(index)), training.samples, config, log, keep_best)
    model.load_state_dict(best)
    squared = _squared_error(model, validation)
    polish(model, lambda: weighted_l1(model(training), training.samples, config.ink_weight))
    if _squared_error(model, validation) < squared:
        keep_best(config.epochs)
    if minimum >= before:
        return JointFit(base_model(base), False, (before, minimum))
    model.load_state_dict(best)
    fitted = tuple(type(m)(m.values.detach(), m.reference) for m in model.mechanisms())
    spanned = spans(columns_read(fitted, training), training)
    return JointFit(StrokeModel(model.base.parameters_si(), fitted, spanned, timing), True, (before, minimum))


def _squared_error(model: _Joint, strokes: MeasuredStrokes) -> float:
    with torch.no_grad():
        return mean_squared_error(model(strokes), strokes.samples)


def _start(base: Traj2StrokeParameters, causes: Sequence[Mechanism]) -> Traj2StrokeParameters:
    seen = {mechanism.cause: mechanism.values.tolist() for mechanism in causes}
    scale, offset = seen.get("path_scale", (0.0, 0.0)), seen.get("path_offset", (0.0, 0.0))
    return Traj2StrokeParameters(
        (1 + scale[0], 1 + scale[1]), (offset[0], offset[1]), base.thickness_per_press, base.thickness_at_contact_m,
        base.softness, base.opacity,
    )  # fmt: skip


class _Joint(nn.Module):
    """A base and mechanisms; their values count in typical sizes, for one learning rate."""

    def __init__(self, base: Traj2StrokeParameters, mechanisms: Sequence[Mechanism]) -> None:
        super().__init__()
        self.base = Traj2Stroke(base)
        self._kinds = [(type(m), dict(m.reference)) for m in mechanisms]
        self.values = nn.ParameterList([nn.Parameter(m.values.float() / _typical(m)) for m in mechanisms])

    def mechanisms(self) -> list[Mechanism]:
        """As they are now, differentiable."""
        return [
            kind(values * _typical(kind), reference)
            for (kind, reference), values in zip(self._kinds, self.values, strict=True)
        ]

    def forward(self, strokes: MeasuredStrokes) -> Tensor:
        return predict_extended(self.base, self.mechanisms(), strokes)


def _typical(mechanism: Mechanism | type[Mechanism]) -> Tensor:
    return torch.tensor([quantity.typical for quantity in mechanism.quantities])


_HELD = "softness_raw"
_STEP, _STEP_OF_VALUE = 0.1, 0.1
"""The first simplex, in the parameters' own units and as a share of each."""
_SAME_LOSS, _SAME_VALUE = 1e-4, 5e-3
"""A simplex whose corners differ by less, of the loss and in the parameters' units, has converged."""
_EVALUATIONS = 100
"""At most, for each parameter."""


def polish(model: torch.nn.Module, loss: Callable[[], Tensor]) -> None:
    """Lower the loss of the model as it is over its parameters but softness, in place, by Nelder-Mead (1965).

    The loss never rises. Parameters should count in units in which 0.1 is a small change.
    """
    parameters = [parameter for name, parameter in model.named_parameters() if not name.endswith(_HELD)]

    def loss_of(values: NDArray[np.float64]) -> float:
        vector_to_parameters(torch.from_numpy(values).float(), parameters)
        return float(loss())

    with torch.no_grad():
        start = parameters_to_vector(parameters).double().numpy().copy()
        corners = start + np.diag(_STEP + _STEP_OF_VALUE * np.abs(start))
        options = {
            "initial_simplex": np.vstack([start, corners]), "adaptive": True, "maxfev": _EVALUATIONS * len(start),
            "fatol": _SAME_LOSS * loss_of(start), "xatol": _SAME_VALUE,
        }  # fmt: skip
        found = minimize(loss_of, start, method="Nelder-Mead", options=options)
        vector_to_parameters(torch.from_numpy(found.x).float(), parameters)
