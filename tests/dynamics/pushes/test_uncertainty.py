"""Intervals cover their share of residuals of known distribution; an ensemble of equal members has no spread."""

import copy
from dataclasses import replace

import numpy as np
import pytest
import torch

from pentimento.contracts.errors import ContractError
from pentimento.dynamics.pushes.last_layers import fit_last_layers, losses
from pentimento.dynamics.pushes.param2deform import Param2Deform
from pentimento.dynamics.pushes.pose import in_pose
from pentimento.dynamics.pushes.push_model import PushModel
from pentimento.dynamics.pushes.uncertainty import Pixels, fit_intervals, fit_unexplained, pixels_of
from tests.dynamics.pushes.conftest import Trained

FACTORS = np.array([2.0, 0.004, 0.02, 0.3])


def gaussian(count: int, seed: int) -> Pixels:
    """Pixels whose residuals are normal with the variance of these factors."""
    rng = np.random.default_rng(seed)
    spread, change, slope2 = 0.01 * rng.exponential(size=count), rng.normal(0, 1.5, count), 0.2 * rng.random(count)
    variance = FACTORS @ [spread, np.ones(count), change**2, slope2]
    return Pixels(np.sqrt(variance) * rng.normal(size=count), spread, change, slope2)


@pytest.mark.parametrize("coverage", [0.5, 0.9, 0.99])
def test_coverage_of_gaussian_residuals_is_nominal(coverage: float) -> None:
    intervals = fit_intervals(gaussian(40_000, 0), coverage)
    fresh = gaussian(40_000, 1)
    assert intervals.covered(fresh.pick(fresh.moved)) == pytest.approx(coverage, abs=0.01)
    wide = np.abs(fresh.change_mm) > 1.0  # not on average alone
    assert intervals.covered(fresh.pick(wide)) == pytest.approx(coverage, abs=0.02)


def test_factors_of_the_variance_are_found() -> None:
    found = fit_intervals(gaussian(200_000, 2))
    np.testing.assert_allclose([found.spread, found.noise_mm2, found.change, found.edge_mm2], FACTORS, rtol=0.1)
    assert found.deviations == pytest.approx(1.645, rel=0.02)


def test_intervals_need_pixels_that_move() -> None:
    with pytest.raises(ContractError, match="held_out"):
        fit_intervals(gaussian(100, 3)._replace(change_mm=np.zeros(100), residual_mm=np.full(100, 0.1)))


def test_three_equal_members_have_no_spread(trained: Trained) -> None:
    alike = PushModel(replace(trained.model.facts, members=3))
    for member in alike.members:
        member.load_state_dict(trained.model.members[0].state_dict())
    pixels = pixels_of(alike, in_pose(trained.held_out, trained.crop))
    assert pixels.spread_mm2.max() < 1e-9
    assert pixels_of(trained.model, in_pose(trained.held_out, trained.crop)).spread_mm2.max() > 1e-6


def test_members_share_all_but_their_last_layer(trained: Trained) -> None:
    first, second = (member.state_dict() for member in trained.model.members)
    differing = {name for name in first if not torch.equal(first[name], second[name])}
    assert differing == {"merged.4.weight", "merged.4.bias"}


def test_last_layers_lower_the_loss_and_are_the_same_again(trained: Trained) -> None:
    samples = in_pose(trained.training, trained.crop)

    def error(member: Param2Deform) -> float:
        change = member(samples.state, samples.length_m, samples.depth_m, samples.context)
        known = samples.known
        return float(losses(change - samples.change, known, trained.crop.pixels_per_m, visual_weight=1.0).mean())

    network = trained.model.members[0]
    assert isinstance(network, Param2Deform)
    with torch.no_grad():
        network = copy.deepcopy(network)
        network.last_layer.weight *= 0.8
        before = error(network)
    fitted = []
    for _ in range(2):
        again = copy.deepcopy(network).requires_grad_(True)
        fit_last_layers((again,), samples, trained.crop, visual_weight=1.0, seed=3)
        fitted.append(again)
    with torch.no_grad():
        assert error(fitted[0]) < before
    assert torch.equal(fitted[0].last_layer.weight, fitted[1].last_layer.weight)


def test_what_a_model_leaves_is_a_share_of_a_push(trained: Trained) -> None:
    samples = in_pose(trained.held_out, trained.crop)
    with torch.no_grad():
        predicted = trained.model.change(samples.state, samples.length_m, samples.depth_m, samples.context).mean(0)
    generator = torch.Generator().manual_seed(0)
    noise = 2e-5 * torch.randn(predicted.shape, generator=generator)
    exact = fit_unexplained(trained.model, samples._replace(change=predicted + noise))
    assert exact.height < 0.01 and exact.slope < 0.03
    weaker = fit_unexplained(trained.model, samples._replace(change=0.6 * predicted + noise))
    assert weaker.height == pytest.approx(0.16, abs=0.02) and weaker.slope == pytest.approx(0.16, abs=0.04)
