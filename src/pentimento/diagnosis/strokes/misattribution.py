"""Whether a cause merely stands where something belongs that has no name.

What is not in the vocabulary is often told passably by a neighbour that is: a mark that widens over the session, by a
number for each sheet of paper; one that narrows with speed, by a bleed without a softer edge; one that trails by a
time, by a length. So a cause must show what it is named for, and it has a rival without a name: a curve (``modulator``)
over whatever was recorded that it does not go with. The right cause knows more of a stroke than any such curve, be its
form as wrong as that of all materials.

And what trails has a direction in time. Paint that overlaps on the inside of bends draws a mark inwards before a bend
as after it, where a patch that trails cuts the corner only behind the tip. A tool that comes down and lifts off in
different ways leaves ends that look like a lag, and no corner is cut.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.stats import spearmanr

from pentimento.diagnosis.score import paired_p
from pentimento.diagnosis.strokes.candidates import FIRST_P, held_out_losses
from pentimento.diagnosis.strokes.fit import fit, values_with_errors
from pentimento.diagnosis.strokes.measured import Measured, covariates_shown
from pentimento.diagnosis.strokes.model import Model, UnevenEnds, identity
from pentimento.diagnosis.strokes.modes import MODES, AllModes, fit_modulator, mode_scores, modulated, unexplained
from pentimento.diagnosis.strokes.predict import action_losses
from pentimento.dynamics.strokes.mechanisms.bristle_lag import BristleLag
from pentimento.dynamics.strokes.mechanisms.geometry import speed_m_s
from pentimento.dynamics.strokes.mechanisms.latency import Latency
from pentimento.dynamics.strokes.simulation import Mechanism, StrokeContext
from pentimento.dynamics.strokes.traj2stroke import Mark

Array = NDArray[Any]

_SURE = 2.0  # standard errors
_LITTLE = 0.5
"""Of what the cause does alone."""
_THE_SAME = 0.9
"""Rank correlation: beyond, a column says what one says that the cause goes with (a clock beside the order)."""

_POWER_OF_SPEED = {BristleLag.cause: 0, Latency.cause: 1}
"""By which power of a stroke's speed that grows by which its mark trails."""
_ANOTHER_POWER = 0.15
"""How far off a power must be seen to be another. A wrong cause, fitted, has taken up half of the difference of 1 and
more: .16 to .55 are seen of it, and of a right one's .2 at most."""
_LEADS, _LEADS_BACKWARDS = 0.45, 0.5
"""Share of a distance that a mark trails by, that it might lead by, beside; and would surely do the contrary of leading
by. Of paint that overlaps in bends, .7 are seen, and less of little of it; of marks that trail, in photographs by
others .33 at most and in simulations .01 to -.68, to within .01 to .38: bristles that cut corners less than a patch
that is dragged. Of marks drawn to the outside before bends as after them it is -1.
"""


def shows_signature(mechanism: Mechanism, values: Mapping[str, tuple[float, float]]) -> bool:
    """Whether a quantity without which it would be another cause is surely not zero.

    Args:
        values: each quantity with its standard error.
    """
    signed = [values[name] for name in mechanism.signature]
    return not signed or any(abs(value) > _SURE * error for value, error in signed)


def trails_by_another_power(mechanism: Mechanism, model: Model, measured: Measured) -> bool:
    """Whether a mark trails by what surely grows with another power of the speed than the cause says; False of causes
    by which nothing trails, and where speeds are unknown.

    What is left is a shift along the path; its slope over log speed, in units of the distance, is what the power lacks.
    Uneven ends would take up the distance of a wrong one: it is asked without them.

    Args:
        model: with the cause, fitted to ``measured``.
    """
    speed = speed_m_s(measured.context.path)[:, 0].numpy()
    if mechanism.cause not in _POWER_OF_SPEED or not (np.isfinite(speed).all() and speed.min() > 0):
        return False
    if any(isinstance(m, UnevenEnds) for m in model.mechanisms):
        model = fit(model.without(UnevenEnds.cause), measured)
    tangential = MODES.index("tangential")
    scores, energy, _ = mode_scores(model, measured)
    weight, log_speed = energy[:, tangential], np.log(speed)
    centred = log_speed - np.average(log_speed, weights=weight)
    shift_m = scores[:, tangential] * AllModes.quantities[tangential].typical
    shift_m -= np.average(shift_m, weights=weight)
    information = float((weight * centred**2).sum())
    if information <= 0:
        return False
    slope_m = float((weight * centred * shift_m).sum()) / information
    _, group = np.unique(measured.action, return_inverse=True)
    by_action = np.bincount(group, weight * centred * (shift_m - slope_m * centred))
    error_m = float(np.sqrt(np.square(by_action).sum())) / information
    fitted = next(m for m in model.mechanisms if m.cause == mechanism.cause)
    usual_speed = float(np.exp(np.average(log_speed, weights=weight)))
    distance_m = float(fitted.values[0]) * usual_speed ** _POWER_OF_SPEED[mechanism.cause]
    return abs(slope_m) - _SURE * error_m > _ANOTHER_POWER * distance_m


