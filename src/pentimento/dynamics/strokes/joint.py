"""Joint fit of Traj2Stroke and the mechanisms that extend it, by gradient descent."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from pentimento.dynamics.strokes.evaluation import predict, weighted_l1
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
from pentimento.dynamics.strokes.training import Log, TrainingConfig, descend
from pentimento.dynamics.strokes.traj2stroke import Traj2Stroke, Traj2StrokeParameters
from pentimento.planning.strokes.brush import StrokeTiming


@dataclass(frozen=True)
class JointFit:
    """Result of a joint fit."""

    model: StrokeModel
    """The extended model, or the base where the extension does not lower the validation loss."""
    kept: bool
    """Whether ``model`` is the extended one."""
    validation_l1: tuple[float, float]
    """Weighted L1 of the base and of the extended model."""


def fit_jointly(
    base: Traj2StrokeParameters,
    causes: Sequence[Mechanism],
    training: MeasuredStrokes,
    *,
    validation: MeasuredStrokes,
    timing: StrokeTiming,
    config: TrainingConfig,
    log: Log,
) -> JointFit:
    """Extend a trained base by ``causes``, which start from the values of a diagnosis.

    The result is the epoch with the lowest validation loss. Scale and offset start at the diagnosis's values, or at
    none: the base's compensate for the causes.
    """
    mechanisms = [mechanism for mechanism in causes if mechanism.cause not in BASE_CAUSES]

    def validation_loss(predicted: Tensor) -> float:
        return float(weighted_l1(predicted, validation.samples, config.ink_weight))

    with torch.no_grad():
        before = validation_loss(predict(Traj2Stroke(base), validation.samples))
    if not mechanisms:
        return JointFit(base_model(base), False, (before, before))
    torch.manual_seed(config.seed)
    model = _Joint(_start(base, causes), mechanisms)
    minimum, best = float("inf"), model.state_dict()

    def keep_best(epoch: int) -> None:
        nonlocal minimum, best
        with torch.no_grad():
            now = validation_loss(model(validation))
        log("validation_l1", now, epoch)
        if now < minimum:
            minimum, best = now, {name: value.clone() for name, value in model.state_dict().items()}

    descend(
        model,
        lambda index: model(training.pick(index)),
        training.samples,
        config=config,
        log=log,
        after_epoch=keep_best,
    )
    if minimum >= before:
        return JointFit(base_model(base), False, (before, minimum))
    model.load_state_dict(best)
    fitted = tuple(type(m)(m.values.detach(), m.reference) for m in model.mechanisms())
    spanned = spans(columns_read(fitted, training), training)
    return JointFit(StrokeModel(model.base.parameters_si(), fitted, spanned, timing), True, (before, minimum))


def _start(base: Traj2StrokeParameters, causes: Sequence[Mechanism]) -> Traj2StrokeParameters:
    seen = {mechanism.cause: mechanism.values.tolist() for mechanism in causes}
    scale, offset = seen.get("path_scale", (0.0, 0.0)), seen.get("path_offset", (0.0, 0.0))
    return Traj2StrokeParameters(
        (1 + scale[0], 1 + scale[1]), (offset[0], offset[1]), base.thickness_per_press, base.thickness_at_contact_m,
        base.softness, base.opacity,
    )  # fmt: skip


class _Joint(nn.Module):
    """A base and mechanisms. Values are in units of their typical sizes, for a common learning rate."""

    def __init__(self, base: Traj2StrokeParameters, mechanisms: Sequence[Mechanism]) -> None:
        super().__init__()
        self.base = Traj2Stroke(base)
        self._kinds = [(type(m), dict(m.reference)) for m in mechanisms]
        self.values = nn.ParameterList([nn.Parameter(m.values.float() / _typical(m)) for m in mechanisms])

    def mechanisms(self) -> list[Mechanism]:
        """The mechanisms with the present values, differentiable."""
        return [
            kind(values * _typical(kind), reference)
            for (kind, reference), values in zip(self._kinds, self.values, strict=True)
        ]

    def forward(self, strokes: MeasuredStrokes) -> Tensor:
        return predict_extended(self.base, self.mechanisms(), strokes)


def _typical(mechanism: Mechanism | type[Mechanism]) -> Tensor:
    return torch.tensor([quantity.typical for quantity in mechanism.quantities])
