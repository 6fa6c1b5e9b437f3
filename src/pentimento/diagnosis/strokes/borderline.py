"""What searched strokes leave in doubt, and confirming strokes settle.

A faint cause may miss the limit of the search and be as clear on the strokes that had no part in it. The two sets are
independent, so that their p can be combined: that over all candidates on the searched strokes, and that of the one
cause which is then looked for on the others (Fisher 1925).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import combine_pvalues

from pentimento.diagnosis.choice import choose, paired_p
from pentimento.diagnosis.score import projected
from pentimento.diagnosis.strokes.candidates import FIRST_P, LATER_P, held_out_losses, refits_with, stands
from pentimento.diagnosis.strokes.fit import held
from pentimento.diagnosis.strokes.jacobian import linearise
from pentimento.diagnosis.strokes.measured import Measured
from pentimento.diagnosis.strokes.predict import Model, action_losses
from pentimento.diagnosis.strokes.search import MAX_CAUSES, Search, enough, is_kin_of_what_suffices

Array = NDArray[Any]

_BORDERLINE_P, _MAX = 0.35, 2
"""Beyond that p confirming strokes would be the only witness; of several in doubt, the first are refitted."""


def confirmation(model: Model, cause: str, known: Measured, fresh: Array, seed: int) -> float:
    """One-sided p that strokes which were not searched do not ask for the cause, as it was found: sign flips of their
    scores in its direction (a difference of losses would have half the power).

    Args:
        model: with the cause, fitted to the searched strokes.
        known: those and the confirming ones.
        fresh: which of their actions are confirming ones, [n].
    """
    statistics = held(linearise(model, known), model)
    columns = model.columns_of(cause)
    rest = np.setdiff1d(np.arange(len(model.vector)), columns)
    slope, curvature = projected(statistics, rest, columns)
    values = model.vector[columns]
    return paired_p((slope @ values + np.einsum("p,npq,q->n", values, curvature, values))[fresh], seed)


def with_one_borderline(
    found: Search, discovery_split: Measured, known: Measured, fresh: Array, seed: int, log: Callable[[str], None]
) -> Search:
    """What was found, and beside it the cause that searched strokes speak for most without being sure, where together
    with the confirming strokes they are.

    Args:
        known, fresh: as of ``confirmation``.
    """
    last, limit = found.steps[-1], LATER_P if found.found else FIRST_P
    borderline = {
        cause: e.p_adjusted
        for cause, e in last.evidence.items()
        if cause not in found.found and not stands(e, limit) and e.gain > 0 and e.p_adjusted < _BORDERLINE_P
    }
    if not borderline or len(found.found) == MAX_CAUSES:
        return found
    tried = [
        cause
        for cause in sorted(borderline, key=lambda cause: borderline[cause])[:_MAX]
        if not is_kin_of_what_suffices(cause, found.model, found.observable, discovery_split, seed)
    ]
    refits = refits_with(found.model, tried, found.observable, discovery_split)
    before = action_losses(found.model, discovery_split)
    error = float(before.mean())
    losses = {cause: held_out_losses(refit, discovery_split, seed) for cause, refit in refits.items()}
    size = {cause: float((before - each).mean()) for cause, each in losses.items()}
    losses = {c: each for c, each in losses.items() if size[c] >= enough(found.observable[c], error, found)}
    if not losses:
        return found
    step = choose(last.evidence, losses, error, refits, discovery_split, seed, lambda _: None)
    cause = step.chosen
    assert cause is not None
    confirmed_p = confirmation(refits[cause], cause, known, fresh, seed)
    together_p = float(combine_pvalues([last.evidence[cause].p_adjusted, confirmed_p], method="fisher").pvalue)
    if together_p >= limit:
        return found
    log(f"{cause}: in doubt, and not with the confirming strokes (p {together_p:.2g})")
    evidence = {**last.evidence, cause: last.evidence[cause]._replace(p_adjusted=together_p)}
    return replace(
        found,
        model=refits[cause],
        steps=(*found.steps[:-1], replace(step, evidence=evidence), last),
        gained={**found.gained, cause: size[cause]},
    )
