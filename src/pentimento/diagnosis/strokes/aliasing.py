"""Aliasing of causes in measured strokes, or in a design that is not executed yet (docs/diagnosis.md §11)."""

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
from pentimento.diagnosis.strokes.model import Model, observable_causes
from pentimento.dynamics.strokes.simulation import Mechanism

_PAPER = 237
"""Grey of blank paper, 0 to 255."""
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
    """The model with every observable cause that it lacks, with all quantities 0."""
    there = {mechanism.cause for mechanism in model.mechanisms}
    kinds = [kind for kind in vocabulary if kind.cause not in there]
    lacking, _ = observable_causes(kinds, measured.context, path_measured=measured.following is not None)
    return model.plus(*lacking.values())


def aliasing_of(model: Model, measured: Measured, vocabulary: Sequence[type[Mechanism]]) -> Aliasing:
    """Aliasing of all causes that these strokes can show, at a model."""
    full = with_all(model, measured, vocabulary)
    return aliasing(linearise(full, measured), columns_of(full))


def design(commands: pa.Table) -> Measured:
    """Strokes that are not executed yet, for the aliasing matrix of their design.

    ``commands`` is a table of the strokes contract in which ``window_m``, ``before`` and ``after`` may be absent.
    Missing photographs are blank paper, so causes that depend on paint below (``wet_mixing``) need ``before``.

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
