"""The compiled reconstruction loss against PyTorch's pooling, powers and gradients."""

import numpy as np
import pytest
import torch
from torch.nn.functional import avg_pool2d

from pentimento.dynamics.strokes.photometry import linear_to_srgb
from pentimento.render.errors import RenderInputError
from pentimento.render.reconstruction_loss import seen, squared_error, srgb_of


def pictures(dtype: type, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return tuple((rng.uniform(0, 1, (37, 53, 3)) ** 3).astype(dtype) for _ in range(2))


def pooled(image: torch.Tensor, distance: int) -> torch.Tensor:
    if distance == 1:
        return image
    return avg_pool2d(image.movedim(-1, 0), distance, max(distance // 2, 1)).movedim(0, -1)


@pytest.mark.parametrize("distance", [1, 2, 3, 4, 10, 37])
@pytest.mark.parametrize(("dtype", "bound"), [(np.float32, 2e-5), (np.float64, 1e-10)])
def test_squared_error_agrees_with_torch(distance: int, dtype: type, bound: float) -> None:
    image, target = pictures(dtype)
    image[0, 0], image[5, 5] = 0.0, 0.001  # below the knee of sRGB's curve
    wanted = torch.tensor(image.astype(np.float64), requires_grad=True)
    difference = linear_to_srgb(pooled(wanted, distance)) - linear_to_srgb(
        pooled(torch.tensor(target).double(), distance)
    )
    value = difference.square().mean()
    (slope,) = torch.autograd.grad(value, wanted)
    gradient = np.zeros_like(image)
    ours = squared_error(image, srgb_of(seen(target, distance)), distance, gradient, 1.0)
    assert ours == pytest.approx(float(value.detach()), rel=bound)
    assert np.linalg.norm(gradient - slope.numpy()) <= bound * np.linalg.norm(slope.numpy())


def test_squared_error_adds_weighted_gradients() -> None:
    image, target = pictures(np.float64)
    once, both = np.zeros_like(image), np.zeros_like(image)
    squared_error(image, srgb_of(seen(target, 4)), 4, once, 1.0)
    for weight in (0.25, 0.5):
        squared_error(image, srgb_of(seen(target, 4)), 4, both, weight)
    np.testing.assert_allclose(both, 0.75 * once)


@pytest.mark.parametrize("distance", [1, 4])
def test_squared_error_rejects_other_sizes(distance: int) -> None:
    image, target = pictures(np.float32)
    with pytest.raises(RenderInputError, match="give both the same size"):
        squared_error(image, srgb_of(seen(target[:-9], distance)), distance, np.zeros_like(image), 1.0)


def test_squared_error_of_equal_images_is_zero() -> None:
    image, _ = pictures(np.float32)
    gradient = np.zeros_like(image)
    assert squared_error(image, srgb_of(seen(image, 4)), 4, gradient, 1.0) < 1e-12
    assert np.abs(gradient).max() < 1e-8


def test_squared_error_is_independent_of_memory_layout() -> None:
    """A loop that is compiled twice, for arrays side by side and for others, rounds in two ways; plans then differ."""
    rng = np.random.default_rng(1)
    image, target = (rng.uniform(0, 1, (90, 120, 3)).astype(np.float32) for _ in range(2))
    wanted, found = srgb_of(target), set()
    held: list[np.ndarray] = []
    for _ in range(150):
        held = held[len(held) // 3 :] + [np.empty(int(10 ** rng.uniform(1.5, 5.5)), np.uint8) for _ in range(4)]
        gradient = np.zeros_like(image)
        value = squared_error(image.copy(), wanted.copy(), 1, gradient, 1.0)
        found.add((value, gradient.tobytes()))
    assert len(found) == 1
