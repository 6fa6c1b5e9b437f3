"""What searched pushes leave in doubt, and sealed ones settle; of strokes, see ``diagnosis.strokes.borderline``."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import combine_pvalues

from pentimento.diagnosis.pushes.fit import fit
from pentimento.diagnosis.pushes.jacobian import action_losses, linearise
from pentimento.diagnosis.pushes.measured import MeasuredPushes
from pentimento.diagnosis.pushes.search import MAX_CAUSES, Search, could_be_the_base
from pentimento.diagnosis.score import Step, paired_p, projected_statistics
from pentimento.dynamics.pushes.analytic import AnalyticPush

Array = NDArray[Any]

_BORDERLINE_P, _MAX = 0.35, 2
"""Beyond that p sealed pushes would be the only witness; of several in doubt, those that promise most are refitted."""
_TOGETHER_P = 0.003


def confirmations(model: AnalyticPush, measured: MeasuredPushes, test_split: Array, seed: int) -> dict[str, float]:
    """Of each cause of a model, as it was found: one-sided p that sealed pushes do not ask for it, by sign flips of
    their scores in its direction.

    Args:
        model: fitted to the searched pushes.
        measured: all pushes.
        sealed: which of their actions are sealed, [n].
    """
    if not model.mechanisms:
        return {}
    statistics, every = linearise(model, measured), np.arange(len(model.vector))
    confirmed = {}
    for mechanism in model.mechanisms:
        columns = model.columns_of(mechanism.cause)
        slope, curvature = projected_statistics(statistics, np.setdiff1d(every, columns), columns)
        values = model.vector[columns]
        asked = slope @ values + np.einsum("p,npq,q->n", values, curvature, values)
        confirmed[mechanism.cause] = paired_p(asked[test_split], seed)
    return confirmed


def with_one_borderline(
    found: Search, discovery_split: MeasuredPushes, measured: MeasuredPushes, test_split: Array, seed: int,
    log: Callable[[str], None],
) -> Search:  # fmt: skip
    """What was found, and beside it a cause that searched pushes speak for without being sure, where together with the
    sealed ones (Fisher 1925) they are, and of all of them it removes as much error as a cause must.

    Args:
        measured, sealed: as of ``confirmations``.
    """
    if len(found.found) == MAX_CAUSES:
        return found
    last = found.steps[-1]
    borderline = {
        c: e for c, e in last.evidence.items() if c in found.minimum and e.p_adjusted < _BORDERLINE_P and e.gain > 0
    }
    before = action_losses(found.model, measured)
    for cause in sorted(borderline, key=lambda cause: -borderline[cause].gain)[:_MAX]:
        mechanism = found.observable[cause]
        model = fit(found.model.plus(mechanism), discovery_split)
        falls = before - action_losses(model, measured)
        enough = model.mechanisms[-1].physical and falls.mean() >= found.minimum[cause]
        if not enough or could_be_the_base(mechanism, falls, seed):
            continue
        confirmed_p = confirmations(model, measured, test_split, seed)[cause]
        together_p = float(combine_pvalues([borderline[cause].p_adjusted, confirmed_p], method="fisher").pvalue)
        if together_p < _TOGETHER_P:
            log(f"{cause}: in doubt, and not with the sealed pushes (p {together_p:.2g})")
            evidence = {**last.evidence, cause: borderline[cause]._replace(p_adjusted=together_p)}
            return replace(found, model=model, steps=(*found.steps[:-1], Step(evidence, cause, ()), last))
    return found
