"""A model on other strokes than those it was fitted to: which paint is which, and what share of the gap it closes."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pentimento.gap.diagnose import Diagnosis
from pentimento.gap.floor import noise_floor
from pentimento.gap.foretell import Model, action_losses
from pentimento.gap.measured import Measured

Array = NDArray[Any]


def paints_of(measured: Measured) -> Array:
    """The distinct paints, sRGB [K, 3], in the order of ``measured.paint``."""
    _, first = np.unique(measured.paint, return_index=True)
    paints: Array = measured.samples.color.double().numpy()[first].round(3)
    return paints


def applied(model: Model, paints: Array, measured: Measured) -> tuple[Model, Measured]:
    """Model and strokes with one numbering of paints; a paint that the model has not seen gets no offset.

    Args:
        paints: [K, 3] sRGB, those that the model's colour offsets belong to.
    """
    own = paints_of(measured)
    known = {tuple(paint): number for number, paint in enumerate(paints.round(3).tolist())}
    new = [paint for paint in own.tolist() if tuple(paint) not in known]
    known |= {tuple(paint): len(paints) + number for number, paint in enumerate(new)}
    number = np.array([known[tuple(paint)] for paint in own.tolist()])
    offsets = np.concatenate([model.color_offset, np.zeros((len(new), 3))])
    return replace(model, color_offset=offsets), replace(measured, paint=number[measured.paint], paints=len(known))


def gap_closed_on(outside: Measured, diagnosis: Diagnosis, paints: Array, seed: int) -> float | None:
    """(base - extended) / (base - floor) on an outside table; the floor is its own where it repeats actions.

    None where no floor is known, or where the base has no gap there.

    Raises:
        NotObservable: the table lacks a column that the extended model depends on.
    """
    models = diagnosis.base, diagnosis.extended, diagnosis.habits.model
    base, extended, seen_from = (applied(model, paints, outside)[0] for model in models)
    strokes = applied(diagnosis.base, paints, outside)[1]
    strokes = diagnosis.habits.seen_from(seen_from).of(strokes)
    floor = noise_floor(extended, strokes, seed) or diagnosis.floor
    before, after = float(action_losses(base, strokes).mean()), float(action_losses(extended, strokes).mean())
    if floor is None or before <= floor.mse:
        return None
    return (before - after) / (before - floor.mse)
