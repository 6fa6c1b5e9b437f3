"""Which causes a set of strokes can tell apart: the imitation matrix (docs/diagnosis.md §11).

Two causes imitate each other where their derivatives, less what the nuisances can take up, point the same way in the
space of all photographs. That is a property of the strokes' design: it takes commands and a model, and no photograph.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pyarrow as pa

from pentimento.contracts.frames import image_shape, window_around
from pentimento.contracts.images import encode_png
from pentimento.contracts.schema import IMAGE, vector
from pentimento.diagnosis.experiment_design import Aliasing, Columns, aliasing
from pentimento.diagnosis.strokes.jacobian import linearise
from pentimento.diagnosis.strokes.measured import Measured, load_measured
from pentimento.diagnosis.strokes.model import Model, identity
from pentimento.dynamics.strokes.simulation import Mechanism, NotObservable

_PAPER = 237
_LONGER_SIDE_PX = 64
_MARGIN_M = 0.012


def columns_of(model: Model) -> Columns:
    """Indices into the Jacobian of ``model``: nuisances, and the quantities of each of its mechanisms."""
    causes, at = {}, model.nuisances
    for mechanism in model.mechanisms:
        causes[mechanism.cause] = np.arange(at, at + len(mechanism.quantities))
        at += len(mechanism.quantities)
    return Columns(np.arange(model.nuisances), causes)


def with_all(model: Model, measured: Measured, vocabulary: Sequence[type[Mechanism]]) -> Model:
    """The model with every cause that these strokes can show and that it has not yet, at no effect."""
    there = {mechanism.cause for mechanism in model.mechanisms}
    more = []
    for kind in vocabulary:
        if kind.cause in there:
            continue
        try:
            more.append(identity(kind, measured.context))
        except NotObservable:
            continue
    return model.plus(*more)


def aliasing_of(model: Model, measured: Measured, vocabulary: Sequence[type[Mechanism]]) -> Aliasing:
    """Between all causes that these strokes can show, at a model."""
    full = with_all(model, measured, vocabulary)
    return aliasing(linearise(full, measured), columns_of(full))


def design(commands: pa.Table) -> Measured:
    """Strokes that have not been made yet, so that the imitation matrix can be known before any is.

    ``commands`` is a table of the strokes contract; of its required columns, ``window_m``, ``before`` and ``after`` may
    be absent. Photographs that are not there are blank paper, so that what depends on paint below (``wet_mixing``)
    shows only where ``before`` is given.

    Raises:
        ContractError: the table has no rows, or a row (it is named) makes no sample.
    """
    rows = commands.to_pylist()
    windows = [row.get("window_m") or window_around(np.array(row["path"]), _MARGIN_M).tolist() for row in rows]
    before = [row.get("before") or _paper(window) for row, window in zip(rows, windows, strict=True)]
    given = commands.select([n for n in commands.schema.names if n not in ("window_m", "before", "after")])
    images = pa.array(before, IMAGE)
    for name, values in (("window_m", pa.array(windows, vector(4))), ("before", images), ("after", images)):
        given = given.append_column(name, values)
    return load_measured(given)


def _paper(window_m: Sequence[float]) -> dict[str, Any]:
    longer = max(window_m[2] - window_m[0], window_m[3] - window_m[1])
    shape = image_shape(window_m, _LONGER_SIDE_PX / longer)
    return {"bytes": encode_png(np.full((*shape, 3), _PAPER, np.uint8)), "path": None}
