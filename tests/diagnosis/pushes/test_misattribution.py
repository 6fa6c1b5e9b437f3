"""A cause gives way to what could be taken for it, and where it does not show what it is named for."""

from __future__ import annotations

import numpy as np
import pytest

from pentimento.diagnosis.pushes.fit import fit
from pentimento.diagnosis.pushes.jacobian import action_losses
from pentimento.diagnosis.pushes.measured import measure
from pentimento.diagnosis.pushes.misattribution import (
    goes_with_place,
    goes_with_time,
    lookalike_is_as_good,
    shows_signature,
)
from pentimento.diagnosis.pushes.search import observable_causes
from pentimento.dynamics.pushes.analytic import first_model
from pentimento.dynamics.pushes.mechanisms.far_field import FarField
from pentimento.dynamics.pushes.mechanisms.height_offset import HeightOffset
from pentimento.dynamics.pushes.mechanisms.lookalikes import ClosedStart, LowerRims, Sinking
from pentimento.dynamics.pushes.mechanisms.mechanism import Mechanism
from pentimento.dynamics.pushes.mechanisms.springback import Springback
from pentimento.dynamics.pushes.mechanisms.volume_loss import VolumeLoss
from tests.dynamics.pushes.played_pushes import blank, mechanism, played

WEAKLY = {"kept_by_compression": 0.2, "kept_by_log_dwell": 0.06}


@pytest.mark.parametrize(
    ("named", "hidden", "as_good"),
    [
        (Springback, [(Sinking, {"by_log_dwell": 0.08})], True),
        (Springback, [(Sinking, {"by_log_dwell": 0.04}), (Springback, WEAKLY)], True),  # it does nearly all
        (Springback, [(Springback, {"kept_by_log_dwell": 0.15})], False),
        (FarField, [(LowerRims, {"share": 0.3})], True),
        (FarField, [(FarField, {"share": 0.3})], False),
        (HeightOffset, [(ClosedStart, {"less_deep_m": 0.001})], True),
        (HeightOffset, [(HeightOffset, {"lower_m": -0.001})], False),
        (HeightOffset, [(HeightOffset, {"lower_m": 0.001})], False),
        (VolumeLoss, [(LowerRims, {"share": 0.3})], False),  # that is what it is
    ],
)
def test_a_cause_gives_way_to_what_could_be_taken_for_it(
    named: type[Mechanism], hidden: list[tuple[type[Mechanism], dict[str, float]]], as_good: bool
) -> None:
    measured = measure(played([mechanism(kind, blank(), **values) for kind, values in hidden]))
    known, _ = observable_causes(measured, [named])
    base = fit(first_model(measured.scene), measured)
    model = fit(base.plus(known[named.cause]), measured)
    assert action_losses(model, measured).mean() < action_losses(base, measured).mean()
    assert lookalike_is_as_good(named.cause, model, measured, 0) == as_good


@pytest.mark.parametrize(
    ("times", "compression", "dwell", "shown"),
    [
        (["dwell_s"], (-2.0, 0.2), (0.0, 0.02), False),  # as where walls slide in
        (["dwell_s"], (0.5, 0.2), (0.0, 0.02), False),  # any base that is wrong about depths
        (["dwell_s"], (-0.5, 0.2), (0.1, 0.02), True),
        (["dwell_s", "until_scan_s"], (0.3, 0.2), (0.03, 0.02), False),
        ([], (0.5, 0.2), (0.0, 0.02), True),  # nothing more can be seen of it
        ([], (-2.0, 0.2), (0.0, 0.02), False),
    ],
)
def test_what_recovers_keeps_more_where_it_was_held_longer_and_where_that_is_not_known_where_it_was_compressed(
    times: list[str], compression: tuple[float, float], dwell: tuple[float, float], shown: bool
) -> None:
    values = {"kept_by_compression": compression, "kept_by_log_dwell": dwell, "recovered_by_log_time": (0.0, 0.1)}
    assert shows_signature(Springback(np.zeros(3), dict.fromkeys(times, 1.0)), values) == shown


@pytest.mark.parametrize(
    ("times", "dwell", "does"),
    [(["dwell_s"], (0.18, 0.01), True), (["dwell_s"], (0.03, 0.01), False), ([], (0.18, 0.01), False)],
)
def test_what_is_certain_to_go_with_recorded_times_is_no_shape(
    times: list[str], dwell: tuple[float, float], does: bool
) -> None:
    values = {"kept_by_compression": (2.0, 0.1), "kept_by_log_dwell": dwell, "recovered_by_log_time": (0.0, 0.1)}
    assert goes_with_time(Springback(np.zeros(3), dict.fromkeys(times, 1.0)), values) == does
    assert not goes_with_time(mechanism(FarField, blank()), {"share": (0.3, 0.01)})


@pytest.mark.parametrize(
    ("lower", "to_the_right", "to_the_top", "does"),
    [
        ((0.6e-3, 0.07e-3), (0.1e-3, 0.1e-3), (0.0, 0.1e-3), False),  # as a base that is wrong about shallow depths
        ((0.0, 0.1e-3), (0.3e-3, 0.1e-3), (-0.3e-3, 0.1e-3), True),  # both together
        ((0.0, 0.1e-3), (0.3e-3, 0.1e-3), (0.0, 0.1e-3), False),
        ((0.0, 0.1e-3), (-0.4e-3, 0.1e-3), (0.0, 0.0), True),  # all starts in one line
    ],
)
def test_what_is_certain_to_differ_from_place_to_place_is_no_shape(
    lower: tuple[float, float], to_the_right: tuple[float, float], to_the_top: tuple[float, float], does: bool
) -> None:
    values = {"lower_m": lower, "lower_to_the_right_m": to_the_right, "lower_to_the_top_m": to_the_top}
    assert goes_with_place(mechanism(HeightOffset, blank()), values) == does
    assert not goes_with_place(mechanism(FarField, blank()), {"share": (0.3, 0.01)})


def test_a_cause_without_a_signature_shows_all_that_it_is() -> None:
    assert shows_signature(mechanism(FarField, blank()), {"share": (0.01, 0.2)})
