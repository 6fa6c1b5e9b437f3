"""Whether a cause of pushes merely stands where something belongs that has no name; of strokes, see ``gap.nameless``.

Material that sinks while the tool rests looks like a share that recovers, and so do walls that slide in. A cause must
show what it is named for, and leave less error than what could be taken for it (``LOOKALIKES``).
"""

from __future__ import annotations

from collections.abc import Mapping

from pentimento.gap.pushes.fit import fit
from pentimento.gap.pushes.jacobian import action_losses
from pentimento.gap.pushes.measured import MeasuredPushes
from pentimento.push_dynamics.analytic import AnalyticPush, identity
from pentimento.push_dynamics.mechanisms import LOOKALIKES, Mechanism
from pentimento.push_dynamics.mechanisms.mechanism import NotObservable

_SURE = 2.0  # standard errors


def shows_signature(mechanism: Mechanism, values: Mapping[str, tuple[float, float]]) -> bool:
    """Whether a quantity without which it would be another cause is surely above zero.

    Args:
        values: each quantity with its standard error.
    """
    signed = [values[name] for name in mechanism.signature]
    return not signed or any(value > _SURE * error for value, error in signed)


def lookalike_is_as_good(cause: str, model: AnalyticPush, known: MeasuredPushes) -> bool:
    """Whether what could be taken for a cause leaves no more error in its place.

    Args:
        model: with the cause, fitted to ``known``.
    """
    if cause not in LOOKALIKES:
        return False
    try:
        other = identity(LOOKALIKES[cause], known.scene)
    except NotObservable:
        return False
    instead = fit(model.without(cause).plus(other), known)
    return bool(action_losses(instead, known).mean() <= action_losses(model, known).mean())
