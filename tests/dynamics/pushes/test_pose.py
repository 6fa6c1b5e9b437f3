"""Constant pose: sampling there and back, samples, and losses."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from torch import Tensor

from pentimento.contracts.frames import canvas_to_stroke, pixel_to_canvas
from pentimento.dynamics.pushes.pose import (
    Crop,
    gradient,
    height_errors,
    in_pose,
    inner,
    slope_errors,
    to_canvas,
    to_pose,
)
from tests.dynamics.pushes.conftest import Trained

CROP = Crop(32, 500.0, 0.02)
WINDOW = torch.tensor([[0.0, 0.0, 0.2, 0.16]], dtype=torch.float64)
SHAPE = (80, 100)
KNOWN = torch.ones(1, 20, 30, dtype=torch.bool)


def canvas(height_of: object) -> Tensor:
    """[1, H, W] of a function of x and y."""
    column, row = np.meshgrid(np.arange(SHAPE[1]), np.arange(SHAPE[0]))
    xy = pixel_to_canvas(np.stack([column, row], -1), WINDOW[0].numpy(), 500.0)
    return torch.from_numpy(height_of(xy[..., 0], xy[..., 1]))[None]  # type: ignore[operator]


def action(x: float, y: float, theta: float) -> Tensor:
    return torch.tensor([[x, y, theta, 0.02, 0.005]], dtype=torch.float64)


def test_to_pose_samples_plane_exactly() -> None:
    given = action(0.09, 0.08, 0.7)
    seen = to_pose(canvas(lambda x, y: 3 * x - 2 * y), WINDOW, given, CROP)[0]
    along, across = CROP.places_m().double().unbind(-1)
    cos, sin = math.cos(0.7), math.sin(0.7)
    x, y = 0.09 + cos * along - sin * across, 0.08 + sin * along + cos * across
    torch.testing.assert_close(seen, 3 * x - 2 * y, atol=1e-6, rtol=0)


def test_crop_rows_run_left_to_right_and_columns_ahead() -> None:
    bump_ahead = canvas(lambda x, y: np.exp(-((x - 0.1) ** 2 + (y - 0.11) ** 2) / 1e-5))  # pushing up, 3 cm ahead
    bump_left = canvas(lambda x, y: np.exp(-((x - 0.08) ** 2 + (y - 0.08) ** 2) / 1e-5))  # and 2 cm to the left
    for bump, place in ((bump_ahead, (0.03, 0.0)), (bump_left, (0.0, 0.02))):
        seen = to_pose(bump, WINDOW, action(0.1, 0.08, math.pi / 2), CROP)[0]
        row, column = divmod(int(seen.argmax()), 32)
        along, across = CROP.places_m()[row, column].tolist()
        assert (along, across) == pytest.approx(place, abs=2e-3)


@pytest.mark.parametrize("theta", [0.0, 1.1, -2.4])
def test_to_canvas_places_change_at_push(theta: float) -> None:
    along, across = CROP.places_m().double().unbind(-1)
    change = torch.exp(-((along - 0.015) ** 2 / 2e-4 + (across + 0.005) ** 2 / 1e-4))[None]
    on_canvas = to_canvas(change, WINDOW, action(0.1, 0.08, theta), shape=SHAPE, crop=CROP)[0].numpy()
    column, row = np.meshgrid(np.arange(SHAPE[1]), np.arange(SHAPE[0]))
    xy = pixel_to_canvas(np.stack([column, row], -1), WINDOW[0].numpy(), 500.0)
    local = canvas_to_stroke(xy, 0.1, 0.08, theta)
    expected = np.exp(-((local[..., 0] - 0.015) ** 2 / 2e-4 + (local[..., 1] + 0.005) ** 2 / 1e-4))
    inside = (np.abs(local[..., 0] - 0.012) < 0.028) & (np.abs(local[..., 1]) < 0.028)
    np.testing.assert_allclose(on_canvas[inside], expected[inside], atol=0.03)
    assert (on_canvas[(np.abs(local[..., 0] - 0.012) > 0.035) | (np.abs(local[..., 1]) > 0.035)] == 0).all()


def test_pose_round_trip_preserves_smooth_map() -> None:
    smooth = canvas(lambda x, y: np.exp(-((x - 0.1) ** 2 + (y - 0.08) ** 2) / 2e-4))
    given = action(0.09, 0.08, 0.4)
    back = to_canvas(to_pose(smooth, WINDOW, given, CROP), WINDOW, given, shape=SHAPE, crop=CROP)
    middle = (slice(None), slice(34, 46), slice(44, 56))
    torch.testing.assert_close(back[middle], smooth[middle], atol=0.02, rtol=0)


def test_to_pose_is_rotation_invariant() -> None:
    """Rotating state and action together by a right angle leaves the crop unchanged."""
    state = torch.rand(1, 80, 80, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    window = torch.tensor([[0.0, 0.0, 0.16, 0.16]], dtype=torch.float64)
    seen = to_pose(state, window, action(0.07, 0.09, 0.3), CROP)
    turned = to_pose(state.rot90(1, (1, 2)), window, action(0.16 - 0.09, 0.07, 0.3 + math.pi / 2), CROP)
    torch.testing.assert_close(seen, turned, atol=1e-5, rtol=0)


def test_pose_gradients_match_finite_differences() -> None:
    crop = Crop(8, 500.0, 0.005)
    window = torch.tensor([[0.0, 0.0, 0.02, 0.02]], dtype=torch.float64)
    state = torch.rand(1, 10, 10, dtype=torch.float64, generator=torch.Generator().manual_seed(1), requires_grad=True)
    change = torch.rand(1, 8, 8, dtype=torch.float64, generator=torch.Generator().manual_seed(2), requires_grad=True)
    at = action(0.0112, 0.0097, 0.31).requires_grad_(True)
    assert torch.autograd.gradcheck(lambda s, a: to_pose(s, window, a, crop), (state, at), eps=1e-7, atol=1e-4)
    assert torch.autograd.gradcheck(
        lambda c, a: to_canvas(c, window, a, shape=(10, 10), crop=crop), (change, at), eps=1e-7, atol=1e-4
    )


def test_rejects_start_outside_crop() -> None:
    with pytest.raises(ValueError, match="start must lie in the square"):
        Crop(32, 500.0, 0.1)


def test_constant_offset_has_no_slope_error() -> None:
    offset = torch.full((1, 20, 30), 2e-3)
    assert height_errors(offset, KNOWN).item() == pytest.approx(4.0)
    assert slope_errors(offset, KNOWN, 640.0).item() == pytest.approx(0.0, abs=1e-10)


def test_slope_error_of_tilt_is_slope_squared() -> None:
    tilt = (torch.arange(30) / 640.0 * 0.1 + torch.arange(20)[:, None] / 640.0 * 0.2)[None]
    assert slope_errors(tilt, KNOWN, 640.0).item() == pytest.approx(0.05, rel=1e-3)


def test_gradient_order_is_columns_then_rows() -> None:
    ramp = torch.arange(6.0).expand(4, 6)[None]
    across, down = gradient(ramp)[0, :, 1:-1, 1:-1]
    assert (across == 1).all()
    assert (down == 0).all()


def test_errors_ignore_unknown_pixels() -> None:
    known = KNOWN.clone()
    known[0, 5:8, 7:9] = False
    wild = torch.zeros(1, 20, 30)
    wild[0, 5:8, 7:9] = 1e3
    assert height_errors(wild, known).item() == 0
    assert slope_errors(wild, known, 640.0).item() == 0


def test_inner_requires_four_known_neighbours() -> None:
    known = KNOWN.clone()
    known[0, 5, 7] = False
    inside = inner(known)[0]
    assert not inside[0].any()
    assert not inside[[5, 4, 6, 5, 5], [7, 7, 7, 6, 8]].any()
    assert inside[4, 6]
    assert inside.sum() == 18 * 28 - 5


def test_in_pose_contains_push_and_masks_outside_window(trained: Trained) -> None:
    samples, crop = trained.training, trained.crop
    seen = in_pose(samples, crop)
    along, across = crop.places_m().unbind(-1)
    for number in range(4):
        length = float(seen.length_m[number])
        on_line = (across.abs() < 2e-3) & (along > 0.5 * length - 1e-3) & (along < length + 1e-3)
        beside = (across.abs() > 0.03) & seen.known[number]
        assert seen.change[number][on_line].mean() < -1e-3
        assert seen.change[number][beside].abs().mean() < 3e-4
    edge = samples.pick(np.array([0]))._replace(action=np.array([[0.005, 0.06, 0.0, 0.02, 0.005]]))
    known = in_pose(edge, crop).known[0]
    assert not known[:, along[0] < -0.007].any()
    assert known[10:30, along[0] > -0.004].all()


def test_mirrored_samples_match_mirrored_table(trained: Trained) -> None:
    """Mirroring the crop equals the crop of a mirrored table."""
    seen = in_pose(trained.training, trained.crop)
    mirrored = seen.mirrored(torch.ones(len(seen.state), dtype=torch.bool))
    x, y, theta, length, depth = trained.training.action.T
    other = trained.training._replace(
        before=trained.training.before[:, ::-1].copy(),
        after=trained.training.after[:, ::-1].copy(),
        action=np.stack([x, 0.12 - y, -theta, length, depth], axis=1),
    )
    torch.testing.assert_close(in_pose(other, trained.crop).state, mirrored.state, atol=1e-6, rtol=0)
    torch.testing.assert_close(in_pose(other, trained.crop).change, mirrored.change, atol=1e-6, rtol=0)
