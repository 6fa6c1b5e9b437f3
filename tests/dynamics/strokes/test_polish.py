"""The search without gradients finds what a gradient does not see, leaves softness, and makes nothing worse."""

from dataclasses import replace

import pytest
import torch
from torch import Tensor, nn

from pentimento.dynamics.strokes.joint import polish
from pentimento.dynamics.strokes.samples import StrokeSamples
from pentimento.dynamics.strokes.training import predict, weighted_l1
from pentimento.dynamics.strokes.traj2stroke import Traj2Stroke
from tests.dynamics.strokes.conftest import TRUTH


class Pair(nn.Module):
    """Two parameters of unlike size."""

    def __init__(self, first: float, second: float) -> None:
        super().__init__()
        self.first, self.second = nn.Parameter(torch.tensor([first])), nn.Parameter(torch.tensor(second))

    def away(self) -> Tensor:
        """How far from (1.5, -40) in L1, the second a tenth as much."""
        return (self.first[0] - 1.5).abs() + 0.1 * (self.second + 40).abs()


def test_polish_finds_a_minimum_at_a_corner() -> None:
    pair = Pair(0.8, -35.0)
    polish(pair, pair.away)
    assert pair.first.item() == pytest.approx(1.5, abs=0.01)
    assert pair.second.item() == pytest.approx(-40, abs=0.1)


def test_polish_descends_steps_with_zero_gradient() -> None:
    pair = Pair(0.0, -40.0)
    before = pair.away().item()
    polish(pair, lambda: (pair.away() * 20).floor() / 20)
    assert pair.away().item() < 0.1 * before


def test_where_nothing_is_lower_it_stays() -> None:
    pair = Pair(1.5, -40.0)
    polish(pair, pair.away)
    assert pair.away().item() == 0
    assert pair.first.requires_grad


def test_softness_stays(made_by_truth: StrokeSamples) -> None:
    """L1 would have crisp marks crisper yet; what moves them is left to be seen."""
    model = Traj2Stroke(replace(TRUTH, softness=2 * TRUTH.softness, thickness_at_contact_m=1.3e-3))
    before = model.parameters_si()

    def loss() -> Tensor:
        return weighted_l1(predict(model, made_by_truth), made_by_truth, 2.0)

    first = loss().item()
    polish(model, loss)
    assert loss().item() < 0.7 * first
    assert model.parameters_si().softness == before.softness
    assert model.parameters_si().thickness_at_contact_m != before.thickness_at_contact_m
