"""Scores of pictures by an encoder: CLIPScore (Hessel et al. 2021, raw), retrieval, recognised objects, and
saliency."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import interpolate

from pentimento.contracts.scenes import phrase
from pentimento.semantics.devices import in_batches
from pentimento.semantics.encoder import Encoder

_CHUNK: Final = 256  # images in one call of the encoder
_OTHERS: Final = 64  # captions that an image is mismatched with, at most


def clip_score(encoder: Encoder, images: Tensor, captions: Sequence[str]) -> Tensor:
    """The cosine [B] of each sRGB image [B, 3, H, W] in [0, 1] and its caption, neither scaled nor clipped."""
    return (embed_all(encoder, images) * encoder.embed_texts(captions)).sum(-1)


def mismatched_quantile(encoder: Encoder, images: Tensor, captions: Sequence[str], *, q: float, seed: int) -> float:
    """The quantile `q` of the scores of images with captions of other images.

    As a threshold it has the same meaning for any encoder: with q = .95, one wrong pair in 20 passes. Each image is
    paired with all captions of other wording, or with 64 of them drawn by `seed`.

    Raises:
        ValueError: all captions are the same.
    """
    images_, texts = embed_all(encoder, images), encoder.embed_texts(captions)
    generator = np.random.default_rng([seed, 4])
    scores = []
    for index, caption in enumerate(captions):
        others = np.array([i for i, other in enumerate(captions) if other != caption], dtype=int)
        if len(others) > _OTHERS:
            others = generator.choice(others, _OTHERS, replace=False)
        scores.append(texts[torch.from_numpy(others)] @ images_[index])
    together = torch.cat(scores)
    if len(together) == 0:
        raise ValueError("All captions are the same: there is no mismatched pair to take a quantile of.")
    return float(torch.quantile(together.double(), q))


def retrieval(encoder: Encoder, images: Tensor, captions: Sequence[str], *, among: int, seed: int) -> dict[str, float]:
    """The fraction of images whose caption scores best among `among` different ones, and of captions likewise.

    Images are assigned to groups by `seed`. An image whose caption is already in its group is left out, and so is the
    last, incomplete group. `chance` is 1 / among. NaN if there is no complete group.
    """
    order = np.random.default_rng([seed, 5]).permutation(len(captions)).tolist()
    groups: list[dict[str, int]] = [{}]
    for index in order:
        if len(groups[-1]) == among:
            groups.append({})
        groups[-1].setdefault(captions[index], index)
    full = [torch.tensor(list(group.values())) for group in groups if len(group) == among]
    seen, read = embed_all(encoder, images), encoder.embed_texts(captions)
    hits = [(seen[group] @ read[group].T) for group in full]
    right = torch.arange(among)

    def share(dim: int) -> float:
        return float(torch.cat([(scores.argmax(dim) == right) for scores in hits]).double().mean()) if hits else np.nan

    return {"image_to_text": share(1), "text_to_image": share(0), "chance": 1 / among}


def object_scores(encoder: Encoder, images: Tensor, kinds: Sequence[str]) -> Tensor:
    """Similarity [B, K] of images and kinds of objects: cosines with captions that name one kind."""
    return embed_all(encoder, images) @ encoder.embed_texts([phrase(kind) for kind in kinds]).T


def recognised(scores: Tensor, kinds: Sequence[str], asked: Sequence[Sequence[str]]) -> list[list[bool]]:
    """For each image and each of the k kinds asked for, whether it is among the k kinds with the highest scores.

    Args:
        scores: [B, K] of `object_scores`.
    """
    place = {kind: number for number, kind in enumerate(kinds)}
    answers = []
    for row, wanted in zip(scores, asked, strict=True):
        best = set(row.topk(len(set(wanted))).indices.tolist()) if wanted else set()
        answers.append([place[kind] in best for kind in wanted])
    return answers


def embed_all(encoder: Encoder, images: Tensor) -> Tensor:
    """Unit vectors [B, D] of images [B, 3, H, W], in chunks; without gradient."""
    with torch.no_grad():
        return torch.cat(in_batches(lambda part: encoder.embed_images(images[part]), len(images), _CHUNK))


def saliency(encoder: Encoder, images: Tensor, captions: Sequence[str]) -> Tensor:
    """Saliency [B, H, W] in [0, 1] of sRGB images [B, 3, H, W] in [0, 1] with respect to their captions.

    It follows the gradient of their cosine. With attention layers, the method of Chefer, Gur and Wolf 2021 ("Generic
    attention-model explainability", eq. 5 and 6), as in CLIPasso (Vinker et al. 2022); with convolutions only, Grad-CAM
    (Selvaraju et al. 2017). The maximum of each map is 1 and its minimum 0; a constant map is 0.
    """
    layers = encoder.model.config.vision_config.num_hidden_layers
    patches = (_by_attention if layers else _by_channels)(encoder, images, captions)
    side = encoder.image_px // encoder.patch_px
    shape = (-1, 1, side, side)
    maps = interpolate(patches.reshape(shape), tuple(images.shape[-2:]), mode="bicubic", align_corners=False)[:, 0]
    low, high = maps.amin((1, 2), keepdim=True), maps.amax((1, 2), keepdim=True)
    return torch.where(high - low > 0, (maps - low) / (high - low).clamp(min=1e-20), 0.0)


def _by_attention(encoder: Encoder, images: Tensor, captions: Sequence[str]) -> Tensor:
    """Relevance [B, L] of patches to the class token."""
    with torch.enable_grad():
        # A gradient must reach the first layer's attention, though no weight asks for one.
        pixels = encoder.prepare(images.detach()).requires_grad_()
        out = encoder.model.get_image_features(pixel_values=pixels, output_attentions=True)
        seen = torch.nn.functional.normalize(out.pooler_output, dim=-1)
        score = (seen * encoder.embed_texts(captions).to(seen.device)).sum()
        gradients = torch.autograd.grad(score, out.attentions)
    tokens = out.attentions[0].shape[-1]
    relevance = torch.eye(tokens, device=seen.device).expand(len(images), -1, -1)
    for attention, gradient in zip(out.attentions, gradients, strict=True):
        useful = (attention.detach() * gradient).clamp(min=0).mean(1)  # over heads: [B, T, T]
        relevance = relevance + useful @ relevance
    return relevance[:, 0, 1:].to(images.device)


def _by_channels(encoder: Encoder, images: Tensor, captions: Sequence[str]) -> Tensor:
    """Grad-CAM [B, L] of the stem, for an encoder without attention layers."""
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
    relevance = (gradient.sum((2, 3), keepdim=True) * held[0].detach()).sum(1).clamp(min=0).flatten(1)
    return relevance.to(images.device)
