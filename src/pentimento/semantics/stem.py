"""A CLIP model whose vision transformer sees through a few convolutions in place of one linear map of each patch.

A transformer that must first find out which patches are neighbours learns little from a few thousand pictures. Xiao et
al. 2021 ("Early convolutions help transformers see better") put 3 x 3 convolutions of stride 2 before it: as many
tokens as with patches, made of what stands next to each other.
"""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor, nn
from transformers import CLIPConfig, CLIPModel


class ConvolutionalCLIP(CLIPModel):
    """``CLIPModel`` with a convolutional stem; all else is the published layout.

    Its config says ``convolutional_stem`` under ``vision_config``; see ``has_stem``.
    """

    def __init__(self, config: CLIPConfig) -> None:
        """Untrained, for a config whose patch_size is a power of 2."""
        super().__init__(config)
        self.vision_model.embeddings = StemEmbeddings(config.vision_config)


def has_stem(config: dict[str, Any]) -> bool:
    """Whether what a config.json holds is of a ``ConvolutionalCLIP``."""
    return bool((config.get("vision_config") or {}).get("convolutional_stem", False))


class StemEmbeddings(nn.Module):
    """Tokens of normalised pictures, [B, 3, H, W] to [B, 1 + L, C]: the class token first, then places by rows.

    The class token starts with the strongest response of each channel over all places: what is in a picture, wherever.
    """

    def __init__(self, config: Any) -> None:
        """For a CLIPVisionConfig."""
        super().__init__()
        width, side = config.hidden_size, config.image_size // config.patch_size
        halvings = config.patch_size.bit_length() - 1
        widths = [max(8, width * 3 // 2 ** (halvings + 1 - step)) for step in range(halvings)]  # of 128: 24, 48, 96
        self.stem = nn.Sequential(
            *(_convolution(a, b, 2) for a, b in zip([3, *widths], widths, strict=False)),
            _convolution([3, *widths][-1], width, 1),
        )
        self.class_embedding = nn.Parameter(torch.zeros(width))
        self.position_embedding = nn.Parameter(0.02 * torch.randn(1 + side * side, width))

    def forward(self, pixel_values: Tensor, interpolate_pos_encoding: bool = False) -> Tensor:
        """The tokens; pictures must have the model's size.

        Raises:
            ValueError: another size was asked for.
        """
        if interpolate_pos_encoding:
            raise ValueError("Positions of a convolutional stem are not interpolated; resize the picture.")
        places = self.stem(pixel_values.contiguous(memory_format=torch.channels_last)).flatten(2).transpose(1, 2)
        strongest = self.class_embedding + places.amax(1, keepdim=True)
        tokens: Tensor = torch.cat([strongest, places], 1) + self.position_embedding
        return tokens


def _convolution(wide_in: int, wide_out: int, stride: int) -> nn.Sequential:
    return nn.Sequential(nn.Conv2d(wide_in, wide_out, 3, stride, 1, bias=False), nn.BatchNorm2d(wide_out), nn.ReLU())
