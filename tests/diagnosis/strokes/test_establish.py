"""The decision which causes are established."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from pentimento.contracts.strokes import example_table
from pentimento.diagnosis.strokes.establish import _is_of_use, without_causes
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


def test_removing_a_lag_restores_the_bases_uneven_ends(base: Model) -> None:
    lag = base.without("uneven_ends").plus(
        BristleLag(torch.tensor([0.01]), {}), PathOffset(torch.tensor([1e-3, 0.0]), {})
    )
    assert causes(without_causes(lag, ["bristle_lag"], base)) == {"path_offset", "uneven_ends"}
    np.testing.assert_array_equal(without_causes(lag, ["bristle_lag", "path_offset"], base).vector, base.vector)


def test_without_keeps_existing_ends(base: Model) -> None:
    both = base.plus(BristleLag(torch.tensor([0.01]), {}))
    assert causes(without_causes(both, ["bristle_lag"], base)) == {"uneven_ends"}
    lag = both.without("uneven_ends")
    assert causes(without_causes(lag, [], base)) == {"bristle_lag"}


def finding(cause: str, gain: float, surely: float, confirmed_p: float = 0.005, left: float = 1.0) -> Finding:
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
        (finding("path_offset", 0.04, 0.02), False),  # a lag's wrong form displaces as well
        (finding("speed_width", 0.04, 0.02), True),
        (finding("speed_width", 0.04, -0.01), False),
        (finding("speed_width", 0.09, -0.01), False),
        (finding("speed_width", 0.11, -0.01), True),
        (finding("speed_width", 0.005, 0.004), False),
    ],
)
def test_small_gain_needs_certainty_and_another_kind(little: Finding, of_use: bool) -> None:
    assert is_of_use(little, finding("bristle_lag", 1.0, 0.9)) == of_use


def test_certain_confirmation_needs_a_small_gain_only() -> None:
    lag = finding("bristle_lag", 1.0, 0.9)
    assert is_of_use(finding("speed_width", 0.04, -0.05, confirmed_p=0.0005), lag, test_split=24)
    assert not is_of_use(finding("speed_width", 0.015, -0.05, confirmed_p=0.0005), lag, test_split=24)
    assert not is_of_use(finding("path_offset", 0.04, -0.05, confirmed_p=0.0005), lag, test_split=24)


def test_unrelated_cause_beyond_doubt_may_gain_little_beside_another() -> None:
    wider = finding("speed_width", 1.0, 0.9)
    assert is_of_use(finding("ink_depletion", 0.03, 0.02, confirmed_p=0.0005), wider, test_split=24)
    assert not is_of_use(finding("ink_depletion", 0.03, 0.02), wider, test_split=24)
    assert not is_of_use(finding("ink_depletion", 0.03, -0.01, confirmed_p=0.0005), wider, test_split=24)


def test_small_test_split_must_not_contradict_a_single_confirmed_cause() -> None:
    assert is_of_use(finding("bristle_lag", 0.015, -0.02))
    assert not is_of_use(finding("bristle_lag", -0.001, -0.02))
    assert not is_of_use(finding("bristle_lag", 0.015, -0.02, confirmed_p=0.02))
    assert not is_of_use(finding("bristle_lag", 0.05, -0.02), test_split=24)


def test_small_test_split_must_not_contradict_the_only_cause_of_its_kind() -> None:
    lag, wider = finding("bristle_lag", 0.03, -0.01), finding("speed_width", 0.05, -0.01)
    assert is_of_use(lag, wider) and is_of_use(wider, lag)
    assert not is_of_use(lag, finding("path_scale", 0.05, -0.01))
    assert not is_of_use(lag, finding("speed_width", 0.5, 0.2))


def test_rejects_impossible_sign() -> None:
    lag = finding("bristle_lag", 0.5, 0.4, confirmed_p=0.0005)
    assert is_of_use(lag)
    assert not is_of_use(replace(lag, values={"distance_m": (-0.0001, 0.00002)}))


def test_single_quantity_must_be_significant() -> None:
    lag = finding("bristle_lag", 0.5, 0.4, confirmed_p=0.0005)
    assert not is_of_use(replace(lag, values={"distance_m": (0.0004, 0.0003)}))


def test_gain_is_relative_to_what_other_causes_leave() -> None:
    offset, little = (
        finding("path_offset", 0.97, 0.9, left=0.98),
        {"gain": 0.005, "surely": 0.003, "confirmed_p": 0.0005},
    )
    assert is_of_use(finding("speed_width", **little, left=0.03), offset, test_split=24)
    assert not is_of_use(finding("speed_width", **little, left=1.0), offset, test_split=24)
    # Of what displaces as well, an offset can leave nothing; what has a form can.
    assert is_of_use(finding("bristle_lag", **little, left=0.03), offset, test_split=24)
    assert not is_of_use(
        finding("path_scale", **little, left=0.03),
        finding("bristle_lag", 0.97, 0.9, left=0.98),
        test_split=24,
    )


@pytest.mark.parametrize(
    ("gain", "surely", "confirmed_p", "of_use"),
    [(0.015, 0.004, 0.0005, True), (0.015, -0.001, 0.0005, False), (0.015, 0.004, 0.005, False),
     (0.009, 0.004, 0.0005, False)],
)  # fmt: skip
def test_faint_cause_needs_certainty_on_both_splits(
    gain: float, surely: float, confirmed_p: float, of_use: bool
) -> None:
    assert is_of_use(finding("speed_width", gain, surely, confirmed_p), test_split=24) == of_use
    assert is_of_use(finding("speed_width", gain, surely, confirmed_p), finding("bristle_lag", 1.0, 0.9)) == of_use
