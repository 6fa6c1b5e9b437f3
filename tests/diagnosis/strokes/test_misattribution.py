"""A cause that stands in for an effect without a name is rejected; a true cause is kept."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from pentimento.contracts.colour import linear_to_srgb
from pentimento.contracts.strokes import example_table
from pentimento.diagnosis.strokes.fit import first_model, fit
from pentimento.diagnosis.strokes.measured import Measured, load_measured
from pentimento.diagnosis.strokes.misattribution import (
    generic_curve_suffices,
    shows_signature,
    trails_both_ways,
    trails_by_another_power,
    uneven_ends_suffice,
)
from pentimento.diagnosis.strokes.model import Model, UnevenEnds, identity
from pentimento.diagnosis.strokes.modes import MODES, AllModes, Modulation
from pentimento.diagnosis.strokes.predict import action_losses, ink, predicted, predicted_linear
from pentimento.dynamics.strokes.mechanisms.bristle_lag import BristleLag
from pentimento.dynamics.strokes.mechanisms.geometry import delayed, speed_m_s, trailing
from pentimento.dynamics.strokes.mechanisms.latency import Latency
from pentimento.dynamics.strokes.mechanisms.speed_density import SpeedDensity
from pentimento.dynamics.strokes.mechanisms.speed_width import SpeedWidth
from pentimento.dynamics.strokes.mechanisms.tool_wear import ToolWear
from pentimento.dynamics.strokes.simulation import Mechanism, StrokeContext
from pentimento.dynamics.strokes.traj2stroke import Mark
from tests.diagnosis.strokes.test_learned_residual import photographed

ROWS = 72
TEST_SPLIT = np.arange(0, ROWS, 3)
KNOWN = np.setdiff1d(np.arange(ROWS), TEST_SPLIT)
SESSION = np.linspace(-1, 1, ROWS)
WARMTH = SESSION + 0.5 * np.random.default_rng(2).standard_normal(ROWS)
"""Rises over the session, and goes up and down beside that."""


def widened(by: NDArray[np.float64]) -> tuple[Model, Measured]:
    """A fitted base, and strokes that are wider than it says by these shares, with noise."""
    plain = load_measured(example_table(ROWS, seed=6))
    model = fit(first_model(plain), plain, iterations=4)
    amounts = {f"modulation_{mode}": np.zeros(ROWS) for mode in MODES} | {"modulation_width": by}
    with_columns = replace(plain, covariates=amounts)
    drawn = model.plus(Modulation(torch.zeros(len(AllModes.quantities), dtype=torch.float64), {}))
    noise = 0.01 * np.random.default_rng(1).standard_normal(plain.samples.after.shape)
    after = np.clip(linear_to_srgb(predicted_linear(ink(drawn, with_columns), with_columns)) + noise, 0, 1).astype(
        np.float32
    )
    samples = plain.samples._replace(after=torch.from_numpy(after), action=torch.arange(ROWS))
    columns = {"order": np.arange(float(ROWS)), "clock": 5 * SESSION**3, "temperature_c": 20 + WARMTH}
    return model, replace(plain, samples=samples, covariates=columns, block=np.arange(ROWS))


def wear_gives_way(model: Model, strokes: Measured) -> bool:
    known, test_split = strokes.pick(KNOWN), strokes.pick(TEST_SPLIT)
    wear = identity(ToolWear, strokes.context)
    worn = fit(model.plus(wear), known)
    assert (
        action_losses(worn, test_split).mean() < 0.97 * action_losses(model, test_split).mean()
    )  # it does explain something
    return generic_curve_suffices(wear, worn, model, known=known, test_split=test_split, seed=0)


def test_wear_yields_to_a_curve_over_temperature() -> None:
    assert wear_gives_way(*widened(0.2 * WARMTH))


def test_true_wear_of_another_form_is_kept() -> None:
    assert not wear_gives_way(*widened(0.2 * np.tanh(2 * SESSION)))


def test_true_wear_is_kept_beside_a_larger_unknown_effect() -> None:
    gusts = np.cos(2.4 * np.arange(ROWS))
    model, strokes = widened(0.2 * SESSION + 0.2 * gusts)
    gusty = replace(strokes, covariates=strokes.covariates | {"draught_m_s": gusts})
    assert not wear_gives_way(model, gusty)


@pytest.mark.parametrize(("density", "shown"), [((0.3, 0.1), True), ((-0.3, 0.1), True), ((0.15, 0.1), False)])
def test_signature_needs_a_significant_quantity(density: tuple[float, float], shown: bool) -> None:
    others = {"softening_per_log_speed": (0.5, 0.01), "spreading_per_log_speed": (0.2, 0.01)}
    mechanism = SpeedDensity(torch.zeros(3), {})
    assert shows_signature(mechanism, others | {"density_per_log_speed": density}) == shown


def test_single_quantity_is_its_own_signature() -> None:
    assert shows_signature(SpeedWidth(torch.zeros(1), {}), {"width_per_log_speed": (0.01, 0.1)})


class TrailsByAPower(Mechanism):
    """By 2 mm at 0.05 m/s, and by the power ``values[0]`` of the speed."""

    cause = "trails_by_a_power"
    site = "trajectory"
    driving_covariate = "motion"
    quantities = BristleLag.quantities

    @property
    def active(self) -> bool:
        return True

    def mark(self, mark: Mark, context: StrokeContext) -> Mark:
        distance_m = 0.002 * (speed_m_s(context.path) / 0.05) ** self.values[0]
        return mark._replace(points_m=trailing(mark.points_m, distance_m[..., None]))


class LateByAPower(TrailsByAPower):
    """By the time in which a stroke goes as far."""

    cause = "late_by_a_power"

    def mark(self, mark: Mark, context: StrokeContext) -> Mark:
        speed = speed_m_s(context.path)
        late_s = 0.002 * (speed / 0.05) ** self.values[0] / speed
        return mark._replace(points_m=delayed(mark.points_m, context.path[..., 0], late_s[..., None]))


@pytest.mark.parametrize("beside", [(), (UnevenEnds,)])
@pytest.mark.parametrize(
    ("power", "kind", "another"),
    [(0.0, BristleLag, False), (1.0, BristleLag, True), (0.2, BristleLag, False),
     (1.0, Latency, False), (0.0, Latency, True), (0.8, Latency, False)],
)  # fmt: skip
def test_rejects_lag_with_another_power_of_speed(
    power: float, kind: type[Mechanism], another: bool, beside: tuple[type[Mechanism], ...]
) -> None:
    measured = load_measured(example_table(60, seed=3))
    base = first_model(measured)
    by_a_power = LateByAPower if kind is Latency else TrailsByAPower
    truth = by_a_power(torch.tensor([power], dtype=torch.float64), {})
    after = predicted(base.plus(truth), measured)
    observed = photographed(measured, after + 0.003 * np.random.default_rng(0).standard_normal(after.shape))
    model = fit(base.plus(*(identity(each, observed.context) for each in (*beside, kind))), observed)
    assert trails_by_another_power(identity(kind, observed.context), model, observed) == another


def test_width_cause_has_no_power_of_speed() -> None:
    model, strokes = widened(0.2 * SESSION)
    assert not trails_by_another_power(SpeedWidth(torch.zeros(1), {}), model, strokes)


class DrawnInwards(Mechanism):
    """By 2 mm at 0.05 m/s, and by a power of the speed, to the inside of bends: before them by the first share of that
    and after them by the second.
    """

    cause = "drawn_inwards"
    site = "trajectory"
    driving_covariate = "motion"
    quantities = 3 * BristleLag.quantities

    def mark(self, mark: Mark, context: StrokeContext) -> Mark:
        before, after, power = self.values
        distance_m = 0.002 * (speed_m_s(context.path)[..., None] / 0.05) ** power
        leading = trailing(mark.points_m.flip(-2), distance_m).flip(-2) - mark.points_m
        following = trailing(mark.points_m, distance_m) - mark.points_m
        return mark._replace(points_m=mark.points_m + before * leading + after * following)


@pytest.mark.parametrize(("kind", "power"), [(BristleLag, 0.0), (Latency, 1.0)])
@pytest.mark.parametrize(
    ("before", "after", "both_ways"), [(0.5, 0.5, True), (-0.5, 0.5, True), (0.0, 1.0, False), (0.1, 0.9, False)]
)
def test_rejects_lag_for_symmetric_bends(
    before: float, after: float, both_ways: bool, kind: type[Mechanism], power: float
) -> None:
    measured = load_measured(example_table(60, seed=3))
    base = first_model(measured)
    truth = DrawnInwards(torch.tensor([before, after, power], dtype=torch.float64), {})
    photographs = predicted(base.plus(truth), measured)
    observed = photographed(measured, photographs + 0.003 * np.random.default_rng(0).standard_normal(photographs.shape))
    model = fit(base.plus(identity(kind, observed.context)), observed)
    assert trails_both_ways(model.mechanisms[-1], model, observed) == both_ways


def test_width_cause_does_not_trail() -> None:
    model, strokes = widened(0.2 * SESSION)
    assert not trails_both_ways(SpeedWidth(torch.zeros(1), {}), model, strokes)


@pytest.mark.parametrize("kind", [BristleLag, Latency])
def test_uneven_ends_replace_lag_without_cut_corners(kind: type[Mechanism]) -> None:
    measured = load_measured(example_table(60, seed=3))
    base = first_model(measured)
    inactive = identity(kind, measured.context)
    cause = kind(torch.tensor([kind.quantities[0].typical / 2], dtype=torch.float64), inactive.reference)
    ends = UnevenEnds(torch.tensor([2e-4, -2e-4, 0.0, 0.0], dtype=torch.float64), {})
    for truth, at_ends in ((ends, True), (cause, False)):
        photographs = predicted(base.plus(truth), measured)
        observed = photographed(
            measured, photographs + 0.003 * np.random.default_rng(0).standard_normal(photographs.shape)
        )
        model = fit(base.plus(inactive), observed)
        assert float(model.mechanisms[-1].values[0]) > 0
        assert uneven_ends_suffice(model.mechanisms[-1], model, observed, 0) == at_ends
