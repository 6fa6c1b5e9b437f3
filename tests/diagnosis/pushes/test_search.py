"""What a further cause must do beside those that were found; a flat tip is not a tool that goes too deep."""

from __future__ import annotations

import numpy as np

from pentimento.diagnosis.pushes.fit import fit
from pentimento.diagnosis.pushes.jacobian import action_losses
from pentimento.diagnosis.pushes.measured import measure
from pentimento.diagnosis.pushes.search import (
    _enough,
    _minimum,
    _with_all,
    could_be_the_base,
    observable_causes,
)
from pentimento.dynamics.pushes.analytic import BASE, KNOTS, PROFILE, first_model
from pentimento.dynamics.pushes.mechanisms.far_field import FarField
from pentimento.dynamics.pushes.mechanisms.height_offset import HeightOffset
from pentimento.dynamics.pushes.mechanisms.tool_backlash import ToolBacklash
from pentimento.dynamics.pushes.mechanisms.volume_loss import VolumeLoss
from tests.dynamics.pushes.played_pushes import DEEP_M, HALF_WIDTH_M, blank, first_model_of, played

KINDS = (FarField, VolumeLoss, HeightOffset)


def test_of_two_explanations_of_one_thing_the_second_has_little_left_to_do() -> None:
    known, _ = observable_causes(measure(blank(12, 1), 0.006), KINDS)
    gained, left = {"far_field": 1.0}, {"volume_loss": 0.6}
    minimum = {cause: _enough(known[cause], known, gained, left) for cause in ("volume_loss", "height_offset")}
    assert minimum["volume_loss"] == 0.6 > minimum["height_offset"] > 0
    assert _enough(known["volume_loss"], known, gained, {}) == minimum["height_offset"]


def test_what_a_base_can_look_like_must_surely_make_pushes_better() -> None:
    known, _ = observable_causes(measure(blank(12, 1), 0.006), [HeightOffset, ToolBacklash])
    noise = np.random.default_rng(0).standard_normal(100)
    noise = (noise - noise.mean()) / noise.std()
    little, much = noise + 0.15, noise + 0.35  # 1.5 and 3.5 standard errors
    assert could_be_the_base(known["height_offset"], little, 0)
    assert not could_be_the_base(known["height_offset"], much, 0)
    assert not could_be_the_base(known["tool_backlash"], little, 0)


def test_a_flat_tip_is_not_taken_for_a_tool_that_goes_deeper() -> None:
    ball = first_model_of(DEEP_M)
    radius_mm, half_mm = 1e3 * ball.ball_radius_m, 1e3 * HALF_WIDTH_M
    flattened = dict(zip(BASE, ball.base, strict=True))
    for name, knot in zip(PROFILE, KNOTS, strict=True):
        away_mm, flat_mm = knot * half_mm, 0.3 * half_mm
        flattened[name] = (max(away_mm - flat_mm, 0.0) ** 2 - away_mm**2) / (2 * radius_mm)
    tool = ball.at(np.array(list(flattened.values())))
    measured = measure(played(model=tool))
    known, _ = observable_causes(measured, [HeightOffset])
    fitted = fit(first_model(measured.scene).plus(known["height_offset"]), measured)
    assert np.abs(fitted.mechanisms[-1].values).max() < 2e-4


def test_refits_that_start_from_what_was_tested_come_to_the_same() -> None:
    measured = measure(played())
    model = fit(first_model(measured.scene), measured)
    known, _ = observable_causes(measured, [VolumeLoss, HeightOffset])
    with_all, slopes, _ = _with_all(model, known, measured)
    for cause, still in known.items():
        at_start = slopes.of(np.append(np.arange(len(model.vector)), with_all.columns_of(cause)))
        found, anew = fit(model.plus(still), measured, at_start), fit(model.plus(still), measured)
        np.testing.assert_allclose(found.vector, anew.vector, rtol=1e-3, atol=1e-4)


def test_a_fit_ends_where_another_one_finds_nothing_to_gain() -> None:
    measured = measure(played())
    fitted = fit(first_model(measured.scene), measured)
    again = fit(fitted, measured)
    left, minimum = (action_losses(model, measured).mean() for model in (fitted, again))
    assert left - minimum < 2e-3 * left


def test_a_base_asks_more_of_what_it_can_look_like_and_of_that_beside_others_more_still() -> None:
    known, _ = observable_causes(measure(blank(12, 1), 0.006), [HeightOffset, ToolBacklash])
    offset, backlash = known["height_offset"], known["tool_backlash"]
    assert 0 < _minimum(backlash, False, 1.0, 0.1) < _minimum(offset, False, 1.0, 0.1)
    assert _minimum(offset, False, 1.0, 1.0) < _minimum(offset, True, 1.0, 1.0) < _minimum(offset, True, 1.0, 3.0)
    assert _minimum(backlash, False, 1.0, 1.0) == _minimum(backlash, True, 1.0, 1.0)
