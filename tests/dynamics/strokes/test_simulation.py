"""The five sites at which a mechanism can act, each by an effect whose outcome is known."""

from copy import deepcopy

import numpy as np
import pytest
import torch
from torch import Tensor

from pentimento.dynamics.strokes.autograd import render_strokes
from pentimento.dynamics.strokes.simulation import Mechanism, StrokeContext, View, simulate
from pentimento.dynamics.strokes.traj2stroke import Mark, Traj2Stroke, Traj2StrokeParameters
from pentimento.render import PixelStrokes

MODEL = Traj2Stroke(Traj2StrokeParameters((1.0, 1.0), (0.0, 0.0), 0.5, 1e-3, 1.0, 0.9)).requires_grad_(False)
VIEW = View(torch.tensor([[0.0, 0.04]] * 2), torch.tensor([1000.0, 1000.0]))
WHITE = torch.ones(2, 40, 60, 3)


def context(wet_age_s: float = 0.0) -> StrokeContext:
    rng = np.random.default_rng(0)
    path = np.zeros((2, 3, 6, 5))
    path[..., 1] = np.linspace(0.010, 0.045, 6)
    path[..., 2] = rng.uniform(0.01, 0.03, (2, 3, 1))
    path[..., 3] = -0.002
    return StrokeContext(torch.tensor(path, dtype=torch.float32), {"wet_age_s": torch.full((2, 3), wet_age_s)})


def image(mechanisms: list[Mechanism], canvas: Tensor = WHITE, wet_age_s: float = 0.0) -> Tensor:
    return simulate(MODEL, mechanisms, context(wet_age_s), color=torch.zeros(2, 3, 3), canvas=canvas, view=VIEW)


class OneNumber(Mechanism):
    def __init__(self, value: float) -> None:
        super().__init__(torch.tensor([value], requires_grad=True), {})

    @property
    def value(self) -> Tensor:
        return self.values[0]


class Nothing(OneNumber):
    site = "camera"


class Shift(OneNumber):
    site = "trajectory"

    def mark(self, mark: Mark, context: StrokeContext) -> Mark:
        return mark._replace(points_m=mark.points_m + self.value * torch.tensor([0.0, 1.0]))


class Widen(OneNumber):
    site = "width"

    def mark(self, mark: Mark, context: StrokeContext) -> Mark:
        return mark._replace(radius_m=mark.radius_m * (1 + self.value))


class Fade(OneNumber):
    site = "density"

    def mark(self, mark: Mark, context: StrokeContext) -> Mark:
        return mark._replace(density=mark.density * (1 - self.value))


class PickUp(OneNumber):
    site = "composite"

    def composite(self, color: Tensor, pickup: Tensor | None, context: StrokeContext) -> tuple[Tensor, Tensor | None]:
        return color, self.value * torch.exp(-context.covariates["wet_age_s"] / 10)


class Dim(OneNumber):
    site = "camera"

    def camera(self, image: Tensor, view: View) -> Tensor:
        return image * (1 - self.value)


def test_without_mechanisms_it_is_the_model_through_the_renderer() -> None:
    mark = MODEL(context().path)
    points, black = VIEW.to_pixels(mark.points_m), torch.zeros(2, 3, 3)
    plain = render_strokes(PixelStrokes(points, mark.radius_m * 1000, mark.density, mark.softness, black), WHITE)
    torch.testing.assert_close(image([]), plain)
    torch.testing.assert_close(image([Nothing(0.0)]), plain)


def test_a_shifted_trajectory_shifts_the_ink() -> None:
    torch.testing.assert_close(image([Shift(0.002)])[:, :-2], image([])[:, 2:], atol=1e-4, rtol=0)


def test_width_inks_more_and_density_darkens_less() -> None:
    plain, wide, pale = image([]), image([Widen(0.3)]).detach(), image([Fade(0.5)]).detach()
    assert (wide < 0.9).sum() > 1.2 * (plain < 0.9).sum()
    assert float(pale.amin()) > float(plain.amin()) + 0.1
    torch.testing.assert_close(image([Fade(0.5), Fade(0.5)]), image([Fade(0.75)]))


def test_pickup_depends_on_a_covariate() -> None:
    wet_red = torch.cat([torch.tensor([1.0, 0.0, 0.0]).expand(2, 40, 60, 3), torch.ones(2, 40, 60, 1)], dim=-1)
    fresh, old = image([PickUp(0.6)], wet_red, 0.0).detach(), image([PickUp(0.6)], wet_red, 200.0).detach()
    torch.testing.assert_close(old, image([], wet_red[..., :3].contiguous()), atol=1e-4, rtol=0)
    assert float((fresh - old)[..., 0].max()) > 0.2


def test_the_camera_acts_on_the_image() -> None:
    torch.testing.assert_close(image([Dim(0.25)]), 0.75 * image([]))


@pytest.mark.parametrize("kind", [Shift, Widen, Fade, Dim])
def test_gradients_reach_the_parameters(kind: type[OneNumber]) -> None:
    weight = torch.randn(2, 40, 60, 3, generator=torch.Generator().manual_seed(0)).double()
    step, at = (1e-7, 1e-4) if kind is Shift else (1e-4, 0.1)

    def loss(mechanism: Mechanism) -> Tensor:
        exact = context()._replace(path=context().path.double())
        color, view = torch.zeros(2, 3, 3).double(), View(*(values.double() for values in VIEW))
        image = simulate(deepcopy(MODEL).double(), [mechanism], exact, color=color, canvas=WHITE.double(), view=view)
        return (image * weight).sum()

    mechanism = kind(at)
    (gradient,) = torch.autograd.grad(loss(mechanism), [mechanism.values])
    with torch.no_grad():
        up, down = (loss(kind(at + s)) for s in (step, -step))
    assert float(gradient) == pytest.approx(float((up - down) / (2 * step)), rel=0.03)
