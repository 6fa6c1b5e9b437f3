"""Semantic objectives of a plan's picture: the text objective (thesis 4.1) and the semantic objective (thesis 4.4).

Both map an image [H, W, 3] in linear light to a scalar that planners minimise through `TorchObjective`. The picture is
seen in several random views (`bundle.views`), as in CLIPDraw (Frans et al. 2021) and CLIPasso (Vinker et al.
2022). Otherwise a planner finds pictures that only the encoder recognises, in one exact position.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.functional import affine_grid, grid_sample, mse_loss

from pentimento.bundle.views import random_views
from pentimento.dynamics.strokes.photometry import linear_to_srgb

if TYPE_CHECKING:
    from pentimento.semantics.encoder import Encoder  # imports transformers, which takes seconds

Array = NDArray[np.float32]


class TorchObjective:
    """A `planning.objectives.Objective` from a PyTorch function of an image [H, W, 3] in linear light to a scalar."""

    def __init__(self, function: Callable[[Tensor], Tensor]) -> None:
        self._function = function

    def __call__(self, image: Array) -> tuple[float, Array]:
        """The value for an image [H, W, 3] in linear light, and its gradient [H, W, 3]."""
        leaf = torch.tensor(image, requires_grad=True)
        with torch.enable_grad():
            value = self._function(leaf)
            (gradient,) = torch.autograd.grad(value, leaf)
        return float(value.detach()), gradient.numpy()


class TextObjective:
    """The text objective for a caption, with new random views at each call."""

    def __init__(self, encoder: Encoder, caption: str, views: int, seed: int) -> None:
        self._encoder = encoder
        self._text = encoder.embed_texts([caption])[0].detach()
        self._views = _RandomViews(views, seed)

    def __call__(self, image: Tensor) -> Tensor:
        """The objective for an image [H, W, 3] in linear light; a scalar in [0, 2], differentiable."""
        return text_loss(self._encoder, image, self._text, self._views())


class SemanticObjective:
    """The semantic objective for a target [H, W, 3] in linear light, with new random views at each call."""

    def __init__(self, encoder: Encoder, target: Tensor, views: int, seed: int) -> None:
        self._encoder = encoder
        self._target = target.detach()
        self._views = _RandomViews(views, seed)

    def __call__(self, image: Tensor) -> Tensor:
        """The objective for an image [H, W, 3] in linear light; a scalar of at least 0, differentiable."""
        return semantic_loss(self._encoder, image, self._target, self._views())


@dataclass(frozen=True, eq=False)
class EncoderMeaning:
    """What an encoder sees, a `planning.strokes.scene.Meaning`."""

    encoder: Encoder
    views: int
    """Random views of a picture, beside the plain one."""
    seed: int

    def text(self, words: str, _shape: tuple[int, int]) -> TorchObjective:
        """The text objective for these words, for images of any size."""
        return TorchObjective(TextObjective(self.encoder, words, self.views, self.seed))

    def semantic(self, target: Array) -> TorchObjective:
        """The semantic objective for a target [H, W, 3] in linear light."""
        return TorchObjective(SemanticObjective(self.encoder, torch.from_numpy(target), self.views, self.seed))


def text_loss(encoder: Encoder, image: Tensor, text: Tensor, views: Tensor) -> Tensor:
    """1 - cos of an image [H, W, 3] in linear light and a text vector [D], averaged over the plain view and `views`.

    Equation (4.1) with its sign corrected; `views` are affine matrices [V, 2, 3] in normalised coordinates.
    """
    return 1 - (encoder.embed_images(with_views(_as_srgb_batch(image), views)) @ text).mean()


def semantic_loss(encoder: Encoder, image: Tensor, target: Tensor, views: Tensor) -> Tensor:
    """Mean squared difference of patch features of an image and a target, [H, W, 3] in linear light; equation (4.4).

    The features are those of a middle layer. Image and target are seen in the same `views`, affine matrices [V, 2, 3].
    """
    pair = with_views(torch.cat([_as_srgb_batch(image), _as_srgb_batch(target)]), views)
    features = encoder.patch_features(pair)
    half = 1 + len(views)
    return mse_loss(features[:half], features[half:].detach())


def with_views(images: Tensor, views: Tensor) -> Tensor:
    """[B, 3, H, W] to [B · (1 + V), 3, H, W]: each picture plain and in each of V views, picture by picture."""
    batch, count = len(images), len(views)
    if count == 0:
        return images
    repeated = images.repeat_interleave(count, 0)
    grid = affine_grid(views.repeat(batch, 1, 1), list(repeated.shape), align_corners=False).to(images.dtype)
    moved = grid_sample(repeated, grid, mode="bilinear", padding_mode="border", align_corners=False)
    return torch.cat([images[:, None], moved.reshape(batch, count, *images.shape[1:])], 1).flatten(0, 1)


class _RandomViews:
    """Random affine matrices [V, 2, 3], new at each call; those of a bundle's objectives with the same seed."""

    def __init__(self, count: int, seed: int) -> None:
        self._count, self._rng = count, np.random.default_rng(seed)

    def __call__(self) -> Tensor:
        return torch.from_numpy(random_views(self._count, self._rng))


def _as_srgb_batch(image: Tensor) -> Tensor:
    """Linear light [H, W, 3] to sRGB [1, 3, H, W]."""
    return linear_to_srgb(image.clamp(0.0, 1.0)).movedim(-1, 0)[None]
