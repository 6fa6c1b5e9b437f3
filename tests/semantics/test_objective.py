"""Text and semantic objectives, their adapter for the planner, and saliency."""

import numpy as np
import pytest
import torch

from pentimento.dynamics.strokes.photometry import srgb_to_linear
from pentimento.semantics.encoder import Encoder, EncoderShape, new_model
from pentimento.semantics.objective import SemanticObjective, TextObjective, TorchObjective
from pentimento.semantics.scores import saliency


@pytest.fixture
def light(images: torch.Tensor) -> torch.Tensor:
    """[32, 32, 3]."""
    return srgb_to_linear(images[0]).movedim(0, -1)


def test_text_objective_is_one_minus_the_cosine(encoder: Encoder, images: torch.Tensor, light: torch.Tensor) -> None:
    value = TextObjective(encoder, "a red house", 0, 0)(light)
    cosine = encoder.embed_images(images[:1]) @ encoder.embed_texts(["a red house"])[0]
    assert float(value) == pytest.approx(1 - float(cosine), abs=1e-4)


def test_semantic_objective_of_the_target_is_zero(encoder: Encoder, light: torch.Tensor) -> None:
    objective = SemanticObjective(encoder, light, 3, 0)
    assert float(objective(light)) == pytest.approx(0, abs=1e-8)
    assert float(objective(1 - light)) > 0.01


@pytest.mark.parametrize("views", [0, 4])
def test_objectives_decrease_along_their_gradient(encoder: Encoder, light: torch.Tensor, views: int) -> None:
    for make in (
        lambda: TextObjective(encoder, "a red house", views, 0),
        lambda: SemanticObjective(encoder, torch.ones_like(light) * 0.2, views, 0),
    ):
        image = light.clone().clamp(0.05, 0.95).requires_grad_()
        before = make()(image)
        (gradient,) = torch.autograd.grad(before, image)
        assert torch.isfinite(gradient).all() and gradient.abs().max() > 0
        after = make()((image - 0.02 * gradient / gradient.abs().max()).detach())  # the same views: the same seed
        assert float(after) < float(before.detach())


def test_random_views_differ_by_call_and_repeat_with_the_seed(encoder: Encoder, light: torch.Tensor) -> None:
    one, other = (TextObjective(encoder, "a house", 3, 5) for _ in range(2))
    first, second = float(one(light)), float(one(light))
    assert first != second and float(other(light)) == first


def test_saliency_is_a_map_from_0_to_1_of_each_caption(encoder: Encoder, images: torch.Tensor) -> None:
    maps = saliency(encoder, images[:3], ["a house", "a red cat", "a tree"])
    assert maps.shape == (3, 32, 32)
    assert torch.allclose(maps.amax((1, 2)), torch.ones(3)) and torch.allclose(maps.amin((1, 2)), torch.zeros(3))
    alone = saliency(encoder, images[1:2], ["a red cat"])
    assert torch.allclose(alone[0], maps[1], atol=1e-3)
    assert not torch.allclose(saliency(encoder, images[1:2], ["a blue cloud"])[0], maps[1], atol=1e-2)


def test_saliency_of_convolutions_moves_with_the_thing(encoder: Encoder) -> None:
    shape = EncoderShape(64, 4, 32, 0, 16, 1, 2, 16)
    convolutions = Encoder(new_model(shape, encoder.tokenizer, 0), encoder.tokenizer)
    images = torch.ones(2, 3, 64, 64)
    thing = torch.rand(3, 8, 8, generator=torch.Generator().manual_seed(0))
    images[0, :, 28:36, 20:28], images[1, :, 28:36, 36:44] = thing, thing
    one, other = saliency(convolutions, images, ["a house", "a house"])
    assert float(one.amax()) == 1.0 and float(one.amin()) == 0.0
    assert torch.allclose(one[20:44, 20:36], other[20:44, 36:52], atol=1e-4)
    assert not torch.allclose(one, other, atol=1e-2)


def test_torch_objective_returns_value_and_gradient() -> None:
    image = np.random.default_rng(0).random((5, 7, 3), np.float32)
    weights = torch.linspace(-1, 1, 3)
    value, gradient = TorchObjective(lambda picture: (picture.square() * weights).sum())(image)
    np.testing.assert_allclose(value, (image**2 * weights.numpy()).sum(), rtol=1e-5)
    np.testing.assert_allclose(gradient, 2 * image * weights.numpy(), rtol=1e-6)
    assert gradient.dtype == np.float32 and isinstance(value, float)


def test_torch_objective_computes_gradients_within_no_grad() -> None:
    image = np.full((2, 2, 3), 0.5, np.float32)
    with torch.no_grad():
        _, gradient = TorchObjective(lambda picture: picture.sum())(image)
    np.testing.assert_array_equal(gradient, np.ones_like(image))
    np.testing.assert_array_equal(image, np.full((2, 2, 3), 0.5, np.float32))
