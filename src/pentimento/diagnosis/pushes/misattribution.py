"""Whether a cause of pushes merely stands where something belongs that has no name.

Material that sinks while the tool rests looks like a share that recovers, and so do walls that slide in; a groove whose
shallow start closes up looks like a tool that acts too high. A cause must show what it is named for, and do more than
what could be taken for it (``LOOKALIKES``).
"""

from __future__ import annotations

from collections.abc import Mapping

from scipy.stats import chi2

from pentimento.diagnosis.pushes.fit import fit
from pentimento.diagnosis.pushes.jacobian import action_losses
from pentimento.diagnosis.pushes.measured import MeasuredPushes
from pentimento.diagnosis.score import paired_p
from pentimento.dynamics.pushes.analytic import AnalyticPush, identity
from pentimento.dynamics.pushes.mechanisms import LOOKALIKES, Mechanism
from pentimento.dynamics.pushes.mechanisms.mechanism import NotObservable

_SURE, _CERTAIN = 2.0, 4.0  # standard errors
_AS_GOOD, _NEARLY_AS_GOOD = 0.95, 0.88  # of what the cause removes
_CERTAINLY_WORSE_P, _CERTAINLY_BY_PLACE_P = 0.001, 0.001


def shows_signature(mechanism: Mechanism, values: Mapping[str, tuple[float, float]]) -> bool:
    """Whether a quantity without which it would be another cause is surely above zero.

    Args:
        values: each quantity with its standard error.
    """
    signed = [values[name] for name in mechanism.signature]
    return not signed or any(value > _SURE * error for value, error in signed)


def goes_with_time(mechanism: Mechanism, values: Mapping[str, tuple[float, float]]) -> bool:
    """Whether it is certain that what it is named for goes with recorded times, as no shape of a base does."""
    shown = [values[name] for name in mechanism.signature] if mechanism.reference else []
    return any(value > _CERTAIN * error for value, error in shown)


def goes_with_place(mechanism: Mechanism, values: Mapping[str, tuple[float, float]]) -> bool:
    """Whether it is certain, by all of its quantities that do, that it differs from place to place, as no shape of a
    base does.
    """
    squares = [(value / error) ** 2 for value, error in (values[name] for name in mechanism.by_place) if error > 0]
    return bool(squares) and bool(chi2.sf(sum(squares), len(squares)) < _CERTAINLY_BY_PLACE_P)


def lookalike_is_as_good(cause: str, model: AnalyticPush, known: MeasuredPushes, seed: int) -> bool:
    """Whether what could be taken for a cause does its work: it has one number where the cause has several, so that it
    need not remove quite as much error, unless it is certain that the cause is the better one. (Of springback that is
    there it removes half to two thirds, of a far-off swell two thirds to nine tenths, of a height that is wrong by more
    towards one side a tenth to a half; where it is right itself, nineteen twentieths and more.)

    Args:
        model: with the cause, fitted to ``known``.
    """
    if cause not in LOOKALIKES:
        return False
    try:
        other = identity(LOOKALIKES[cause], known.scene)
    except NotObservable:
        return False
    rest = fit(model.without(cause), known)
    error, with_cause, instead = (action_losses(each, known) for each in (rest, model, fit(rest.plus(other), known)))
    certainly_worse = paired_p(instead - with_cause, seed) < _CERTAINLY_WORSE_P
    as_good = _AS_GOOD if certainly_worse else _NEARLY_AS_GOOD
    return bool((error - instead).mean() >= as_good * (error - with_cause).mean())
