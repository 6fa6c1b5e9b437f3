"""A fit ends as low with slopes that are kept as with fresh ones; a model less one of its causes is as near to the
pushes as one that never had it, wherever its base has gone.
"""

from __future__ import annotations

import math

import pytest

from pentimento.gap.pushes import fit as fitting
from pentimento.gap.pushes.fit import fit, fit_without
from pentimento.gap.pushes.jacobian import action_losses, slopes_of
from pentimento.push_dynamics.analytic import first_model
from tests.gap.pushes.conftest import Played


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

    def counted(*given: object) -> object:
        taken.append(given)
        return slopes_of(*given)  # type: ignore[arg-type]

    monkeypatch.setattr(fitting, "slopes_of", counted)
    kept = fit(start, measured)
    fewer = len(taken)
    monkeypatch.setattr(fitting, "_AS_PROMISED", math.inf)
    fresh = fit(start, measured)
    assert fewer < len(taken) - fewer
    assert action_losses(kept, measured).mean() <= 1.005 * action_losses(fresh, measured).mean()
