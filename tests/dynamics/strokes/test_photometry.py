"""SRGB and linear light in PyTorch."""

import numpy as np
import torch

from pentimento.contracts import colour
from pentimento.dynamics.strokes.photometry import linear_to_srgb, srgb_to_linear

LIGHT = torch.cat([torch.zeros(1), torch.linspace(1e-5, 0.01, 40), torch.linspace(0.01, 1.0, 60)]).double()


def test_it_agrees_with_numpy_and_inverts() -> None:
    np.testing.assert_allclose(linear_to_srgb(LIGHT).numpy(), colour.linear_to_srgb(LIGHT.numpy()), atol=1e-6)
    torch.testing.assert_close(srgb_to_linear(linear_to_srgb(LIGHT)), LIGHT, atol=1e-6, rtol=1e-6)


def test_its_gradient_is_that_of_finite_differences_and_finite_at_black() -> None:
    apart = LIGHT[(LIGHT - 0.0031308).abs() > 1e-4].requires_grad_(True)  # away from the kink
    assert torch.autograd.gradcheck(linear_to_srgb, (apart,), eps=1e-7, atol=1e-5)
    black = torch.zeros(2, requires_grad=True)
    (slope,) = torch.autograd.grad(linear_to_srgb(black).sum(), black)
    torch.testing.assert_close(slope, torch.full((2,), 12.92))
