"""Measured strokes as a problem of the diagnosis."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self, cast

import numpy as np
import torch
from numpy.typing import NDArray

from pentimento.diagnosis.diagnose import Result
from pentimento.diagnosis.evaluation import Floor
from pentimento.diagnosis.gauss_newton import Statistics
from pentimento.diagnosis.mechanistic import FittedModel
from pentimento.diagnosis.problem import Cause, Quantity, Rows
from pentimento.diagnosis.residual_structure import ModeScores
from pentimento.diagnosis.strokes.fit import choose_mixing, first_model, fit, huber_weighted, stiffened
from pentimento.diagnosis.strokes.jacobian import linearise
from pentimento.diagnosis.strokes.learned_residual import learn_residual
from pentimento.diagnosis.strokes.measured import Measured, covariates_shown
from pentimento.diagnosis.strokes.model import Model, UnevenEnds, observable_causes
from pentimento.diagnosis.strokes.modes import MODES, mode_scores
from pentimento.diagnosis.strokes.predict import action_losses, noise_floor
from pentimento.dynamics.strokes.mechanisms.bristle_lag import BristleLag
from pentimento.dynamics.strokes.mechanisms.geometry import speed_m_s
from pentimento.dynamics.strokes.mechanisms.latency import Latency
from pentimento.dynamics.strokes.mechanisms.lens_distortion import LensDistortion
from pentimento.dynamics.strokes.simulation import Mechanism

Array = NDArray[Any]

FittedStrokes = FittedModel[Model]
StrokeResult = Result[FittedStrokes]
_MIN_ABSORBED = -0.5
"""Lower bound of a lens's linear displacement at the strokes' edge, which rectification absorbs, relative to its cubic
one."""
_MAX_ABSORBED = 3.0
"""Upper bound of the same."""


@dataclass(frozen=True, eq=False)
class StrokeProblem:
    """Measured strokes and the stroke model."""

    measured: Measured
    base: Model
    """Without causes; fitted by ``prepared``, which also chooses how paint mixes."""
    mechanisms: Mapping[str, Mechanism]
    """Of each cause, with all quantities 0."""
    causes: Mapping[str, Cause]
    unobservable: Mapping[str, str]
    seed: int
    kind: str = "strokes"
    unit: str = "sRGB²"
    modes: tuple[str, ...] = MODES

    @property
    def rows(self) -> Rows:
        """See ``Problem``."""
        m = self.measured
        return Rows(m.action, m.block, m.turn, covariates_shown(m))

    def pick(self, rows: Array) -> Self:
        """See ``Problem``."""
        return replace(self, measured=self.measured.pick(rows))

    def prepared(self) -> Self:
        """Weights of the strokes, and the base's power of light in which paint mixes."""
        base = choose_mixing(fit(first_model(self.measured), self.measured), self.measured, self.seed)
        return replace(self, base=base, measured=huber_weighted(self.measured, base))

    def fit(self, causes: Sequence[str], start: FittedStrokes | None = None) -> FittedStrokes:
        """See ``Problem``."""
        model = self.base if start is None else start.model
        model = model.without(*(m.cause for m in model.mechanisms if m.cause not in causes))
        taken = {m.cause for m in model.mechanisms}
        new = [self.mechanisms[name] for name in causes if name not in taken]
        starts = [model.plus(*new)]
        far = [m for m in new if isinstance(m, BristleLag | Latency)]
        if far:  # a lag beyond a half-width shows little at 0
            starts.append(model.plus(*(_at_typical_size(m) if m in far else m for m in new)))
        fits = [fit(each, self.measured) for each in starts]
        return FittedStrokes(min(fits, key=lambda each: float(action_losses(each, self.measured).mean())))

    def losses(self, model: FittedStrokes) -> Array:
        """See ``Problem``."""
        return action_losses(model.model, self.measured)

    def linearise(self, model: FittedStrokes, candidates: Sequence[str]) -> Statistics:
        """See ``Problem``."""
        full = model.model.plus(*(self.mechanisms[name] for name in candidates))
        return stiffened(linearise(full, self.measured), full, 1.0)

    def floor(self, model: FittedStrokes) -> Floor | None:
        """See ``Problem``."""
        return noise_floor(model.model, self.measured, self.seed)

    def mode_scores(self, model: FittedStrokes) -> ModeScores:
        """See ``Problem``."""
        return mode_scores(model.model, self.measured)

    def learn_residual(self, model: FittedStrokes, candidates: Sequence[str]) -> tuple[Self, Callable[[Self], Self]]:
        """See ``Problem``."""
        others = [self.mechanisms[name] for name in candidates]
        rows = np.arange(len(self.measured))
        learned, measured = learn_residual(self.measured, model.model, rows, candidates=others, seed=self.seed)

        def predict(other: Self) -> Self:
            own = learned.model.color_offset
            offsets = np.concatenate([own, other.base.color_offset[len(own) :]])  # paints of another table
            known = learned.seen_from(replace(learned.model, color_offset=offsets))
            return replace(other, measured=replace(known.of(other.measured), weight=np.ones(len(other.measured))))

        return replace(self, measured=huber_weighted(measured, model.model)), predict


