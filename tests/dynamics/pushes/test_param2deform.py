"""The push network before training, its symmetries, and the clearance of the tool."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from pentimento.dynamics.pushes.param2deform import Param2Deform, Underside, clearance_mm
from pentimento.dynamics.pushes.pose import Crop

CROP = Crop(32, 500.0, 0.02)
LENGTH, DEPTH = torch.tensor([0.02, 0.03]), torch.tensor([0.006, 0.004])
CONTEXT = torch.zeros(2, dtype=torch.int64)
X, Y = torch.meshgrid(torch.linspace(-20, 40, 61), torch.linspace(-20, 20, 41), indexing="xy")


def network(seed: int = 0) -> Param2Deform:
    torch.manual_seed(seed)
    return Param2Deform(CROP, 8)


def state() -> torch.Tensor:
    return 0.04 + 1e-3 * torch.randn(2, 32, 32, generator=torch.Generator().manual_seed(3))


def test_untrained_network_predicts_no_change() -> None:
    assert (network()(state(), LENGTH, DEPTH, CONTEXT) == 0).all()


def test_tool_geometry_presses_deepening_groove() -> None:
    net = network()
    net.tool.data[:, 4] = 1.0
    flat = torch.full((2, 32, 32), 0.04)
    dent = net.pressed(flat, LENGTH, DEPTH, CONTEXT)
    along, across = CROP.places_m().unbind(-1)
    middle = (across.abs() < 2e-3) & (along > 0.002) & (along < 0.018)
    profile = dent[0][middle].reshape(-1, int(middle.any(0).sum())).mean(0)
    assert (profile.diff() < 0).all()
    assert dent[0].min().item() == pytest.approx(-0.006, abs=4e-4)
    torch.testing.assert_close(dent, dent.flip(1))


def test_network_depends_only_on_heights_relative_to_start() -> None:
    net = trained_like()
    torch.testing.assert_close(
        net(state(), LENGTH, DEPTH, CONTEXT), net(state() + 0.01, LENGTH, DEPTH, CONTEXT), atol=1e-7, rtol=0
    )


def test_tool_presses_ridge_more_than_valley() -> None:
    net = network()
    net.tool.data[:, 4] = 1.0
    along = CROP.places_m()[..., 0]
    ridge = torch.where((along > 0.008) & (along < 0.014), 0.043, 0.04).expand(2, -1, -1)
    valley = torch.where((along > 0.008) & (along < 0.014), 0.030, 0.04).expand(2, -1, -1)
    flat = torch.full((2, 32, 32), 0.04)
    at = (16, 15)  # 11 mm ahead, on the line of travel
    dents = [net.pressed(clay, LENGTH, DEPTH, CONTEXT)[0][at].item() for clay in (ridge, flat, valley)]
    assert dents[0] < dents[1] < dents[2] == 0


def test_network_gradients_match_finite_differences() -> None:
    net = trained_like().double()
    length, depth = LENGTH[:1].double().requires_grad_(True), DEPTH[:1].double().requires_grad_(True)
    clay = state()[:1].double().requires_grad_(True)
    to_clay, to_length, to_depth = torch.autograd.grad(
        net(clay, length, depth, CONTEXT[:1]).square().sum(), (clay, length, depth)
    )
    wiggle = torch.randn(1, 32, 32, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    # The height at the start is a median with the gradient of the mean: exact for a uniform change at the start.
    wiggle.view(-1)[net.start] = wiggle.view(-1)[net.start].mean()
    for inputs, direction, gradient in (
        ((clay, length, depth), (wiggle, 0, 0), (to_clay * wiggle).sum()),
        ((clay, length, depth), (0, 1, 0), to_length.sum()),
        ((clay, length, depth), (0, 0, 1), to_depth.sum()),
    ):
        with torch.no_grad():
            ends = [
                net(*(value + sign * 1e-7 * step for value, step in zip(inputs, direction, strict=True)), CONTEXT[:1])
                .square()
                .sum()
                for sign in (1, -1)
            ]
        assert ((ends[0] - ends[1]) / 2e-7).item() == pytest.approx(gradient.item(), rel=1e-3)


def test_change_fades_to_zero_at_crop_edge() -> None:
    change = trained_like()(state(), LENGTH, DEPTH, CONTEXT)
    edge = torch.cat([change[:, 0], change[:, -1], change[:, :, 0], change[:, :, -1]], dim=1)
    assert (edge == 0).all()
    assert change.abs().max() > 0


def test_pinch_leaves_two_dents_that_approach() -> None:
    torch.manual_seed(0)
    net = Param2Deform(Crop(64, 640.0, 0.05), 8, pinches=True)
    net.tool.data[:, 4] = 1.0
    flat = torch.full((2, 64, 64), 0.04)
    dents = net.pressed(flat, torch.tensor([0.004, 0.036]), torch.tensor([0.006, 0.006]), CONTEXT)
    torch.testing.assert_close(dents, dents.flip(2))
    lowest = dents[:, 32].argmin(1)  # along the line of closing
    from_middle_mm = (31.5 - lowest) / 0.64
    assert from_middle_mm.tolist() == pytest.approx([23.0, 7.0], abs=1.0)


def test_rejects_odd_crop_side() -> None:
    with pytest.raises(ValueError, match="must be even"):
        Param2Deform(Crop(33, 500.0, 0.02), 8)


def trained_like() -> Param2Deform:
    """A network with a non-zero last layer."""
    net = network()
    for parameter in net.merged[-1].parameters():
        parameter.data.normal_(0.0, 0.1, generator=torch.Generator().manual_seed(5))
    net.tool.data[:, 4] = 0.7
    return net


def tool(along: float, across: float, power: float, sinking: float = 1.0) -> Underside:
    return Underside(*(torch.tensor([value]) for value in (along, across, power, sinking)))


def clearance(length: float, depth: float, of: Underside) -> Tensor:
    return clearance_mm(X, Y, length_mm=torch.tensor([length]), depth_mm=torch.tensor([depth]), tool=of)[0]


def exhaustive_clearance(length: float, depth: float, of: Underside) -> Tensor:
    """Minimum over 2000 stations of the travel."""
    height = 0.5 * (of.along_mm * of.across_mm).sqrt()
    share = torch.linspace(0, 1, 2000)[:, None, None]
    distance = ((X - share * length) / of.along_mm) ** 2 + (Y / of.across_mm) ** 2
    return (height * distance ** (of.power / 2) - share * depth * of.sinking).amin(0)


@pytest.mark.parametrize("length", [0.0, 5.0, 30.0])
def test_ball_clearance_matches_exhaustive_search(length: float) -> None:
    ball = tool(8.0, 8.0, 2.0)
    near = (X + 0.0).abs() < 12
    torch.testing.assert_close(
        clearance(length, 6.0, ball)[near], exhaustive_clearance(length + 0.05, 6.0, ball)[near], atol=0.02, rtol=1e-3
    )


@pytest.mark.parametrize("power", [1.5, 2.0, 4.0, 6.0])
def test_clearance_is_exact_on_line_of_travel(power: float) -> None:
    other = tool(8.0, 5.0, power)
    line = (Y == 0) & (X > -8) & (X < 30)
    torch.testing.assert_close(
        clearance(25.0, 6.0, other)[line], exhaustive_clearance(25.05, 6.0, other)[line], atol=0.02, rtol=1e-3
    )


def test_clearance_is_never_below_exact_minimum() -> None:
    flat = tool(8.0, 8.0, 5.0)
    lowest = exhaustive_clearance(25.05, 6.0, flat)
    near = lowest < 10
    assert (clearance(25.0, 6.0, flat) >= lowest - 0.02)[near].all()


def test_tip_reaches_depth_only_at_end() -> None:
    found = clearance(30.0, 6.0, tool(8.0, 8.0, 2.0))
    end = (X == 30) & (Y == 0)
    assert found[end].item() == pytest.approx(-6.0, abs=0.02)
    assert found.min().item() >= -6.02
    torch.testing.assert_close(found, found.flip(0))  # the tool is symmetric about its travel


def test_sinking_scales_depth() -> None:
    half = clearance(30.0, 6.0, tool(8.0, 8.0, 2.0, 0.5))
    torch.testing.assert_close(half, clearance(30.0, 3.0, tool(8.0, 8.0, 2.0)))


def test_clearance_gradients_match_finite_differences() -> None:
    where = (torch.tensor([[3.0, 11.0, 18.0]]).double(), torch.tensor([[1.0, -2.0, 4.0]]).double())
    numbers = torch.tensor([12.0, 5.0, 8.0, 6.0, 2.6, 0.9], dtype=torch.float64, requires_grad=True)

    def lowest(of: Tensor) -> Tensor:
        underside = Underside(of[2:3], of[3:4], of[4:5], of[5:6])
        return clearance_mm(*where, length_mm=of[0:1], depth_mm=of[1:2], tool=underside)

    assert torch.autograd.gradcheck(lowest, (numbers,), eps=1e-6, atol=1e-5)
    still = torch.zeros(1, requires_grad=True)
    clearance_mm(X, Y, length_mm=still, depth_mm=still * 0, tool=tool(8.0, 8.0, 2.0)).sum().backward()
    assert torch.isfinite(still.grad).all()  # type: ignore[arg-type]
