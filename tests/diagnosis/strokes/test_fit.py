"""Convergence of fits, and what the base can absorb of a cause."""

from dataclasses import replace

import numpy as np
import pytest

from pentimento.diagnosis.boosting import cause_projection
from pentimento.diagnosis.gauss_newton import Statistics
from pentimento.diagnosis.score import projected_statistics
from pentimento.diagnosis.strokes.fit import fit, huber_weighted, stiffened
from pentimento.diagnosis.strokes.jacobian import linearise
from pentimento.diagnosis.strokes.measured import Measured
from pentimento.diagnosis.strokes.model import Model, UnevenEnds, identity
from pentimento.diagnosis.strokes.predict import action_losses
from pentimento.dynamics.strokes.mechanisms.bristle_lag import BristleLag
from pentimento.dynamics.strokes.mechanisms.speed_bleed import SpeedBleed
from tests.diagnosis.strokes.hidden import strokes_of


@pytest.fixture(scope="module")
def softened() -> tuple[Measured, Model]:
    """Strokes whose edge is softer the faster they are, and the model that was fitted to them with that cause."""
    strokes, plain = strokes_of(SpeedBleed, 0.3, 0.0)
    return strokes, fit(plain.plus(identity(SpeedBleed, strokes.context)), strokes)


def asked(statistics: Statistics, model: Model) -> float:
    """How much error would come back, to second order, if the cause is removed and the rest is fitted again."""
    columns = model.columns_of(SpeedBleed.cause)
    rest = np.setdiff1d(np.arange(len(model.vector)), columns)
    values = model.vector[columns]
    return float(values @ projected_statistics(statistics, rest, columns)[1].mean(0) @ values)


def with_prior(statistics: Statistics, model: Model) -> Statistics:
    """Statistics of the penalised loss that a fit minimises."""
    stiff = stiffened(statistics, model, 1.0)
    hold = (stiff.curvature - statistics.curvature)[0]
    return stiff._replace(slope=statistics.slope - hold @ model.vector)


def test_prior_limits_what_the_base_absorbs_of_a_cause(softened: tuple[Measured, Model]) -> None:
    """Without the prior, implausible steps of the nuisances would seem to undo more of it."""
    strokes, model = softened
    without = fit(model.without(SpeedBleed.cause), strokes)
    comes_back = float((action_losses(without, strokes) - action_losses(model, strokes)).mean())
    statistics = linearise(model, strokes)
    assert asked(with_prior(statistics, model), model) == pytest.approx(comes_back, rel=0.3)
    assert asked(statistics, model) < 0.9 * asked(with_prior(statistics, model), model)


def test_fit_ends_at_a_stationary_point(softened: tuple[Measured, Model]) -> None:
    strokes, model = softened
    slope = with_prior(linearise(model, strokes), model).slope
    assert np.abs(slope.sum(0)).max() < 0.02 * np.abs(slope).sum(0).max()


def test_a_colour_that_was_told_wrong_is_corrected(softened: tuple[Measured, Model]) -> None:
    """The offset makes up for it: the error is the same, and the prior lets an offset of 0.25 cost less than 1 % of it.

    Otherwise a cause that changes the paint's colour, such as vignetting, takes the offset's place.
    """
    strokes, model = softened
    other = replace(strokes, samples=strokes.samples._replace(color=(strokes.samples.color + 0.2).clamp(0.0, 1.0)))
    refitted = fit(replace(model, color_offset=0 * model.color_offset), other)
    assert action_losses(refitted, other).mean() < 1.02 * action_losses(model, strokes).mean()
    statistics = linearise(model, strokes)
    hold = (stiffened(statistics, model, 1.0).curvature - statistics.curvature)[0]
    offset = np.zeros(len(model.vector))
    offset[len(model.base)] = 0.25
    assert offset @ hold @ offset < 0.01 * statistics.energy.mean()


def test_huber_weights_limit_an_outlying_action(softened: tuple[Measured, Model]) -> None:
    """A mirrored photograph: its action counts as three usual ones, all others are unchanged."""
    strokes, model = softened
    after = strokes.samples.after.clone()
    after[0] = after[0].flip(1)
    spoilt = replace(strokes, samples=strokes.samples._replace(after=after))
    losses = action_losses(model, spoilt)
    tame = huber_weighted(spoilt, model)
    usual = np.median(losses)
    assert losses.max() > 10 * usual
    np.testing.assert_allclose(action_losses(model, tame), np.minimum(losses, 3 * usual), rtol=1e-6)
    np.testing.assert_allclose(linearise(model, tame).energy, np.minimum(losses, 3 * usual), rtol=1e-4)
    softening, with_all, with_less = (
        float(fitted.mechanisms[-1].values[0]) for fitted in (model, fit(model, spoilt), fit(model, tame))
    )
    assert abs(with_less - softening) < 0.5 * abs(with_all - softening)


def test_fit_continues_while_steps_are_limited() -> None:
    """Widened ends at their bound are several of the longest steps away, each of which gains little."""
    strokes, plain = strokes_of(BristleLag, 0.009)
    uneven = fit(plain.plus(identity(UnevenEnds, strokes.context)), strokes)
    before, after = (float(action_losses(each, strokes).mean()) for each in (plain, uneven))
    assert after < 0.9 * before


def test_prior_determines_parameters_without_data(softened: tuple[Measured, Model]) -> None:
    """No stroke presses as lightly as the first knot, except one minimally."""
    strokes, model = softened
    statistics = linearise(model, strokes)
    curvature, slope = statistics.curvature.copy(), statistics.slope.copy()
    curvature[:, 0], curvature[:, :, 0], slope[:, 0] = 0.0, 0.0, 0.0
    curvature[0, 0, 0], slope[0, 0] = 1e-12, 1e-11  # ten millimetres, if nothing holds them
    opened = Statistics(curvature, slope, statistics.energy)
    assert cause_projection(opened, model.nuisances)[0] > 5.0
    assert abs(cause_projection(stiffened(opened, model, 0.001), model.nuisances)[0]) < 0.5
