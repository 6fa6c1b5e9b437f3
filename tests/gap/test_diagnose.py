"""What a cause is credited with."""

import numpy as np
import pytest
import torch

from pentimento.contracts.strokes import example_table
from pentimento.gap.diagnose import _without
from pentimento.gap.ends import UnevenEnds
from pentimento.gap.fit import first_model
from pentimento.gap.foretell import Model, identity
from pentimento.gap.measured import load_measured
from pentimento.stroke_dynamics.mechanisms.bristle_lag import BristleLag
from pentimento.stroke_dynamics.mechanisms.path_offset import PathOffset


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