def stroke_problem(measured: Measured, vocabulary: Sequence[type[Mechanism]], seed: int) -> StrokeProblem:
    """The problem of measured strokes."""
    by_measured_path = measured.following is not None
    seen, unseen = observable_causes((*vocabulary, UnevenEnds), measured.context, path_measured=by_measured_path)
    causes = {name: _cause(mechanism) for name, mechanism in seen.items()}
    return StrokeProblem(measured, first_model(measured), seen, causes, unseen, seed)


def as_commanded(model: Model, measured: Measured) -> Model:
    """A model of executed paths as one of commands, by which a robot plans: with the robot's delay, if it has one."""
    if measured.following is None or not measured.following.late:
        return model
    reference = {"speed_m_s": float(speed_m_s(measured.context.path).log().mean().exp())}
    return model.plus(Latency(torch.tensor([measured.following.delay_s], dtype=torch.float64), reference))


def established_mechanisms(result: StrokeResult, *, suspected: bool = False) -> list[Mechanism]:
    """Mechanisms of the established causes, and of the robot's measured delay, for a model that takes commands.

    Args:
        suspected: of the suspected causes, too.
    """
    findings = (*result.established, *result.suspected) if suspected else result.established
    names = {finding.cause for finding in findings} | {Latency.cause}
    fitted = result.decided.model if suspected else result.extended
    model = as_commanded(fitted.model, cast(StrokeProblem, result.problem).measured)
    return [mechanism for mechanism in model.mechanisms if mechanism.cause in names]


def with_learned_residual(result: StrokeResult) -> Measured:
    """All strokes with the predictions of the learned residual model, cross-fitted outside the test split."""
    rows = np.sort(np.concatenate(result.splits[:2])), result.splits.test
    measured = cast(StrokeProblem, result.problem).measured
    learned = np.zeros_like(measured.residual_prediction)
    for index, part in zip(rows, (result.known, result.test), strict=True):
        learned[index] = cast(StrokeProblem, part).measured.residual_prediction
    return replace(measured, residual_prediction=learned)


def _cause(mechanism: Mechanism) -> Cause:
    return Cause(
        name=mechanism.cause,
        quantities=tuple(Quantity(*q) for q in mechanism.quantities),
        covariates=mechanism.informative_covariates,
        family=mechanism.driving_covariate,
        signature=mechanism.signature,
        named=not isinstance(mechanism, UnevenEnds),
        is_possible=_is_one_picture if isinstance(mechanism, LensDistortion) else None,
    )


def _is_one_picture(lens: Array) -> bool:
    """Whether a lens's cubic and absorbed linear displacement, in typical sizes, can belong to one rectified picture.

    A purely linear displacement is a wrong scale and no lens.
    """
    cubic, absorbed = lens * [q.typical for q in LensDistortion.quantities]
    return bool(_MIN_ABSORBED * cubic**2 <= absorbed * cubic <= _MAX_ABSORBED * cubic**2)


def _at_typical_size(mechanism: Mechanism) -> Mechanism:
    typical = torch.tensor([q.typical for q in mechanism.quantities], dtype=torch.float64)
    return type(mechanism)(typical, mechanism.reference)
