"""A fit heeds signs, and ends as low with slopes that are kept as with fresh ones; a model less one of its causes is as
near to the pushes as one that never had it, wherever its base has gone.
"""

from __future__ import annotations

import math

import pytest

from pentimento.diagnosis.pushes import fit as fitting
from pentimento.diagnosis.pushes.fit import fit, fit_without
from pentimento.diagnosis.pushes.jacobian import Slopes, action_losses, slopes_of
from pentimento.diagnosis.pushes.measured import MeasuredPushes, measure
from pentimento.dynamics.pushes.analytic import AnalyticPush, first_model, identity
from pentimento.dynamics.pushes.mechanisms.adhesion_lift import AdhesionLift
from tests.diagnosis.pushes.conftest import Played
from tests.dynamics.pushes.played_pushes import HALF_WIDTH_M, blank, mechanism, played


def test_a_model_without_a_cause_is_no_further_off_than_the_base_alone(lossy: Played) -> None:
    extended, measured = lossy.diagnosis.extended, lossy.diagnosis.measured
    base = fit(lossy.diagnosis.base, measured)
    astray = extended.at(extended.vector - 0.2)
    without = fit_without(astray, "volume_loss", base, measured)
    assert not without.mechanisms
    assert action_losses(without, measured).mean() <= action_losses(base, measured).mean() * 1.0005
    assert action_losses(extended, measured).mean() < 0.8 * action_losses(without, measured).mean()


def test_slopes_that_serve_twice_lead_as_low_as_fresh_ones(lossy: Played, monkeypatch: pytest.MonkeyPatch) -> None:
    measured = lossy.diagnosis.measured
    start = first_model(measured.scene)
    taken = []

    def counted(model: AnalyticPush, measured: MeasuredPushes) -> Slopes:
        taken.append(model)
        return slopes_of(model, measured)

    monkeypatch.setattr(fitting, "slopes_of", counted)
    kept = fit(start, measured)
    fewer = len(taken)
    monkeypatch.setattr(fitting, "_AS_PROMISED", math.inf)
    fresh = fit(start, measured)
    assert fewer < len(taken) - fewer
    assert action_losses(kept, measured).mean() <= 1.005 * action_losses(fresh, measured).mean()


@pytest.mark.parametrize("seed", range(4))
def test_what_cannot_be_below_zero_ends_there_and_the_rest_of_its_cause_is_found(seed: int) -> None:
    """Without what follows the dwell, its quantity would come out below zero in every second table."""
    hidden = mechanism(AdhesionLift, blank(), lift_by_log_speed_m=0.001)
    measured = measure(played([hidden], seed=seed), HALF_WIDTH_M)
    start = first_model(measured.scene).plus(identity(AdhesionLift, measured.scene))
    by_speed_m, by_dwell_m = fit(start, measured).mechanisms[-1].values
    assert by_speed_m == pytest.approx(0.001, abs=2e-4)
    assert 0 <= by_dwell_m < 1e-4
