"""Of causes that explain the same the simplest is taken, unless one does what the other cannot."""

import numpy as np
import pytest
import torch

from pentimento.contracts.strokes import example_table
from pentimento.gap.choice import simplest_of_the_best, without_unlikely
from pentimento.gap.fit import first_model, fit
from pentimento.gap.foretell import foretold, identity
from pentimento.gap.measured import load_measured
from pentimento.gap.search import action_losses
from pentimento.stroke_dynamics.mechanisms.speed_bleed import SpeedBleed
from pentimento.stroke_dynamics.mechanisms.speed_density import SpeedDensity
from pentimento.stroke_dynamics.mechanisms.speed_width import SpeedWidth
from tests.gap.test_habits import photographed


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
    assert set(without_unlikely(losses, refits, made)) == left
