"""The constant pose: a picture of the push's frame, and back, exact for what bilinear sampling can hold."""

import math

import numpy as np
import pytest
import torch
from torch import Tensor

from pentimento.contracts.frames import canvas_to_stroke, pixel_to_canvas
from pentimento.dynamics.pushes.pose import Crop, to_canvas, to_pose

CROP = Crop(32, 500.0, 0.02)
WINDOW = torch.tensor([[0.0, 0.0, 0.2, 0.16]], dtype=torch.float64)
SHAPE = (80, 100)


def canvas(height_of: object) -> Tensor:
    """[1, H, W] of a function of x and y."""
    column, row = np.meshgrid(np.arange(SHAPE[1]), np.arange(SHAPE[0]))
    xy = pixel_to_canvas(np.stack([column, row], -1), WINDOW[0].numpy(), 500.0)
    return torch.from_numpy(height_of(xy[..., 0], xy[..., 1]))[None]  # type: ignore[operator]


def action(x: float, y: float, theta: float) -> Tensor:
    return torch.tensor([[x, y, theta, 0.02, 0.005]], dtype=torch.float64)


def test_a_plane_is_seen_in_the_frame_of_the_push() -> None:
    given = action(0.09, 0.08, 0.7)
    seen = to_pose(canvas(lambda x, y: 3 * x - 2 * y), WINDOW, given, CROP)[0]
    along, across = CROP.places_m().double().unbind(-1)
    cos, sin = math.cos(0.7), math.sin(0.7)
    x, y = 0.09 + cos * along - sin * across, 0.08 + sin * along + cos * across
    torch.testing.assert_close(seen, 3 * x - 2 * y, atol=1e-6, rtol=0)


def test_row_0_is_to_the_left_of_the_push_and_columns_go_along_it() -> None:
    bump_ahead = canvas(lambda x, y: np.exp(-((x - 0.1) ** 2 + (y - 0.11) ** 2) / 1e-5))  # pushing up, 3 cm ahead
    bump_left = canvas(lambda x, y: np.exp(-((x - 0.08) ** 2 + (y - 0.08) ** 2) / 1e-5))  # and 2 cm to the left
    for bump, place in ((bump_ahead, (0.03, 0.0)), (bump_left, (0.0, 0.02))):
        seen = to_pose(bump, WINDOW, action(0.1, 0.08, math.pi / 2), CROP)[0]
        row, column = divmod(int(seen.argmax()), 32)
        along, across = CROP.places_m()[row, column].tolist()
        assert (along, across) == pytest.approx(place, abs=2e-3)


@pytest.mark.parametrize("theta", [0.0, 1.1, -2.4])
def test_a_change_goes_to_where_the_push_is(theta: float) -> None:
    along, across = CROP.places_m().double().unbind(-1)
    change = torch.exp(-((along - 0.015) ** 2 / 2e-4 + (across + 0.005) ** 2 / 1e-4))[None]
    on_canvas = to_canvas(change, WINDOW, action(0.1, 0.08, theta), SHAPE, CROP)[0].numpy()
    column, row = np.meshgrid(np.arange(SHAPE[1]), np.arange(SHAPE[0]))
    xy = pixel_to_canvas(np.stack([column, row], -1), WINDOW[0].numpy(), 500.0)
    local = canvas_to_stroke(xy, 0.1, 0.08, theta)
    expected = np.exp(-((local[..., 0] - 0.015) ** 2 / 2e-4 + (local[..., 1] + 0.005) ** 2 / 1e-4))
    inside = (np.abs(local[..., 0] - 0.012) < 0.028) & (np.abs(local[..., 1]) < 0.028)
    np.testing.assert_allclose(on_canvas[inside], expected[inside], atol=0.03)
    assert (on_canvas[(np.abs(local[..., 0] - 0.012) > 0.035) | (np.abs(local[..., 1]) > 0.035)] == 0).all()


def test_there_and_back_keeps_what_is_smooth() -> None:
    smooth = canvas(lambda x, y: np.exp(-((x - 0.1) ** 2 + (y - 0.08) ** 2) / 2e-4))
    given = action(0.09, 0.08, 0.4)
    back = to_canvas(to_pose(smooth, WINDOW, given, CROP), WINDOW, given, SHAPE, CROP)
    middle = (slice(None), slice(34, 46), slice(44, 56))
    torch.testing.assert_close(back[middle], smooth[middle], atol=0.02, rtol=0)


def test_the_crop_sees_a_turned_canvas_alike() -> None:
    """Turning the state and the action together by a right angle leaves what the crop sees."""
    state = torch.rand(1, 80, 80, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    window = torch.tensor([[0.0, 0.0, 0.16, 0.16]], dtype=torch.float64)
    seen = to_pose(state, window, action(0.07, 0.09, 0.3), CROP)
    turned = to_pose(state.rot90(1, (1, 2)), window, action(0.16 - 0.09, 0.07, 0.3 + math.pi / 2), CROP)
    torch.testing.assert_close(seen, turned, atol=1e-5, rtol=0)


def test_gradients_agree_with_finite_differences() -> None:
    crop = Crop(8, 500.0, 0.005)
    window = torch.tensor([[0.0, 0.0, 0.02, 0.02]], dtype=torch.float64)
    state = torch.rand(1, 10, 10, dtype=torch.float64, generator=torch.Generator().manual_seed(1), requires_grad=True)
    change = torch.rand(1, 8, 8, dtype=torch.float64, generator=torch.Generator().manual_seed(2), requires_grad=True)
    at = action(0.0112, 0.0097, 0.31).requires_grad_(True)
    assert torch.autograd.gradcheck(lambda s, a: to_pose(s, window, a, crop), (state, at), eps=1e-7, atol=1e-4)
    assert torch.autograd.gradcheck(
        lambda c, a: to_canvas(c, window, a, (10, 10), crop), (change, at), eps=1e-7, atol=1e-4
    )


def test_a_start_beyond_the_square_is_refused() -> None:
    with pytest.raises(ValueError, match="start must lie in the square"):
        Crop(32, 500.0, 0.1)
