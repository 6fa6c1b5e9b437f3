"""A base model in each stroke's own frame: the same along +x, and it turns with the stroke."""

import numpy as np
import pytest
import torch

from pentimento.dynamics.strokes.extended import StrokeModel, base_model
from pentimento.dynamics.strokes.own_frame import for_the_canvas
from pentimento.dynamics.strokes.simulation import StrokeContext, extended_mark
from pentimento.dynamics.strokes.traj2stroke import Traj2StrokeParameters

MODEL = base_model(Traj2StrokeParameters((0.8, 1.1), (0.002, -0.001), 0.5, 0.001, 1.0, 0.9))


def points(model: StrokeModel, path: torch.Tensor) -> torch.Tensor:
    return extended_mark(model.mark(), model.mechanisms, StrokeContext(path, {})).points_m


@pytest.fixture
def path() -> torch.Tensor:
    """[1, 1, 9, 5] A bent stroke from the origin along +x, without times."""
    share = torch.linspace(0, 1, 9)
    xy = torch.stack([0.03 * share, 0.02 * share * (1 - share)], dim=-1)
    return torch.cat([torch.full((9, 1), torch.nan), xy, torch.full((9, 2), -0.001)], dim=-1)[None, None]


def test_along_x_nothing_changes(path: torch.Tensor) -> None:
    torch.testing.assert_close(points(for_the_canvas(MODEL), path), points(MODEL, path))


@pytest.mark.parametrize("degrees", [50, 180, -90])
def test_the_mark_turns_and_moves_with_the_stroke(path: torch.Tensor, degrees: float) -> None:
    angle, place = np.deg2rad(degrees), torch.tensor([0.1, 0.05])
    turn = torch.tensor([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]], dtype=torch.float32)
    moved = path.clone()
    moved[..., 1:3] = path[..., 1:3] @ turn.T + place
    model = for_the_canvas(MODEL)
    torch.testing.assert_close(points(model, moved), points(model, path) @ turn.T + place, atol=1e-7, rtol=1e-5)


def test_a_point_is_finite_and_has_finite_gradients(path: torch.Tensor) -> None:
    still = (0 * path).requires_grad_(True)
    found = points(for_the_canvas(MODEL), still)
    (slope,) = torch.autograd.grad(found.sum(), still)
    assert found.isfinite().all() and slope.isfinite().all()
