"""How a vision transformer starts: each attention head looks at one neighbour, as a convolution does.

In as few steps as are taken here, a vision transformer that must first find out which patches are neighbours learns
little else. So places are written into the first channels as waves whose products tell places apart exactly, and
queries are keys turned by one patch (after Zheng et al. 2024, "Structured initialization for attention in vision
transformers"). All of it is only a start: every weight is trained.
"""

from __future__ import annotations

import math
from typing import Any, Final

import torch
from torch import Tensor

_NEIGHBOURS: Final = ((-1, 0), (0, -1), (0, 1), (1, 0), (-1, -1), (-1, 1), (1, -1), (1, 1))
"""Steps (down, right) to the neighbours, the four nearest first; head h looks at the one of number h, modulo 8."""
_SHARPNESS: Final = 8.0
"""What a row or a column that fits adds to the logit of attention."""


def start_local(vision: Any, white: Tensor, generator: torch.Generator) -> None:
    """Set the weights of a CLIP model's ``vision_model`` in place.

    Patches are projected at random into the channels that hold no places, and white paper to nothing: what stands out
    of a page is what is on it. The class token starts with the mean of all patches.

    Args:
        vision: the ``vision_model``; attention heads must have at least 4 channels.
        white: [3], white in the units that the model is given.
    """
    config = vision.config
    side, width, heads = config.image_size // config.patch_size, config.hidden_size, config.num_attention_heads
    channels = width // heads
    frequencies = _frequencies(side, channels // 4)
    places = _places(side, frequencies)
    used = places.shape[1]

    def random(rows: int, columns: int) -> Tensor:
        return torch.randn(rows, columns, generator=generator) / columns**0.5

    with torch.no_grad():
        embeddings = vision.embeddings
        kernels = embeddings.patch_embedding.weight
        kernels.zero_()
        kernels[used:] = random(width - used, kernels[0].numel()).view(-1, *kernels.shape[1:])
        embeddings.class_embedding.zero_()
        embeddings.position_embedding.weight.zero_()
        embeddings.position_embedding.weight[1:, :used] = places
        embeddings.position_embedding.weight[1:] -= (kernels.sum((2, 3)) @ white)[None]
        for layer in vision.encoder.layers:
            attention = layer.self_attn
            for linear in (attention.q_proj, attention.k_proj, attention.v_proj, attention.out_proj):
                linear.weight.zero_()
                linear.bias.zero_()
            for head in range(heads):
                first = head * channels
                turned = _turn(_NEIGHBOURS[head % len(_NEIGHBOURS)], frequencies)
                # Attention divides by the root of its channels; a place that fits gives len(frequencies) an axis.
                attention.q_proj.weight[first : first + used, :used] = (
                    turned * _SHARPNESS * channels**0.5 / len(frequencies)
                )
                attention.k_proj.weight[first : first + used, :used] = torch.eye(used)
            attention.v_proj.weight[:, used:] = random(width, width - used)
            attention.out_proj.weight[used:] = random(width - used, width)
            layer.mlp.fc2.weight[:used] = 0  # places stay as they are through all layers


def _frequencies(side: int, most: int) -> Tensor:
    """[F]: odd multiples of π / side. With side / 2 of them, waves of two different places are orthogonal."""
    return (2 * torch.arange(min(most, (side + 1) // 2)) + 1) * math.pi / side


def _places(side: int, frequencies: Tensor) -> Tensor:
    """[side², 4 F]: cosines and sines of the column, then of the row, of patches by rows from the top left."""
    angles = torch.arange(side)[:, None] * frequencies
    waves = torch.cat([angles.cos(), angles.sin()], 1)
    columns, rows = waves[None].expand(side, -1, -1), waves[:, None].expand(-1, side, -1)
    return torch.cat([columns, rows], 2).reshape(side * side, -1)


def _turn(step: tuple[int, int], frequencies: Tensor) -> Tensor:
    """[4 F, 4 F]: the matrix that takes a place's waves to those of the place one ``step`` (down, right) away."""
    down, right = step
    turned = torch.zeros(4 * len(frequencies), 4 * len(frequencies))
    for axis, steps in enumerate((right, down)):
        cos, sin = torch.diag((steps * frequencies).cos()), torch.diag((steps * frequencies).sin())
        own = slice(2 * axis * len(frequencies), 2 * (axis + 1) * len(frequencies))
        turned[own, own] = torch.cat([torch.cat([cos, -sin], 1), torch.cat([sin, cos], 1)])
    return turned