def trails_both_ways(mechanism: Mechanism, model: Model, measured: Measured) -> bool:
    """Whether a mark that trails by a distance or a time might lead by nearly half as much beside that, as far as can
    be told, or would surely do the contrary of leading: it is bent alike before and after its bends, and nothing
    trails. False of any other cause.

    Args:
        model: with the cause.
        measured: all strokes there are: what bends say is faint.
    """
    if not isinstance(mechanism, BristleLag | Latency):
        return False
    both = fit(model.plus(_Leading(torch.zeros_like(mechanism.values), {})), measured)
    trails = next(m for m in both.mechanisms if m.cause == mechanism.cause)
    trails_m = float(trails.values[0]) * trails.reference.get("speed_m_s", 1.0)
    leads_m, error_m = values_with_errors(both, both.mechanisms[-1], measured)["distance_m"]
    return leads_m + error_m > _LEADS * trails_m or leads_m + _SURE * error_m < -_LEADS_BACKWARDS * trails_m


def ends_do_as_much(mechanism: Mechanism, model: Model, measured: Measured, seed: int) -> bool:
    """Whether a mark trails at its two ends alone: beside ends that differ, the cause does not surely remove anything
    from strokes that it is not fitted to. Where strokes bend, what trails cuts corners, too. False of any other cause.

    Args:
        model: with the cause.
        measured: all strokes there are: what bends say beside ends is faint.
    """
    if not isinstance(mechanism, BristleLag | Latency):
        return False
    instead = with_uneven_ends(model.without(mechanism.cause), measured)
    beside = fit(instead.plus(mechanism), measured)
    gains = action_losses(instead, measured) - held_out_losses(beside, measured, seed)
    return paired_p(gains, seed) > FIRST_P


def with_uneven_ends(model: Model, measured: Measured) -> Model:
    """The model fitted with ends that may differ."""
    differ = any(isinstance(m, UnevenEnds) for m in model.mechanisms)
    return fit(model if differ else model.plus(identity(UnevenEnds, measured.context)), measured)


class _Leading(BristleLag):
    """The same backwards in time: the mark leads its tip as one trails that is drawn from end to start."""

    cause = "leading"

    def mark(self, mark: Mark, context: StrokeContext) -> Mark:
        backwards = super().mark(mark._replace(points_m=mark.points_m.flip(-2)), context)
        return mark._replace(points_m=backwards.points_m.flip(-2))


def curve_is_as_good(
    mechanism: Mechanism, model: Model, rest: Model, known: Measured, test_split: Measured, seed: int
) -> bool:
    """Whether a curve over what a cause does not go with does its work: in its place no more error is left, and beside
    it the cause has little left to do. (Of two effects that are there, each keeps its own.)

    Args:
        model, rest: with the cause and without it, fitted to ``known``.
    """
    left, _, _ = unexplained(rest, known, _foreign(mechanism, known), seed)
    if not left:
        return False
    pairs = [(one.mode, one.covariate) for one in left]

    def with_curve(bare: Model) -> Array:
        return action_losses(*modulated(bare, fit_modulator(bare, known, pairs, seed), test_split))

    losses, instead = action_losses(model, test_split), with_curve(rest)
    if instead.mean() > losses.mean():
        return False
    beside, alone = instead - with_curve(model), action_losses(rest, test_split) - losses
    return bool(beside.mean() < _LITTLE * alone.mean())


def _foreign(mechanism: Mechanism, measured: Measured) -> dict[str, Array]:
    """What was recorded and the cause does not go with, [B] each."""
    columns = covariates_shown(measured)
    own = [columns[name] for name in mechanism.informative_covariates if name in columns and not _is_a_kind(name)]
    return {
        name: values
        for name, values in columns.items()
        if name not in mechanism.informative_covariates
        and not any(_rank_correlation(values, each) > _THE_SAME for each in own)
    }


def _is_a_kind(name: str) -> bool:
    """Whether values are kinds, in no order."""
    return name == "surface_level"


def _rank_correlation(one: Array, other: Array) -> float:
    return abs(float(np.asarray(spearmanr(one, other).statistic)))
