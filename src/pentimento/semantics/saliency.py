"""Which part of a picture a caption speaks of: the gradient of their cosine, followed back to places.

Through attention, Chefer, Gur and Wolf 2021 ("Generic attention-model explainability", eq. 5 and 6), which CLIPasso
(Vinker et al. 2022) places strokes by: attention counts where the score would rise with it, and is followed from layer
to layer. Through convolutions only, Grad-CAM (Selvaraju et al. 2017): channels count as far as the score would rise
with them, and places by what they hold of these.
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
    layers = encoder.model.config.vision_config.num_hidden_layers
    patches = (_by_attention if layers else _by_channels)(encoder, images, captions)
    side = encoder.image_px // encoder.patch_px
    shape = (-1, 1, side, side)
    maps = interpolate(patches.reshape(shape), tuple(images.shape[-2:]), mode="bicubic", align_corners=False)[:, 0]
    low, high = maps.amin((1, 2), keepdim=True), maps.amax((1, 2), keepdim=True)
    return torch.where(high - low > 0, (maps - low) / (high - low).clamp(min=1e-20), 0.0)


def _by_attention(encoder: Encoder, images: Tensor, captions: Sequence[str]) -> Tensor:
    """Relevance of patches [B, L] to the class token."""
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
    return relevance[:, 0, 1:]


def _by_channels(encoder: Encoder, images: Tensor, captions: Sequence[str]) -> Tensor:
    """What places [B, L] hold of the channels that the score rises with; for a stem without layers after it."""
    held: list[Tensor] = []
    stem = encoder.model.vision_model.embeddings.stem
    hook = stem.register_forward_hook(lambda _module, _inputs, places: held.append(places))
    try:
        with torch.enable_grad():
            seen = encoder.embed_images(images.detach().requires_grad_())
            score = (seen * encoder.embed_texts(captions)).sum()
            (gradient,) = torch.autograd.grad(score, held[0])
    finally:
        hook.remove()
    return (gradient.sum((2, 3), keepdim=True) * held[0].detach()).sum(1).clamp(min=0).flatten(1)
