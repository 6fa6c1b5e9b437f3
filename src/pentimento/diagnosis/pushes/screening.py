"""What the report on pushes shows beside the verdict: modes, imitation, power; numbers only."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pentimento.diagnosis.experiment_design import Aliasing, Columns, aliasing, detectable
from pentimento.diagnosis.pushes.diagnose import PushDiagnosis
from pentimento.diagnosis.pushes.jacobian import linearise, residual
from pentimento.diagnosis.pushes.measured import MeasuredPushes
from pentimento.diagnosis.pushes.modes import MODES, covariates_shown, mode_scores
from pentimento.diagnosis.pushes.search import observable_causes
from pentimento.diagnosis.residual_structure import Dependence, dependences, mode_strength, robust_deviations
from pentimento.dynamics.pushes.analytic import AnalyticPush
from pentimento.dynamics.pushes.mechanisms import VOCABULARY

Array = NDArray[Any]


class PushSurvey(NamedTuple):
    """All that is drawn."""

    measured: MeasuredPushes
    test_split: MeasuredPushes
    full: AnalyticPush
    """The extended model with every other observable cause at no effect."""
    aliasing: Aliasing
    detectable: dict[str, float]
    """Smallest share of the error that a cause must remove to be found in four of five such collections."""
    base_strength: Array
    """[modes, covariates] of the base's residual, correlation times the root of the number of pushes."""
    extended_strength: Array
    covariates: tuple[str, ...]
    modes: tuple[str, ...]
    dependence: tuple[Dependence, ...]
    base_residual: Array
    """[B, H, W] of all pushes, measured less foretold, mm; NaN where nothing was measured."""
    extended_residual: Array


def survey(diagnosis: PushDiagnosis) -> PushSurvey:
    """Look at base and extended model over all pushes."""
    measured = diagnosis.measured
    there = {mechanism.cause for mechanism in diagnosis.extended.mechanisms}
    others, _ = observable_causes(measured, [kind for kind in VOCABULARY if kind.cause not in there])
    full = diagnosis.extended.plus(*others.values())
    statistics, columns = linearise(full, measured), columns_of(full)
    covariates = covariates_shown(measured)
    models = {"base": diagnosis.base, "extended": diagnosis.extended}
    amounts = {name: robust_deviations(mode_scores(model, measured)[0]) for name, model in models.items()}
    strengths = {name: mode_strength(values, covariates) for name, values in amounts.items()}
    rests = {name: np.where(measured.valid, residual(model, measured), np.nan) for name, model in models.items()}
    return PushSurvey(
        measured=measured,
        test_split=measured.pick(diagnosis.parts.test_split),
        full=full,
        aliasing=aliasing(statistics, columns),
        detectable=detectable(statistics, columns),
        base_strength=strengths["base"],
        extended_strength=strengths["extended"],
        covariates=tuple(covariates),
        modes=MODES,
        dependence=dependences(MODES, amounts["base"], amounts["extended"], covariates, strengths, measured.action),
        base_residual=rests["base"],
        extended_residual=rests["extended"],
    )


def columns_of(model: AnalyticPush) -> Columns:
    """Indices into the Jacobian of ``model``: nuisances, and the quantities of each of its mechanisms."""
    causes = {mechanism.cause: model.columns_of(mechanism.cause) for mechanism in model.mechanisms}
    return Columns(np.arange(model.nuisances), causes)
