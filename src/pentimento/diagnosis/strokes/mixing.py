"""Whether paint and ground mix in light, or in another power of it (``mixture``): part of the base, and no cause.

Paint that is mixed otherwise than the base believes differs where it lies over older paint, as if it had taken that up.
Of one dark ink on white paper the power can be anything, for the profile makes up for it: a base is plain until the
photographs surely ask for more.
"""

from __future__ import annotations

from dataclasses import replace

from pentimento.diagnosis.choice import paired_p
from pentimento.diagnosis.strokes.fit import fit
from pentimento.diagnosis.strokes.jacobian import linearise
from pentimento.diagnosis.strokes.measured import Measured
from pentimento.diagnosis.strokes.predict import BASE, Model

_START = -0.4
_P, _MIN = 0.01, 0.1
"""How sure another mixing than in light must be, and what it must remove of the error."""


def mixed(model: Model, measured: Measured, seed: int) -> Model:
    """The fitted base, or one in which paint and ground mix in another power of light, where that is surely nearer to
    the photographs than the best that mixes in light.
    """
    other = fit(_mixing_by(model, _START), measured)
    # What another start does for all other numbers is not the mixing's.
    rival = fit(_mixing_by(other, 0.0), measured)
    plain = min(model, rival, key=lambda each: float(linearise(each, measured).energy.mean()))
    before = linearise(plain, measured).energy
    removed = before - linearise(other, measured).energy
    sure = paired_p(removed, seed) < _P and removed.mean() >= _MIN * before.mean()
    return other if sure else plain


def _mixing_by(model: Model, mixing: float) -> Model:
    numbers = model.base.copy()
    numbers[BASE.index("mixing")] = mixing
    return replace(model, base=numbers)
