"""Causes that are large are found in the whole residual; small ones are left to the search that takes scatter out."""

import numpy as np
import pytest
import torch

from pentimento.contracts.strokes import example_table
from pentimento.gap.fit import first_model, fit
from pentimento.gap.foretell import Model, foretold, identity
from pentimento.gap.measured import Measured, load_measured
from pentimento.gap.score import Evidence
from pentimento.gap.search import (
    _shortlist,
    _without_unlikely,
    action_losses,
    find_large,
    is_large,
    simplest_of_the_best,
)
from pentimento.stroke_dynamics.mechanisms.bristle_lag import BristleLag
from pentimento.stroke_dynamics.mechanisms.path_scale import PathScale
from pentimento.stroke_dynamics.mechanisms.speed_bleed import SpeedBleed
from pentimento.stroke_dynamics.mechanisms.speed_density import SpeedDensity
from pentimento.stroke_dynamics.mechanisms.speed_width import SpeedWidth
from tests.gap.test_habits import photographed


def lagging(distance_m: float) -> tuple[Measured, Model]:
    """Strokes whose ink trails the tip, each one a little darker or paler than the others, and a first base."""
    measured = load_measured(example_table(40))
    base = fit(first_model(measured), measured)
    mechanism = BristleLag(
        torch.tensor([distance_m], dtype=torch.float64), identity(BristleLag, measured.context).reference
    )
    after = foretold(base.plus(mechanism), measured)
    rng = np.random.default_rng(0)
    darker = 1 + 0.05 * rng.standard_normal((len(measured), 1, 1, 1))
    below = measured.samples.before.numpy()
    after = below + darker * (after - below) + 0.01 * rng.standard_normal(after.shape)
    strokes = photographed(measured, after)
    return strokes, fit(first_model(strokes), strokes)


@pytest.mark.parametrize(("distance_m", "found"), [(0.009, {"bristle_lag"}), (0.0004, set[str]())])
def test_a_lag_is_found_first_if_it_is_large(distance_m: float, found: set[str]) -> None:
    measured, base = lagging(distance_m)
    begun = find_large(base, measured, measured.context, 0.0, (BristleLag, PathScale), 0, lambda line: None)
    assert begun.found == found
    if found:
        lag = next(m for m in begun.model.mechanisms if m.cause == "bristle_lag")
        assert is_large(lag)
        assert float(lag.values[0]) == pytest.approx(distance_m, rel=0.1)


def test_a_cause_that_gains_little_from_none_is_tried_where_its_test_is_sure() -> None:
    """A lag of millimetres is far from linear: its test is sure, what it would gain to second order is not."""
    lag = Evidence(0.001, 0.003, 0.02, (-0.001, 0.04), -0.0001)
    assert shortlist({"bristle_lag": lag, "path_scale": lag._replace(p_adjusted=0.5)}, 0.01) == ["bristle_lag"]
    assert shortlist({"bristle_lag": lag._replace(gain=-0.001)}, 0.01) == []


def shortlist(evidence: dict[str, Evidence], limit: float) -> list[str]:
    observable = {kind.cause: kind(torch.zeros(len(kind.quantities)), {}) for kind in (BristleLag, PathScale)}
    return _shortlist(evidence, limit, 0.05, observable)


@pytest.mark.parametrize(
    ("by_the_simple", "chosen", "rivals"),
    [
        (0.97, "speed_width", ("speed_bleed",)),  # surely less than the other removes, but nearly as much
        (0.80, "speed_bleed", ()),
    ],
)
def test_of_causes_that_explain_nearly_the_same_the_simplest_is_taken(
    by_the_simple: float, chosen: str, rivals: tuple[str, ...]
) -> None:
    """`speed_bleed` can do what `speed_width` does, and soften the edge."""
    quantities = {kind.cause: len(kind.quantities) for kind in (SpeedWidth, SpeedBleed)}
    removed = np.random.default_rng(0).uniform(0.9, 1.1, 60)
    losses = {"speed_bleed": 3.0 - removed, "speed_width": 3.0 - by_the_simple * removed}
    step = simplest_of_the_best({}, losses, 3.0, quantities, 0, lambda line: None)
    assert (step.chosen, step.rivals) == (chosen, rivals)


@pytest.mark.parametrize(
    ("paler", "softer", "left"),
    [
        (-0.3, 0.2, {"speed_density"}),  # paler at speed, and softer: there is less paint
        (-0.3, -0.2, {"speed_bleed"}),  # paler and sharper: it bleeds less
        (0.0, 0.2, {"speed_bleed", "speed_density"}),
    ],
)
def test_of_two_causes_with_one_form_what_one_has_beyond_the_other_decides(
    paler: float, softer: float, left: set[str]
) -> None:
    measured = load_measured(example_table(60))
    base = first_model(measured)
    kinds = (SpeedBleed, SpeedDensity)
    truth = identity(SpeedDensity, measured.context)
    truth = SpeedDensity(torch.tensor([paler, softer, 0.05], dtype=torch.float64), truth.reference)
    rng = np.random.default_rng(0)
    after = foretold(base.plus(truth), measured)
    made = photographed(measured, after + 0.003 * rng.standard_normal(after.shape))
    refits = {kind.cause: fit(base.plus(identity(kind, made.context)), made) for kind in kinds}
    losses = {cause: action_losses(refit, made) for cause, refit in refits.items()}
    assert set(_without_unlikely(losses, refits, made)) == left
