"""Which part of a picture a caption speaks of: the gradient of their cosine through the encoder's attention.

Chefer, Gur and Wolf 2021 ("Generic attention-model explainability", eq. 5 and 6), which CLIPasso (Vinker et al. 2022)
places strokes by: attention counts where the score would rise with it, and is followed from layer to layer.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor
from torch.nn.functional import interpolate

from pentimento.semantics.encoder import Encoder


def saliency(encoder: Encoder, images: Tensor, captions: Sequence[str]) -> Tensor:
    """For sRGB images [B, 3, H, W] in [0, 1] and their captions: saliency [B, H, W] from 0 to 1.

    The most salient place of each image is 1, the least 0; a map without any difference is 0 everywhere.
    """
    with torch.enable_grad():
        # A gradient must reach the first layer's attention, though no weight asks for one.
        pixels = encoder.prepare(images.detach()).requires_grad_()
        out = encoder.model.get_image_features(pixel_values=pixels, output_attentions=True)
        seen = torch.nn.functional.normalize(out.pooler_output, dim=-1)
        score = (seen * encoder.embed_texts(captions)).sum()
        gradients = torch.autograd.grad(score, out.attentions)
    tokens = out.attentions[0].shape[-1]
    relevance = torch.eye(tokens).expand(len(images), -1, -1)
    for attention, gradient in zip(out.attentions, gradients, strict=True):
        useful = (attention.detach() * gradient).clamp(min=0).mean(1)  # over heads: [B, T, T]
        relevance = relevance + useful @ relevance
    side = encoder.image_px // encoder.patch_px
    patches = relevance[:, 0, 1:].reshape(-1, 1, side, side)
    maps = interpolate(patches, tuple(images.shape[-2:]), mode="bicubic", align_corners=False)[:, 0]
    low, high = maps.amin((1, 2), keepdim=True), maps.amax((1, 2), keepdim=True)
    return torch.where(high - low > 0, (maps - low) / (high - low).clamp(min=1e-20), 0.0)
