"""What param2deform is before any training, and what it cannot help doing."""

import pytest
import torch

from pentimento.dynamics.pushes.param2deform import Param2Deform
from pentimento.dynamics.pushes.pose import Crop

CROP = Crop(32, 500.0, 0.02)
LENGTH, DEPTH = torch.tensor([0.02, 0.03]), torch.tensor([0.006, 0.004])
CONTEXT = torch.zeros(2, dtype=torch.int64)


def network(seed: int = 0) -> Param2Deform:
    torch.manual_seed(seed)
    return Param2Deform(CROP, 8)


def state() -> torch.Tensor:
    return 0.04 + 1e-3 * torch.randn(2, 32, 32, generator=torch.Generator().manual_seed(3))


def test_untrained_it_foretells_no_change() -> None:
    assert (network()(state(), LENGTH, DEPTH, CONTEXT) == 0).all()


def test_the_tool_alone_presses_a_groove_that_deepens_along_the_travel() -> None:
    made = network()
    made.tool.data[:, 4] = 1.0
    flat = torch.full((2, 32, 32), 0.04)
    dent = made.pressed(flat, LENGTH, DEPTH, CONTEXT)
    along, across = CROP.places_m().unbind(-1)
    middle = (across.abs() < 2e-3) & (along > 0.002) & (along < 0.018)
    profile = dent[0][middle].reshape(-1, int(middle.any(0).sum())).mean(0)
    assert (profile.diff() < 0).all()
    assert dent[0].min().item() == pytest.approx(-0.006, abs=4e-4)
    torch.testing.assert_close(dent, dent.flip(1))


def test_only_heights_relative_to_the_start_matter() -> None:
    made = trained_like()
    torch.testing.assert_close(
        made(state(), LENGTH, DEPTH, CONTEXT), made(state() + 0.01, LENGTH, DEPTH, CONTEXT), atol=1e-7, rtol=0
    )


def test_a_ridge_in_the_tools_way_is_pressed_further_than_a_valley() -> None:
    made = network()
    made.tool.data[:, 4] = 1.0
    along = CROP.places_m()[..., 0]
    ridge = torch.where((along > 0.008) & (along < 0.014), 0.043, 0.04).expand(2, -1, -1)
    valley = torch.where((along > 0.008) & (along < 0.014), 0.030, 0.04).expand(2, -1, -1)
    flat = torch.full((2, 32, 32), 0.04)
    at = (16, 15)  # 11 mm ahead, on the line
    dents = [made.pressed(clay, LENGTH, DEPTH, CONTEXT)[0][at].item() for clay in (ridge, flat, valley)]
    assert dents[0] < dents[1] < dents[2] == 0


def test_gradients_agree_with_finite_differences() -> None:
    made = trained_like().double()
    length, depth = LENGTH[:1].double().requires_grad_(True), DEPTH[:1].double().requires_grad_(True)
    clay = state()[:1].double().requires_grad_(True)
    to_clay, to_length, to_depth = torch.autograd.grad(
        made(clay, length, depth, CONTEXT[:1]).square().sum(), (clay, length, depth)
    )
    wiggle = torch.randn(1, 32, 32, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    # The height at the start is a median with the gradient of the mean: exact for what lifts the start evenly.
    wiggle.view(-1)[made.start] = wiggle.view(-1)[made.start].mean()
    for inputs, direction, gradient in (
        ((clay, length, depth), (wiggle, 0, 0), (to_clay * wiggle).sum()),
        ((clay, length, depth), (0, 1, 0), to_length.sum()),
        ((clay, length, depth), (0, 0, 1), to_depth.sum()),
    ):
        with torch.no_grad():
            ends = [
                made(*(value + sign * 1e-7 * step for value, step in zip(inputs, direction, strict=True)), CONTEXT[:1])
                .square()
                .sum()
                for sign in (1, -1)
            ]
        assert ((ends[0] - ends[1]) / 2e-7).item() == pytest.approx(gradient.item(), rel=1e-3)


def test_a_change_ends_at_the_squares_edge_without_a_step() -> None:
    change = trained_like()(state(), LENGTH, DEPTH, CONTEXT)
    edge = torch.cat([change[:, 0], change[:, -1], change[:, :, 0], change[:, :, -1]], dim=1)
    assert (edge == 0).all()
    assert change.abs().max() > 0


def test_the_fingers_of_a_pinch_leave_two_dents_that_meet_as_they_close() -> None:
    torch.manual_seed(0)
    made = Param2Deform(Crop(64, 640.0, 0.05), 8, pinches=True)
    made.tool.data[:, 4] = 1.0
    flat = torch.full((2, 64, 64), 0.04)
    dents = made.pressed(flat, torch.tensor([0.004, 0.036]), torch.tensor([0.006, 0.006]), CONTEXT)
    torch.testing.assert_close(dents, dents.flip(2))
    lowest = dents[:, 32].argmin(1)  # of the line along which they close
    from_middle_mm = (31.5 - lowest) / 0.64
    assert from_middle_mm.tolist() == pytest.approx([23.0, 7.0], abs=1.0)


def test_an_odd_side_is_refused() -> None:
    with pytest.raises(ValueError, match="must be even"):
        Param2Deform(Crop(33, 500.0, 0.02), 8)


def trained_like() -> Param2Deform:
    """A network whose last layer says something."""
    made = network()
    for parameter in made.merged[-1].parameters():
        parameter.data.normal_(0.0, 0.1, generator=torch.Generator().manual_seed(5))
    made.tool.data[:, 4] = 0.7
    return made
