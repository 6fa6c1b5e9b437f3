"""What a cause is credited with."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from pentimento.contracts.strokes import example_table
from pentimento.diagnosis.strokes.diagnose import _is_of_use, _without
from pentimento.diagnosis.strokes.fit import first_model
from pentimento.diagnosis.strokes.measured import load_measured
from pentimento.diagnosis.strokes.model import Model, UnevenEnds, identity
from pentimento.diagnosis.strokes.search import Search
from pentimento.diagnosis.verdict import Finding
from pentimento.dynamics.strokes.mechanisms.bristle_lag import BristleLag
from pentimento.dynamics.strokes.mechanisms.ink_depletion import InkDepletion
from pentimento.dynamics.strokes.mechanisms.path_offset import PathOffset
from pentimento.dynamics.strokes.mechanisms.path_scale import PathScale
from pentimento.dynamics.strokes.mechanisms.speed_width import SpeedWidth
from pentimento.dynamics.strokes.simulation import Mechanism


@pytest.fixture(scope="module")
def base() -> Model:
    measured = load_measured(example_table(16))
    return first_model(measured).plus(identity(UnevenEnds, measured.context))


def causes(model: Model) -> set[str]:
    return {m.cause for m in model.mechanisms}


def test_without_a_cause_that_stood_in_for_the_ends_the_base_has_its_ends_again(base: Model) -> None:
    lag = base.without("uneven_ends").plus(
        BristleLag(torch.tensor([0.01]), {}), PathOffset(torch.tensor([1e-3, 0.0]), {})
    )
    assert causes(_without(lag, ["bristle_lag"], base)) == {"path_offset", "uneven_ends"}
    np.testing.assert_array_equal(_without(lag, ["bristle_lag", "path_offset"], base).vector, base.vector)


def test_ends_that_are_there_are_kept_and_a_model_that_loses_nothing_stays(base: Model) -> None:
    both = base.plus(BristleLag(torch.tensor([0.01]), {}))
    assert causes(_without(both, ["bristle_lag"], base)) == {"uneven_ends"}
    lag = both.without("uneven_ends")
    assert causes(_without(lag, [], base)) == {"bristle_lag"}


def design_value(cause: str, gain: float, surely: float, confirmed_p: float = 0.005, left: float = 1.0) -> Finding:
    """A finding that is worth ``gain`` of the gap, and at least ``surely``, where others leave ``left`` of it."""
    single = {"bristle_lag": "distance_m", "speed_width": "width_per_log_speed"}
    values = {single[cause]: (0.004, 0.001)} if cause in single else {}
    return Finding(
        cause, 0.001, confirmed_p, gain, (surely, 2 * gain - surely), values, (), of_what_is_left=gain / left
    )


def is_of_use(finding: Finding, *others: Finding, test_split: int = 10) -> bool:
    """Beside other established causes."""
    measured = load_measured(example_table(16))
    observable: dict[str, Mechanism] = {
        kind.cause: identity(kind, measured.context)
        for kind in (BristleLag, PathOffset, PathScale, SpeedWidth, InkDepletion)
    }
    model = first_model(measured)
    found = Search(model, model, (), observable, {}, 0.0, {}, frozenset())
    return _is_of_use(finding, (*others, finding), found, test_split)


@pytest.mark.parametrize(
    ("little", "of_use"),
    [
        (design_value("path_offset", 0.04, 0.02), False),  # a lag's wrong form displaces as well
        (design_value("speed_width", 0.04, 0.02), True),
        (design_value("speed_width", 0.04, -0.01), False),
        (design_value("speed_width", 0.09, -0.01), False),
        (design_value("speed_width", 0.11, -0.01), True),
        (design_value("speed_width", 0.005, 0.004), False),
    ],
)
def test_what_is_worth_little_must_be_of_another_kind_and_sure(little: Finding, of_use: bool) -> None:
    assert is_of_use(little, design_value("bristle_lag", 1.0, 0.9)) == of_use


def test_what_confirming_strokes_are_certain_of_must_be_worth_little_and_not_surely_so() -> None:
    lag = design_value("bristle_lag", 1.0, 0.9)
    assert is_of_use(design_value("speed_width", 0.04, -0.05, confirmed_p=0.0005), lag, test_split=24)
    assert not is_of_use(design_value("speed_width", 0.015, -0.05, confirmed_p=0.0005), lag, test_split=24)
    assert not is_of_use(design_value("path_offset", 0.04, -0.05, confirmed_p=0.0005), lag, test_split=24)


def test_what_goes_with_nothing_of_the_other_may_be_little_beside_it_where_it_is_beyond_doubt() -> None:
    wider = design_value("speed_width", 1.0, 0.9)
    assert is_of_use(design_value("ink_depletion", 0.03, 0.02, confirmed_p=0.0005), wider, test_split=24)
    assert not is_of_use(design_value("ink_depletion", 0.03, 0.02), wider, test_split=24)
    assert not is_of_use(design_value("ink_depletion", 0.03, -0.01, confirmed_p=0.0005), wider, test_split=24)


def test_of_the_only_cause_that_is_surely_confirmed_few_sealed_strokes_must_only_not_deny_it() -> None:
    assert is_of_use(design_value("bristle_lag", 0.015, -0.02))
    assert not is_of_use(design_value("bristle_lag", -0.001, -0.02))
    assert not is_of_use(design_value("bristle_lag", 0.015, -0.02, confirmed_p=0.02))
    assert not is_of_use(design_value("bristle_lag", 0.05, -0.02), test_split=24)


def test_so_of_the_only_one_of_its_kind_that_is_not_little_beside_the_other() -> None:
    lag, wider = design_value("bristle_lag", 0.03, -0.01), design_value("speed_width", 0.05, -0.01)
    assert is_of_use(lag, wider) and is_of_use(wider, lag)
    assert not is_of_use(lag, design_value("path_scale", 0.05, -0.01))
    assert not is_of_use(lag, design_value("speed_width", 0.5, 0.2))


def test_what_acts_with_a_sign_that_it_cannot_have_is_of_no_use() -> None:
    lag = design_value("bristle_lag", 0.5, 0.4, confirmed_p=0.0005)
    assert is_of_use(lag)
    assert not is_of_use(replace(lag, values={"distance_m": (-0.0001, 0.00002)}))


def test_what_is_told_by_one_number_must_surely_have_one() -> None:
    lag = design_value("bristle_lag", 0.5, 0.4, confirmed_p=0.0005)
    assert not is_of_use(replace(lag, values={"distance_m": (0.0004, 0.0003)}))


def test_what_is_little_of_the_gap_may_be_much_of_what_others_leave_of_it() -> None:
    offset, little = (
        design_value("path_offset", 0.97, 0.9, left=0.98),
        {"gain": 0.005, "surely": 0.003, "confirmed_p": 0.0005},
    )
    assert is_of_use(design_value("speed_width", **little, left=0.03), offset, test_split=24)
    assert not is_of_use(design_value("speed_width", **little, left=1.0), offset, test_split=24)
    # Of what displaces as well, an offset can leave nothing; what has a form can.
    assert is_of_use(design_value("bristle_lag", **little, left=0.03), offset, test_split=24)
    assert not is_of_use(
        design_value("path_scale", **little, left=0.03),
        design_value("bristle_lag", 0.97, 0.9, left=0.98),
        test_split=24,
    )


@pytest.mark.parametrize(
    ("gain", "surely", "confirmed_p", "of_use"),
    [(0.015, 0.004, 0.0005, True), (0.015, -0.001, 0.0005, False), (0.015, 0.004, 0.005, False),
     (0.009, 0.004, 0.0005, False)],
)  # fmt: skip
def test_what_is_faint_must_leave_neither_the_confirming_strokes_nor_the_sealed_ones_a_doubt(
    gain: float, surely: float, confirmed_p: float, of_use: bool
) -> None:
    assert is_of_use(design_value("speed_width", gain, surely, confirmed_p), test_split=24) == of_use
    assert (
        is_of_use(design_value("speed_width", gain, surely, confirmed_p), design_value("bristle_lag", 1.0, 0.9))
        == of_use
    )
