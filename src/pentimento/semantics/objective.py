"""x"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.functional import affine_grid, grid_sample, mse_loss

from pentimento.dynamics.strokes.photometry import linear_to_srgb
from pentimento.semantics.encoder import Encoder


class TextObjective:
    """1 - cos of the picture and a caption, averaged over views; (4.1) with its sign corrected."""

    def __init__(self, encoder: Encoder, caption: str, views: int, seed: int) -> None:
        """Hold the caption's vector; ``views`` beside the plain one, anew at each call, seeded."""
        self._encoder = encoder
        self._text = encoder.embed_texts([caption])[0].detach()
        self._views = _Views(views, seed)

    def __call__(self, image: Tensor) -> Tensor:
        """The objective for an image [H, W, 3] in linear light; a scalar in [0, 2], differentiable."""
        seen = self._encoder.embed_images(self._views(_as_batch(image)))
        return 1 - (seen @ self._text).mean()


class SemanticObjective:
    """Mean squared difference of a middle layer's patch features of the picture and of a target; (4.4).

    Both are moved alike, so that a view compares the same places.
    """

    def __init__(self, encoder: Encoder, target: Tensor, views: int, seed: int) -> None:
        """Hold the target, [H, W, 3] in linear light; ``views`` beside the plain one, anew at each call, seeded."""
        self._encoder = encoder
        self._target = _as_batch(target.detach())
        self._views = _Views(views, seed)

    def __call__(self, image: Tensor) -> Tensor:
        """The objective for an image [H, W, 3] in linear light; a scalar from 0 on, differentiable."""
        pair = self._views(torch.cat([_as_batch(image), self._target]))
        features = self._encoder.patch_features(pair)
        half = len(features) // 2
        return mse_loss(features[:half], features[half:].detach())


class _Views:
    """A batch of pictures, and so many times again: the same small turn, scale and shift for all in the batch."""

    def __init__(self, views: int, seed: int) -> None:
        self._count = views
        self._generator = torch.Generator().manual_seed(seed)

    def __call__(self, images: Tensor) -> Tensor:
        """[B, 3, H, W] in [0, 1] to [B · (1 + views), 3, H, W], picture by picture."""
        batch, count = len(images), self._count
        if count == 0:
            return images
        turn, scale, x, y = torch.rand(4, count, generator=self._generator) * 2 - 1
        turn, scale = 0.12 * turn, 1 + 0.1 * scale
        cos, sin = scale * turn.cos(), scale * turn.sin()
        rows = [torch.stack([cos, -sin, 0.1 * x], 1), torch.stack([sin, cos, 0.1 * y], 1)]
        matrices = torch.stack(rows, 1).repeat(batch, 1, 1)
        repeated = images.repeat_interleave(count, 0)
        grid = affine_grid(matrices, list(repeated.shape), align_corners=False).to(images.dtype)
        moved = grid_sample(repeated, grid, mode="bilinear", padding_mode="border", align_corners=False)
        together = torch.cat([images[:, None], moved.reshape(batch, count, *images.shape[1:])], 1)
        return together.flatten(0, 1)


def _as_batch(image: Tensor) -> Tensor:
    """Linear light [H, W, 3] to sRGB [1, 3, H, W]."""
    return linear_to_srgb(image.clamp(0, 1)).movedim(-1, 0)[None]


Array = NDArray[np.float32]


class TorchObjective:
    """A ``planning.model.Objective`` from a function of an image [H, W, 3] in linear light to a scalar."""

    def __init__(self, function: Callable[[Tensor], Tensor]) -> None:
        self._function = function

    def __call__(self, image: Array) -> tuple[float, Array]:
        """The value for an image [H, W, 3] in linear light, and its gradient [H, W, 3]."""
        leaf = torch.tensor(image, requires_grad=True)
        with torch.enable_grad():
            value = self._function(leaf)
            (gradient,) = torch.autograd.grad(value, leaf)
        return float(value.detach()), gradient.numpy()
