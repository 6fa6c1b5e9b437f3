"""Forward selection of causes: minimum falls of error, aliasing, and convergence of refits."""

from __future__ import annotations

import numpy as np

from pentimento.diagnosis.pushes.fit import fit
from pentimento.diagnosis.pushes.jacobian import action_losses
from pentimento.diagnosis.pushes.measured import measure
from pentimento.diagnosis.pushes.search import _linearised, _Thresholds, could_be_the_base, observable_causes
from pentimento.dynamics.pushes.analytic import BASE, KNOTS, PROFILE, first_model
from pentimento.dynamics.pushes.mechanisms.far_field import FarField
from pentimento.dynamics.pushes.mechanisms.height_offset import HeightOffset
from pentimento.dynamics.pushes.mechanisms.tool_backlash import ToolBacklash
from pentimento.dynamics.pushes.mechanisms.volume_loss import VolumeLoss
from tests.dynamics.pushes.played_pushes import DEEP_M, HALF_WIDTH_M, blank, first_model_of, played

KINDS = (FarField, VolumeLoss, HeightOffset)


def test_rival_of_found_cause_must_remove_more_error() -> None:
    known, _ = observable_causes(measure(blank(12, 1), 0.006), KINDS)
    rival = _Thresholds(known, 1.0, {"far_field": 1.0}, {"volume_loss": 0.6})
    other = _Thresholds(known, 1.0, {"far_field": 1.0}, {})
    assert rival.minimum("volume_loss", 1.0) == 0.6 > rival.minimum("height_offset", 1.0) > 0
    assert other.minimum("volume_loss", 1.0) == other.minimum("height_offset", 1.0)


def test_aliasable_cause_needs_significant_fall_of_error() -> None:
    known, _ = observable_causes(measure(blank(12, 1), 0.006), [HeightOffset, ToolBacklash])
    noise = np.random.default_rng(0).standard_normal(100)
    noise = (noise - noise.mean()) / noise.std()
    insignificant, significant = noise + 0.15, noise + 0.35  # 1.5 and 3.5 standard errors
    assert could_be_the_base(known["height_offset"], insignificant, 0)
    assert not could_be_the_base(known["height_offset"], significant, 0)
    assert not could_be_the_base(known["tool_backlash"], insignificant, 0)


def test_flat_tip_is_not_attributed_to_height_offset() -> None:
    ball = first_model_of(DEEP_M)
    radius_mm, half_mm = 1e3 * ball.ball_radius_m, 1e3 * HALF_WIDTH_M
    flattened = dict(zip(BASE, ball.base, strict=True))
    for name, knot in zip(PROFILE, KNOTS, strict=True):
        distance_mm, flat_mm = knot * half_mm, 0.3 * half_mm
        flattened[name] = (max(distance_mm - flat_mm, 0.0) ** 2 - distance_mm**2) / (2 * radius_mm)
    tool = ball.at(np.array(list(flattened.values())))
    measured = measure(played(model=tool))
    known, _ = observable_causes(measured, [HeightOffset])
    fitted = fit(first_model(measured.scene).plus(known["height_offset"]), measured)
    assert np.abs(fitted.mechanisms[-1].values).max() < 2e-4


def test_refit_with_given_jacobian_matches_fresh_refit() -> None:
    measured = measure(played())
    model = fit(first_model(measured.scene), measured)
    known, _ = observable_causes(measured, [VolumeLoss, HeightOffset])
    full = _linearised(model, known, measured)
    for cause, still in known.items():
        at_start = full.slopes.of(np.append(np.arange(len(model.vector)), full.model.columns_of(cause)))
        found, again = fit(model.plus(still), measured, at_start), fit(model.plus(still), measured)
        np.testing.assert_allclose(found.vector, again.vector, rtol=1e-3, atol=1e-4)


def test_fit_is_converged() -> None:
    measured = measure(played())
    fitted = fit(first_model(measured.scene), measured)
    again = fit(fitted, measured)
    left, minimum = (action_losses(model, measured).mean() for model in (fitted, again))
    assert left - minimum < 2e-3 * left


def test_aliasable_cause_must_remove_more_error() -> None:
    known, _ = observable_causes(measure(blank(12, 1), 0.006), [FarField, HeightOffset, ToolBacklash])

    def minimum(cause: str, misfit: float, beside: bool = False) -> float:
        gained = {"far_field": 1e-6} if beside else {}
        return _Thresholds(known, 1.0, gained, {}).minimum(cause, 1.0 + misfit)

    assert 0 < minimum("tool_backlash", 0.1) < minimum("height_offset", 0.1)
    assert minimum("height_offset", 1.0) < minimum("height_offset", 1.0, True) < minimum("height_offset", 3.0, True)
    assert minimum("tool_backlash", 1.0) == minimum("tool_backlash", 1.0, True)
