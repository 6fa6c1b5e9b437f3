"""The swept underside against the closed form of a ball, and against a search along the travel."""

import pytest
import torch
from torch import Tensor

from pentimento.dynamics.pushes.sweep import Underside, clearance_mm

X, Y = torch.meshgrid(torch.linspace(-20, 40, 61), torch.linspace(-20, 20, 41), indexing="xy")


def tool(along: float, across: float, power: float, sinking: float = 1.0) -> Underside:
    return Underside(*(torch.tensor([value]) for value in (along, across, power, sinking)))


def clearance(length: float, depth: float, of: Underside) -> Tensor:
    return clearance_mm(X, Y, torch.tensor([length]), torch.tensor([depth]), of)[0]


def discovery_split(length: float, depth: float, of: Underside) -> Tensor:
    """The lowest pass over 2000 moments of the travel."""
    height = 0.5 * (of.along_mm * of.across_mm).sqrt()
    share = torch.linspace(0, 1, 2000)[:, None, None]
    distance = ((X - share * length) / of.along_mm) ** 2 + (Y / of.across_mm) ** 2
    return (height * distance ** (of.power / 2) - share * depth * of.sinking).amin(0)


@pytest.mark.parametrize("length", [0.0, 5.0, 30.0])
def test_a_ball_passes_as_a_search_along_its_travel_finds(length: float) -> None:
    ball = tool(8.0, 8.0, 2.0)
    near = (X + 0.0).abs() < 12
    torch.testing.assert_close(
        clearance(length, 6.0, ball)[near], discovery_split(length + 0.05, 6.0, ball)[near], atol=0.02, rtol=1e-3
    )


@pytest.mark.parametrize("power", [1.5, 2.0, 4.0, 6.0])
def test_other_undersides_pass_exactly_on_the_line_of_travel(power: float) -> None:
    other = tool(8.0, 5.0, power)
    line = (Y == 0) & (X > -8) & (X < 30)
    torch.testing.assert_close(
        clearance(25.0, 6.0, other)[line], discovery_split(25.05, 6.0, other)[line], atol=0.02, rtol=1e-3
    )


def test_no_underside_is_foretold_lower_than_it_passes() -> None:
    flat = tool(8.0, 8.0, 5.0)
    lowest = discovery_split(25.05, 6.0, flat)
    near = lowest < 10
    assert (clearance(25.0, 6.0, flat) >= lowest - 0.02)[near].all()


def test_the_tip_reaches_its_depth_at_the_end_and_only_there() -> None:
    found = clearance(30.0, 6.0, tool(8.0, 8.0, 2.0))
    end = (X == 30) & (Y == 0)
    assert found[end].item() == pytest.approx(-6.0, abs=0.02)
    assert found.min().item() >= -6.02
    torch.testing.assert_close(found, found.flip(0))  # the tool is symmetric about its travel


def test_sinking_scales_the_depth() -> None:
    half = clearance(30.0, 6.0, tool(8.0, 8.0, 2.0, 0.5))
    torch.testing.assert_close(half, clearance(30.0, 3.0, tool(8.0, 8.0, 2.0)))


def test_gradients_are_finite_and_agree_with_differences() -> None:
    where = (torch.tensor([[3.0, 11.0, 18.0]]).double(), torch.tensor([[1.0, -2.0, 4.0]]).double())
    numbers = torch.tensor([12.0, 5.0, 8.0, 6.0, 2.6, 0.9], dtype=torch.float64, requires_grad=True)

    def lowest(of: Tensor) -> Tensor:
        return clearance_mm(*where, of[0:1], of[1:2], Underside(of[2:3], of[3:4], of[4:5], of[5:6]))

    assert torch.autograd.gradcheck(lowest, (numbers,), eps=1e-6, atol=1e-5)
    still = torch.zeros(1, requires_grad=True)
    clearance_mm(X, Y, still, still * 0, tool(8.0, 8.0, 2.0)).sum().backward()
    assert torch.isfinite(still.grad).all()  # type: ignore[arg-type]
