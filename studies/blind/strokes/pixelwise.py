"""A baseline for the diagnosis: selects causes by the likelihood of pixels, as if pixel errors were independent.

At the fitted base, forward selection by the Bayesian information criterion (Schwarz 1978) on the quadratic model of
the squared error: n log(error) + k log(n) over all n pixel values. Base and candidates are those of the diagnosis; its
unit of observation is the pixel and not the action.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pentimento.diagnosis.strokes.jacobian import linearise
from pentimento.diagnosis.strokes.measured import Measured
from pentimento.diagnosis.strokes.model import Model, observable_causes
from pentimento.dynamics.strokes.simulation import Mechanism

Array = NDArray[Any]


def named_by_pixels(base: Model, measured: Measured, vocabulary: Sequence[type[Mechanism]]) -> tuple[str, ...]:
    """The selected causes, in order of selection."""
    candidates = list(observable_causes(vocabulary, measured.context)[0].values())
    model = base.plus(*candidates)
    statistics = linearise(model, measured)
    columns = {m.cause: model.columns_of(m.cause) for m in candidates}
    n = len(statistics.energy) * int(measured.samples.valid.numpy().sum((1, 2)).mean()) * 3
    return select(
        statistics.curvature.sum(0),
        statistics.slope.sum(0),
        float(statistics.energy.sum()),
        held=np.arange(len(base.vector)),
        columns=columns,
        n=n,
    )


def select(
    curvature: Array, slope: Array, energy: float, *, held: Array, columns: dict[str, Array], n: int
) -> tuple[str, ...]:
    """Forward selection on sums over all rows.

    Args:
        curvature, slope, energy: JᵀJ [P, P], Jᵀr [P] and rᵀr of all parameters.
        held: indices of the base's parameters, which are always in the model.
        columns: indices of each candidate's parameters.
        n: number of squared values in `energy`.
    """

    def error(index: Array) -> float:
        part = curvature[np.ix_(index, index)]
        ridged = part + np.diag(1e-9 * np.diag(part) + 1e-15)
        return max(energy - float(slope[index] @ np.linalg.solve(ridged, slope[index])), 1e-12 * energy)

    chosen: list[str] = []
    now, best = held, n * np.log(error(held))
    while len(chosen) < len(columns):
        costs = {
            cause: n * np.log(error(np.concatenate([now, index]))) + len(index) * np.log(n)
            for cause, index in columns.items()
            if cause not in chosen
        }
        cause = min(costs, key=lambda c: float(costs[c]))
        if costs[cause] >= best:
            break
        chosen.append(cause)
        now = np.concatenate([now, columns[cause]])
        best = n * np.log(error(now))
    return tuple(chosen)
