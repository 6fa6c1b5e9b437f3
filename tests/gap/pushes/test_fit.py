"""A model less one of its causes is as near to the pushes as one that never had it, wherever its base has gone."""

from __future__ import annotations

from pentimento.gap.pushes.fit import fit, fit_without
from pentimento.gap.pushes.jacobian import action_losses
from tests.gap.pushes.conftest import Played


def test_a_model_without_a_cause_is_no_further_off_than_the_base_alone(lossy: Played) -> None:
    extended, measured = lossy.diagnosis.extended, lossy.diagnosis.measured
    base = fit(lossy.diagnosis.base, measured)
    astray = extended.at(extended.vector - 0.2)
    without = fit_without(astray, "volume_loss", base, measured)
    assert not without.mechanisms
    assert action_losses(without, measured).mean() <= action_losses(base, measured).mean() * 1.0005
    assert action_losses(extended, measured).mean() < 0.8 * action_losses(without, measured).mean()
