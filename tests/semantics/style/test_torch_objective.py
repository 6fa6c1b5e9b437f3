"""What PyTorch differentiates is what the planner gets."""

import numpy as np
import torch

from pentimento.semantics.style.torch_objective import TorchObjective


def test_value_and_gradient_are_those_of_the_function() -> None:
    image = np.random.default_rng(0).random((5, 7, 3), np.float32)
    weights = torch.linspace(-1, 1, 3)
    value, gradient = TorchObjective(lambda picture: (picture.square() * weights).sum())(image)
    np.testing.assert_allclose(value, (image**2 * weights.numpy()).sum(), rtol=1e-5)
    np.testing.assert_allclose(gradient, 2 * image * weights.numpy(), rtol=1e-6)
    assert gradient.dtype == np.float32 and isinstance(value, float)


def test_gradients_come_where_they_are_switched_off_and_the_image_stays() -> None:
    image = np.full((2, 2, 3), 0.5, np.float32)
    with torch.no_grad():
        _, gradient = TorchObjective(lambda picture: picture.sum())(image)
    np.testing.assert_array_equal(gradient, np.ones_like(image))
    np.testing.assert_array_equal(image, np.full((2, 2, 3), 0.5, np.float32))
