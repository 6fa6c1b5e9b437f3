"""The print objective (thesis 4.3): the painting should look like the target, seen from near and from farther off."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor

from pentimento.contracts.errors import ConfigError
from pentimento.render.likeness import seen, squared_error, srgb_of


class PrintObjective:
    """Mean squared difference in sRGB between an image and a target, averaged over viewing distances.

    From farther off, the eye averages light over squares before it compares: 1 px is the thesis's (4.3), larger squares
    see tone where a pixel sees only a black line on white.
    """

    def __init__(self, target: Tensor, distances_px: tuple[int, ...]) -> None:
        """Hold what there is to see of ``target``, [H, W, 3] in linear light.

        Raises:
            ConfigError: the picture is smaller than a distance's square.
        """
        height, width = target.shape[:2]
        if max(distances_px) > min(height, width):
            raise ConfigError(
                f"A viewing distance of {max(distances_px)} px is larger than the picture of {height} x {width} px: "
                "lower the planner's distances_px or raise its pixels_per_m."
            )
        light = target.detach().contiguous().numpy()
        self._seen = [(distance, srgb_of(seen(light, distance))) for distance in distances_px]

    def __call__(self, image: Tensor) -> Tensor:
        """The objective for an image [H, W, 3] in linear light; a scalar, differentiable once."""
        value: Tensor = _Likeness.apply(image, self._seen)  # type: ignore[no-untyped-call]
        return value


class _Likeness(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, image: Tensor, targets: list[tuple[int, Any]]) -> Tensor:
        light = image.detach().contiguous().numpy()
        gradient = np.zeros_like(light)
        share = 1 / len(targets)
        value = sum(
            share * squared_error(light, target.astype(light.dtype, copy=False), distance, gradient, share)
            for distance, target in targets
        )
        ctx.gradient = torch.from_numpy(gradient)
        return torch.tensor(value, dtype=image.dtype)

    @staticmethod
    def backward(ctx: Any, *of_value: Tensor) -> tuple[Tensor, None]:
        return of_value[0] * ctx.gradient, None
