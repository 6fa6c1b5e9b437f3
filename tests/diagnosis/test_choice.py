"""Choice among causes that explain the data equally well."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
import torch

from pentimento.contracts.strokes import example_table
from pentimento.diagnosis.score import Step, most_parsimonious, unconfirmed
from pentimento.diagnosis.strokes.choice import prefer_same_family, prune_redundant, prune_unlikely
from pentimento.diagnosis.strokes.fit import first_model, fit
from pentimento.diagnosis.strokes.measured import Measured, load_measured
from pentimento.diagnosis.strokes.model import Model, identity
from pentimento.diagnosis.strokes.predict import action_losses, predicted
from pentimento.dynamics.strokes.mechanisms.bristle_lag import BristleLag
from pentimento.dynamics.strokes.mechanisms.latency import Latency
from pentimento.dynamics.strokes.mechanisms.speed_bleed import SpeedBleed
from pentimento.dynamics.strokes.mechanisms.speed_density import SpeedDensity
from pentimento.dynamics.strokes.mechanisms.speed_width import SpeedWidth
from pentimento.dynamics.strokes.mechanisms.tool_wear import ToolWear
from pentimento.dynamics.strokes.simulation import Mechanism
from tests.diagnosis.strokes.test_learned_residual import photographed


@pytest.mark.parametrize(
    ("by_the_simple", "chosen", "rivals"),
    [
        (0.97, "speed_width", ("speed_bleed",)),  # surely less than the other removes, but nearly as much
        (0.80, "speed_bleed", ()),
    ],
)
def test_chooses_fewest_quantities_among_nearly_equal_causes(
    by_the_simple: float, chosen: str, rivals: tuple[str, ...]
) -> None:
    """`speed_bleed` can do what `speed_width` does, and soften the edge."""
    quantities = {kind.cause: len(kind.quantities) for kind in (SpeedWidth, SpeedBleed)}
    removed = np.random.default_rng(0).uniform(0.9, 1.1, 60)
    losses = {"speed_bleed": 3.0 - removed, "speed_width": 3.0 - by_the_simple * removed}
    step = most_parsimonious({}, losses, 3.0, quantities=quantities, seed=0, log=lambda line: None)
    assert (step.chosen, step.rivals) == (chosen, rivals)


@pytest.mark.parametrize(
    ("paler", "softer", "left"),
    [
        (-0.3, 0.2, {"speed_density"}),  # paler at speed, and softer: there is less paint
        (-0.3, -0.2, {"speed_bleed"}),  # paler and sharper: it bleeds less
        (-0.3, -0.002, {"speed_density"}),  # as sharp as before, for all that can be known
        (0.0, 0.2, {"speed_bleed", "speed_density"}),
        (-0.02, 0.3, {"speed_bleed", "speed_density"}),  # surely paler, and by nothing to speak of
    ],
)
def test_extra_quantity_decides_between_nested_causes(paler: float, softer: float, left: set[str]) -> None:
    refits, observed = refitted(SpeedDensity, [paler, softer, 0.05], (SpeedBleed, SpeedDensity))
    losses = {cause: action_losses(refit, observed) for cause, refit in refits.items()}
    error = float(action_losses(fit(refits["speed_bleed"].without("speed_bleed"), observed), observed).mean())
    assert set(prune_unlikely(losses, error, refits, observed)) == left


@pytest.mark.parametrize(
    ("softer", "rivals"),
    [
        (0.0, ()),  # a bleed whose edge stays as it is: the mark is wider, and that is all
        (1.6, ("speed_bleed",)),
    ],
)
def test_prunes_rival_without_additional_effect(softer: float, rivals: tuple[str, ...]) -> None:
    refits, observed = refitted(SpeedBleed, [softer, 0.2], (SpeedWidth, SpeedBleed))
    step = Step({}, "speed_width", ("speed_bleed",))
    assert prune_redundant(step, refits, observed).rivals == rivals


def test_keeps_rivals_of_another_form() -> None:
    refits, observed = refitted(SpeedWidth, [0.4], (SpeedWidth, ToolWear))
    step = Step({}, "speed_width", ("tool_wear",))
    assert prune_redundant(step, refits, observed).rivals == ("tool_wear",)


TRAILING: tuple[type[Mechanism], ...] = (BristleLag, Latency)


@pytest.mark.parametrize("worse_by", [1e-7, 1e-5])  # of errors of 1e-4: within what they scatter by, and surely beyond
@pytest.mark.parametrize(("hidden", "other", "value"), [(Latency, "bristle_lag", 0.05), (BristleLag, "latency", 0.003)])
def test_displacement_by_speed_decides_between_lag_and_latency(
    hidden: type[Mechanism], other: str, value: float, worse_by: float
) -> None:
    refits, observed = refitted(hidden, [value], TRAILING)
    scatter = 1e-6 * np.random.default_rng(4).standard_normal(60)
    losses = {hidden.cause: 1e-4 + worse_by + scatter, other: np.full(60, 1e-4)}
    step = Step({}, other, (hidden.cause,) if worse_by < 1e-6 else ())
    settled = prefer_same_family(step, losses, 3e-4, refits=refits, measured=observed, seed=0, log=lambda line: None)
    assert (settled.chosen, settled.rivals) == (hidden.cause, ())
    kept = prefer_same_family(
        replace(step, chosen=hidden.cause, rivals=(other,)),
        losses,
        3e-4,
        refits=refits,
        measured=observed,
        seed=0,
        log=print,
    )
    assert (kept.chosen, kept.rivals) == (hidden.cause, ())


def test_same_family_cause_with_small_effect_replaces_nothing() -> None:
    refits, observed = refitted(Latency, [0.05], TRAILING)
    losses = {"latency": np.full(60, 2.5e-4), "bristle_lag": np.full(60, 1e-4)}
    step = Step({}, "bristle_lag", ())
    assert (
        prefer_same_family(step, losses, 3e-4, refits=refits, measured=observed, seed=0, log=lambda line: None) == step
    )


def test_causes_with_equal_covariates_are_compared_by_error_only() -> None:
    refits, observed = refitted(SpeedWidth, [0.4], (SpeedWidth, SpeedBleed))
    losses = {"speed_width": np.full(60, 1e-4), "speed_bleed": np.full(60, 1e-4)}
    step = Step({}, "speed_bleed", ("speed_width",))
    assert (
        prefer_same_family(step, losses, 3e-4, refits=refits, measured=observed, seed=0, log=lambda line: None) == step
    )


def refitted(
    hidden: type[Mechanism], values: list[float], kinds: Sequence[type[Mechanism]]
) -> tuple[dict[str, Model], Measured]:
    """Each of the kinds fitted to sixty strokes with the hidden cause, and those strokes."""
    measured = load_measured(example_table(60))
    base = first_model(measured)
    truth = hidden(torch.tensor(values, dtype=torch.float64), identity(hidden, measured.context).reference)
    after = predicted(base.plus(truth), measured)
    observed = photographed(measured, after + 0.003 * np.random.default_rng(0).standard_normal(after.shape))
    return {kind.cause: fit(base.plus(identity(kind, observed.context)), observed) for kind in kinds}, observed


def test_further_causes_need_stronger_confirmation_than_the_first() -> None:
    p = {"volume_loss": 0.3, "height_offset": 0.3, "springback": 0.001}
    assert unconfirmed(["volume_loss", "height_offset", "springback"], p, 0.1) == ["height_offset"]
    assert unconfirmed(["springback", "volume_loss"], p, 0.1) == ["volume_loss"]
    assert unconfirmed(["springback", "volume_loss"], p, 0.35) == []
    assert unconfirmed(["volume_loss"], {"volume_loss": 0.5}, 0.1) == ["volume_loss"]
    assert unconfirmed([], {}, 0.1) == []
