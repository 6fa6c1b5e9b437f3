"""x"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import interpolate

from pentimento.semantics.encoder import Encoder
from pentimento.semantics.examples import prompt

_AT_ONCE = 256


def clip_score(encoder: Encoder, images: Tensor, captions: Sequence[str]) -> Tensor:
    """The cosine [B] of each sRGB image [B, 3, H, W] in [0, 1] with its caption; neither scaled nor cut at 0."""
    return (embed_all(encoder, images) * encoder.embed_texts(captions)).sum(-1)


def mismatched_quantile(encoder: Encoder, images: Tensor, captions: Sequence[str], q: float, seed: int) -> float:
    """The quantile ``q`` of the scores of images with captions that are not theirs.

    A threshold that means something for any encoder: with q = .95, one wrong pair in 20 passes. Each image meets the
    captions of all others of other wording, or of 64 drawn by ``seed`` where there are more.

    Raises:
        ValueError: all captions are the same.
    """
    seen, read = embed_all(encoder, images), encoder.embed_texts(captions)
    generator = np.random.default_rng([seed, 4])
    scores = []
    for index, caption in enumerate(captions):
        others = np.array([i for i, other in enumerate(captions) if other != caption], dtype=int)
        if len(others) > 64:
            others = generator.choice(others, 64, replace=False)
        scores.append(read[torch.from_numpy(others)] @ seen[index])
    together = torch.cat(scores)
    if len(together) == 0:
        raise ValueError("All captions are the same: there is no mismatched pair to take a quantile of.")
    return float(torch.quantile(together.double(), q))


def retrieval(encoder: Encoder, images: Tensor, captions: Sequence[str], among: int, seed: int) -> dict[str, float]:
    """The share of images whose own caption scores best among ``among`` different ones, and of captions likewise.

    Images are dealt into groups by ``seed``; those whose caption is in the group already are left out, and so is the
    last group, which is smaller. ``chance`` is 1 / among. NaN where there is no full group.
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
    """How much each image looks like each kind of object, [B, K]: cosines with captions that name it alone."""
    return embed_all(encoder, images) @ encoder.embed_texts([prompt(kind) for kind in kinds]).T


def recognised(scores: Tensor, kinds: Sequence[str], asked: Sequence[Sequence[str]]) -> list[list[bool]]:
    """For each image and each object asked for: whether its kind is among the best as many as were asked for.

    Args:
        scores: [B, K] of ``object_scores``.
    """
    place = {kind: number for number, kind in enumerate(kinds)}
    answers = []
    for row, wanted in zip(scores, asked, strict=True):
        best = set(row.topk(len(set(wanted))).indices.tolist()) if wanted else set()
        answers.append([place[kind] in best for kind in wanted])
    return answers


def embed_all(encoder: Encoder, images: Tensor) -> Tensor:
    """Unit vectors [B, D] of images [B, 3, H, W], some at a time; without gradient."""
    with torch.no_grad():
        return torch.cat([encoder.embed_images(part) for part in torch.split(images, _AT_ONCE)])


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
