"""What searched pushes leave in doubt, and sealed ones settle; of strokes, see ``gap.in_doubt``.

Only causes that no base can look like: of the others, the scores of all pushes together are as sure of what a base gets
wrong.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import combine_pvalues

from pentimento.gap.choice import Step, paired_p
from pentimento.gap.pushes.fit import fit
from pentimento.gap.pushes.jacobian import linearise
from pentimento.gap.pushes.measured import MeasuredPushes
from pentimento.gap.pushes.search import FIRST_P, LATER_P, MOST_CAUSES, Search
from pentimento.gap.score import projected
from pentimento.push_dynamics.analytic import AnalyticPush

Array = NDArray[Any]

_IN_DOUBT_P = 0.35
"""Beyond, sealed pushes would be the only witness."""
_TOGETHER_P = 0.01


def confirmations(model: AnalyticPush, measured: MeasuredPushes, sealed: Array, seed: int) -> dict[str, float]:
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
        slope, curvature = projected(statistics, np.setdiff1d(every, columns), columns)
        values = model.vector[columns]
        asked = slope @ values + np.einsum("p,npq,q->n", values, curvature, values)
        confirmed[mechanism.cause] = paired_p(asked[sealed], seed)
    return confirmed


def with_one_in_doubt(
    found: Search, searched: MeasuredPushes, measured: MeasuredPushes, sealed: Array, seed: int,
    log: Callable[[str], None],
) -> Search:  # fmt: skip
    """What was found, and beside it the cause that searched pushes speak for most without being sure, where together
    with the sealed ones (Fisher 1925) they are.

    Args:
        measured, sealed: as of ``confirmations``.
    """
    last, limit = found.steps[-1], LATER_P if found.found else FIRST_P
    in_doubt = {
        cause: e.p_adjusted
        for cause, e in last.evidence.items()
        if cause not in found.found
        and not found.observable[cause].imitable
        and limit <= e.p_adjusted < _IN_DOUBT_P
        and e.gain > 0
    }
    if not in_doubt or len(found.found) == MOST_CAUSES:
        return found
    cause = min(in_doubt, key=lambda cause: in_doubt[cause])
    model = fit(found.model.plus(found.observable[cause]), searched)
    if not model.mechanisms[-1].physical:
        return found
    confirmed_p = confirmations(model, measured, sealed, seed)[cause]
    together_p = float(combine_pvalues([in_doubt[cause], confirmed_p], method="fisher").pvalue)
    if together_p >= _TOGETHER_P:
        return found
    log(f"{cause}: in doubt, and not with the sealed pushes (p {together_p:.2g})")
    evidence = {**last.evidence, cause: last.evidence[cause]._replace(p_adjusted=together_p)}
    return replace(found, model=model, steps=(*found.steps[:-1], Step(evidence, cause, ()), last))
