"""How well a fit knows its numbers: cluster-robust standard errors, the action being the unit (GAP.md, rule 1).

Pixels of one stroke err together, so that the curvature of the error alone would promise far too much: what is taken
is the sandwich  A^-1 (sum_i h_i h_i^T) A^-1  over actions i (Liang and Zeger 1986). A fit bends towards each stroke
that it has seen; few strokes and many nuisances make that more than half of what they scatter. So each score is what it
would be had the action been left out,  h_i = (1 - A_i A^-1)^-1 g_i  (CR3: Bell and McCaffrey 2002).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pentimento.diagnosis.strokes.fit import held
from pentimento.diagnosis.strokes.jacobian import Statistics, linearise
from pentimento.diagnosis.strokes.measured import Measured
from pentimento.diagnosis.strokes.predict import Model
from pentimento.dynamics.strokes.simulation import Mechanism

_SEEN = 1e-10
"""Of the largest curvature: what lies below is not seen at all."""
_OPEN = 0.01
"""Directions of which a single action decides all but so little tell nothing about its scatter."""


def values_with_errors(model: Model, mechanism: Mechanism, measured: Measured) -> dict[str, tuple[float, float]]:
    """Each quantity of a fitted mechanism with its standard error, both in the quantity's unit, by name.

    Args:
        model: fitted to ``measured``.
        mechanism: the model's, by its cause.
    """
    spread = covariance(held(linearise(model, measured), model))
    number = [m.cause for m in model.mechanisms].index(mechanism.cause)
    fitted = model.mechanisms[number]
    at = model.nuisances + sum(len(m.quantities) for m in model.mechanisms[:number])
    return {
        q.name: (float(value), float(np.sqrt(max(spread[at + i, at + i], 0.0)) * q.typical))
        for i, (q, value) in enumerate(zip(fitted.quantities, fitted.values, strict=True))
    }


def covariance(statistics: Statistics) -> NDArray[np.float64]:
    """Of all numbers of a fitted model, [P, P]."""
    whole = statistics.curvature.sum(0)
    unit = 1 / np.sqrt(np.where(np.diag(whole) > 0, np.diag(whole), 1.0))  # in which each number is seen as well
    size, direction = np.linalg.eigh(whole * np.outer(unit, unit))
    seen = size > _SEEN * size[-1]
    half = unit[:, None] * direction[:, seen] / np.sqrt(size[seen])
    # In these directions what an action decides of each, its leverage, lies between nothing and all.
    open_share, own = np.linalg.eigh(np.eye(half.shape[1]) - half.T @ statistics.curvature @ half)  # [n, K], [n, K, K]
    factor = np.where(open_share > _OPEN, 1 / np.maximum(open_share, _OPEN), 0.0)
    score = np.einsum("nij,ni->nj", own, statistics.slope @ half) * factor
    left_out = np.einsum("nij,nj->ni", own, score) @ half.T  # [n, P]: by what leaving an action out moves each number
    return np.asarray(left_out.T @ left_out)
