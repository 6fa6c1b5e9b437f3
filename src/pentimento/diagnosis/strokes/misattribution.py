"""Misattribution checks: whether a cause only stands in for an effect outside the vocabulary (docs/diagnosis.md §8).

An effect without a name is often fitted passably by a neighbour in the vocabulary. Drift over a session resembles a
number for each sheet of paper, and narrowing with speed resembles a bleed without a softer edge. A cause must therefore
show its signature, and beat a generic curve over covariates that it does not depend on.

A lag has a direction in time. Paint that overlaps inside bends draws a mark inwards before and after a bend, whereas a
trailing patch cuts the corner only behind the tip. A tool whose ends differ resembles a lag but cuts no corner.
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
from pentimento.diagnosis.strokes.modes import (
    MODES,
    AllModes,
    fit_modulator,
    mode_scores,
    modulated,
    structured_residual,
)
from pentimento.diagnosis.strokes.predict import action_losses
from pentimento.dynamics.strokes.mechanisms.bristle_lag import BristleLag
from pentimento.dynamics.strokes.mechanisms.geometry import speed_m_s
from pentimento.dynamics.strokes.mechanisms.latency import Latency
from pentimento.dynamics.strokes.simulation import Mechanism, StrokeContext
from pentimento.dynamics.strokes.traj2stroke import Mark

Array = NDArray[Any]

_SURE = 2.0
"""Standard errors."""
_LITTLE_LEFT = 0.5
"""A cause whose effect falls below this share beside a generic curve is not needed."""
_SAME_RANKS = 0.9
"""Rank correlation above which two covariates are the same (clock and order)."""

_POWER_OF_SPEED = {BristleLag.cause: 0, Latency.cause: 1}
"""Power of speed with which the trailing distance grows."""
_ANOTHER_POWER = 0.15
"""Deviation from that power which counts as another power. A fitted wrong cause hides half or more of a difference of
1: .16 to .55 remain visible, for a right cause at most .2."""
_LEADS = 0.45
"""Leading distance beside a lag, as a share of the lag, that refutes it. Overlapping paint shows .7, less if weak; real
and simulated lags show at most .33."""
_LEADS_BACKWARDS = 0.5
"""The opposite distance that refutes it. Real and simulated lags show at most .38; marks drawn outwards on both sides
of bends show 1."""


def shows_signature(mechanism: Mechanism, values: Mapping[str, tuple[float, float]]) -> bool:
    """Whether a quantity without which it would be another cause is surely not zero.

    Args:
        values: each quantity with its standard error.
    """
    signed = [values[name] for name in mechanism.signature]
    return not signed or any(abs(value) > _SURE * error for value, error in signed)


def trails_by_another_power(mechanism: Mechanism, model: Model, measured: Measured) -> bool:
    """Whether the trailing distance grows with another power of speed than the cause implies; False for other causes or
    unknown speeds.

    The residual shift along the path has a slope over log speed, which in units of the distance is the error of the
    power. Uneven ends are left out, because they would compensate a wrong cause.

    Args:
        model: with the cause, fitted to ``measured``.
    """
    speed = speed_m_s(measured.context.path)[:, 0].numpy()
    if mechanism.cause not in _POWER_OF_SPEED or not (np.isfinite(speed).all() and speed.min() > 0):
        return False
    if any(isinstance(m, UnevenEnds) for m in model.mechanisms):
        model = fit(model.without(UnevenEnds.cause), measured)
    tangential = MODES.index("tangential")
    scores = mode_scores(model, measured)
    weight, log_speed = scores.energy[:, tangential], np.log(speed)
    centred = log_speed - np.average(log_speed, weights=weight)
    shift_m = scores.amounts[:, tangential] * AllModes.quantities[tangential].typical
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
    """Whether a lag may lead as well as trail: marks shift the same way before and after bends. False for others.

    Args:
        model: with the cause.
        measured: all strokes, because bends give weak evidence.
    """
    if not isinstance(mechanism, BristleLag | Latency):
        return False
    both = fit(model.plus(_Leading(torch.zeros_like(mechanism.values), {})), measured)
    trails = next(m for m in both.mechanisms if m.cause == mechanism.cause)
    trails_m = float(trails.values[0]) * trails.reference.get("speed_m_s", 1.0)
    leads_m, error_m = values_with_errors(both, both.mechanisms[-1], measured)["distance_m"]
    return leads_m + error_m > _LEADS * trails_m or leads_m + _SURE * error_m < -_LEADS_BACKWARDS * trails_m


def uneven_ends_suffice(mechanism: Mechanism, model: Model, measured: Measured, seed: int) -> bool:
    """Whether beside uneven ends a lag removes no significant error; False for other causes.

    Where strokes bend, a real lag also cuts corners.

    Args:
        model: with the cause.
        measured: all strokes, because bends give weak evidence.
    """
    if not isinstance(mechanism, BristleLag | Latency):
        return False
    instead = with_uneven_ends(model.without(mechanism.cause), measured)
    beside = fit(instead.plus(mechanism), measured)
    gains = action_losses(instead, measured) - held_out_losses(beside, measured, seed)
    return paired_p(gains, seed) > FIRST_P


def with_uneven_ends(model: Model, measured: Measured) -> Model:
    """The model with uneven ends, fitted."""
    differ = any(isinstance(m, UnevenEnds) for m in model.mechanisms)
    return fit(model if differ else model.plus(identity(UnevenEnds, measured.context)), measured)


class _Leading(BristleLag):
    """A lag reversed in time: the mark leads its tip, as if drawn from end to start."""

    cause = "leading"

    def mark(self, mark: Mark, context: StrokeContext) -> Mark:
        backwards = super().mark(mark._replace(points_m=mark.points_m.flip(-2)), context)
        return mark._replace(points_m=backwards.points_m.flip(-2))


def generic_curve_suffices(
    mechanism: Mechanism, model: Model, rest: Model, *, known: Measured, test_split: Measured, seed: int
) -> bool:
    """Whether a curve over covariates that the cause does not depend on can replace it.

    In its place the curve leaves no more error, and beside the curve the cause has little effect left. (Of two real
    effects, each keeps its own.)

    Args:
        model: with the cause, fitted to ``known``.
        rest: without it, likewise.
        test_split: strokes of the comparison.
    """
    structure = structured_residual(rest, known, _foreign(mechanism, known), seed=seed)
    if not structure.unexplained:
        return False
    pairs = [(one.mode, one.covariate) for one in structure.unexplained]

    def with_curve(bare: Model) -> Array:
        return action_losses(*modulated(bare, fit_modulator(bare, known, pairs, seed), test_split))

    losses, instead = action_losses(model, test_split), with_curve(rest)
    if instead.mean() > losses.mean():
        return False
    beside, alone = instead - with_curve(model), action_losses(rest, test_split) - losses
    return bool(beside.mean() < _LITTLE_LEFT * alone.mean())


def _foreign(mechanism: Mechanism, measured: Measured) -> dict[str, Array]:
    """Known covariates that the cause does not depend on, [B] each."""
    columns = covariates_shown(measured)
    own = [columns[name] for name in mechanism.informative_covariates if name in columns and not _is_a_kind(name)]
    return {
        name: values
        for name, values in columns.items()
        if name not in mechanism.informative_covariates
        and not any(_rank_correlation(values, each) > _SAME_RANKS for each in own)
    }


def _is_a_kind(name: str) -> bool:
    """Whether the values are categories without order."""
    return name == "surface_level"


def _rank_correlation(one: Array, other: Array) -> float:
    return abs(float(np.asarray(spearmanr(one, other).statistic)))
