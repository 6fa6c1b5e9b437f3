"""Contrastive training of a text-image encoder (Radford et al. 2021) within two minutes on one core.

Five measures make up for little data and few steps. The vision tower starts with convolutions. Pictures are moved,
turned and resized a little each time. Captions with one wrong word are negatives. Equal captions are positives for each
other's pictures. Where the table has objects, auxiliary losses predict the kinds in each picture, by captions of one
kind and by a linear head, and the kind under each patch.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Final, Literal

import lightning
import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import (
    adaptive_avg_pool2d,
    affine_grid,
    cross_entropy,
    grid_sample,
    interpolate,
    normalize,
)
from torch.utils.data import DataLoader, IterableDataset
from transformers import CLIPModel, CLIPTokenizer

from pentimento.contracts.ranges import above_zero, at_least
from pentimento.dynamics.quiet_lightning import quiet_lightning
from pentimento.semantics.devices import precision_on
from pentimento.semantics.encoder import Encoder, EncoderShape, new_model, normalise
from pentimento.semantics.examples import VIEWS, Examples, is_black

_LARGEST_NORM: Final = 1.0  # of a step's gradient
_SHIFT: Final = 0.12  # of `moved`, in halves of the picture's side
_TURN_RAD: Final = math.radians(8)
_RESIZE: Final = 0.15  # of the logarithm of the size

Batch = tuple[Tensor, Tensor, Tensor, Tensor]
"""Indices [B] of pictures, views, captions and altered captions."""


@dataclass(frozen=True)
class EncoderTraining:
    """Hyper-parameters of training."""

    steps: int
    batch: int
    rate: float
    """Maximum learning rate of AdamW."""
    warmup: float
    """Fraction of the steps in which the rate rises; then it decays to 0 along a cosine."""
    weight_decay: float
    object_weight: float
    """Of the losses on objects."""
    patch_weight: float
    """Of the loss on the objects under patches."""
    view_shares: dict[str, float]
    """Relative frequency of each of `examples.VIEWS`."""
    precision: Literal["32-true", "bf16-mixed"]
    """The second is faster on CPUs with instructions for bfloat16; others compute it in float32."""
    seed: int

    def __post_init__(self) -> None:
        at_least(self, 2, "batch")
        at_least(self, 1, "steps")
        above_zero(self, "rate")
        at_least(self, 0, "warmup", "weight_decay", "object_weight", "patch_weight", "seed")
        if set(self.view_shares) != set(VIEWS) or min(self.view_shares.values()) < 0:
            raise ValueError(f"view_shares is {self.view_shares}; give each of {', '.join(VIEWS)} a share.")


def train_encoder(
    examples: Examples,
    tokenizer: CLIPTokenizer,
    shape: EncoderShape,
    *,
    config: EncoderTraining,
    log: Callable[[str, float, int], None],
) -> Encoder:
    """A new encoder, trained on examples; reproducible for the same seed and number of threads."""
    model = new_model(shape, tokenizer, config.seed)
    with quiet_lightning(), torch.random.fork_rng():
        torch.manual_seed(config.seed)
        module = _Contrast(model, examples, config, log)
        trainer = lightning.Trainer(
            accelerator="cpu", max_epochs=1, logger=False, enable_checkpointing=False,
            enable_progress_bar=False, enable_model_summary=False, precision=precision_on("cpu", config.precision),
        )  # fmt: skip
        trainer.fit(module, DataLoader(_Draws(examples, config), batch_size=None))
    return Encoder(model, tokenizer)


class _Draws(IterableDataset[Batch]):
    """The indices of each step's batch; step n depends on (seed, n) only."""

    def __init__(self, examples: Examples, config: EncoderTraining) -> None:
        self._examples, self._config = examples, config

    def __iter__(self) -> Iterator[Batch]:
        shares = np.array([self._config.view_shares[view] for view in VIEWS])
        count = len(self._examples.views)
        for step in range(self._config.steps):
            generator = np.random.default_rng([self._config.seed, 3, step])
            pictures = generator.choice(count, self._config.batch, replace=self._config.batch > count)
            views = generator.choice(len(VIEWS), len(pictures), p=shares / shares.sum())
            texts = [self._texts(p, v, generator) for p, v in zip(pictures.tolist(), views.tolist(), strict=True)]
            right, wrong = torch.tensor(texts).T
            yield torch.from_numpy(pictures), torch.from_numpy(views), right, wrong

    def _texts(self, picture: int, view: int, generator: np.random.Generator) -> tuple[int, int]:
        """A caption of the picture and one with a wrong word (the same caption again if there is none)."""
        black = is_black(view)
        captions = (self._examples.plain if black else self._examples.captions)[picture]
        altered = (self._examples.altered_plain if black else self._examples.altered)[picture]
        pick = int(generator.integers(len(captions)))
        wrong = altered[pick]
        return captions[pick], wrong[int(generator.integers(len(wrong)))] if wrong else captions[pick]


class _Contrast(lightning.LightningModule):
    """Losses and optimiser for Lightning."""

    def __init__(
        self, model: CLIPModel, examples: Examples, config: EncoderTraining, log: Callable[[str, float, int], None]
    ) -> None:
        super().__init__()
        self.model = model.train().requires_grad_(True)
        self._examples, self._config, self._log = examples, config, log
        width, kinds = model.config.vision_config.hidden_size, max(1, len(examples.prompts))
        # It names kinds from what the vision model holds, sooner than captions can; it is thrown away.
        self._direct = torch.nn.Linear(width, kinds)

    def training_step(self, batch: Batch, batch_idx: int) -> Tensor:
        pictures, views, right, wrong = batch
        known = self._examples
        prompts = torch.tensor(known.prompts, dtype=torch.long)
        texts, place = torch.unique(torch.cat([right, wrong, prompts]), return_inverse=True)
        generator = torch.Generator().manual_seed(
            int(np.random.SeedSequence([self._config.seed, 4, batch_idx]).generate_state(1)[0])
        )
        shown, regions = moved(known.views[pictures, views].float() / 255, known.regions[pictures], generator)
        pooled, tokens = self._look(shown)
        seen, patches = (normalize(self.model.visual_projection(states), dim=-1) for states in (pooled, tokens))
        read = self._read(texts)
        scale = self.model.logit_scale.exp().clamp(max=100)
        loss = contrast(scale * seen @ read.T, place[: len(right)])
        if len(prompts):
            names = read[place[-len(prompts) :]].T
            present = known.present[pictures]
            wanted = patch_kinds(regions, known.region_kinds[pictures], patches.shape[1])
            named = _several(scale * seen @ names, present) + _several(self._direct(pooled), present)
            loss = loss + self._config.object_weight * named
            loss = loss + self._config.patch_weight * _one_each(scale * patches @ names, wanted)
        if batch_idx % 20 == 0 or batch_idx == self._config.steps - 1:
            self._log("loss", float(loss.detach()), batch_idx)
        return loss

    def _look(self, images: Tensor) -> tuple[Tensor, Tensor]:
        """Features of the vision model for pictures [B, C] and their patches [B, L, C]."""
        size = self.model.config.vision_config.image_size
        if images.shape[-1] != size:
            images = interpolate(images, (size, size), mode="bicubic", antialias=True, align_corners=False)
        out = self.model.vision_model(pixel_values=normalise(images))
        return out.pooler_output, self.model.vision_model.post_layernorm(out.last_hidden_state[:, 1:])

    def _read(self, texts: Tensor) -> Tensor:
        mask = self._examples.mask[texts]
        length = int(mask.sum(1).max())
        tokens = self._examples.tokens[texts][:, :length]
        pooled = self.model.get_text_features(input_ids=tokens, attention_mask=mask[:, :length]).pooler_output
        return normalize(pooled, dim=-1)

    def on_before_optimizer_step(self, *_: Any) -> None:
        """Clip the gradients; Lightning refuses to clip those of a fused optimiser in mixed precision."""
        torch.nn.utils.clip_grad_norm_(self.parameters(), _LARGEST_NORM)

    def configure_optimizers(self) -> Any:
        matrices = [p for p in self.parameters() if p.ndim > 1]
        others = [p for p in self.parameters() if p.ndim <= 1]
        groups: list[dict[str, Any]] = [{"params": matrices}, {"params": others, "weight_decay": 0.0}]
        optimizer = torch.optim.AdamW(
            groups,
            lr=self._config.rate, betas=(0.9, 0.98), weight_decay=self._config.weight_decay, fused=True,
        )  # fmt: skip
        schedule = torch.optim.lr_scheduler.LambdaLR(optimizer, self._rise_and_fall)
        return {"optimizer": optimizer, "lr_scheduler": {"scheduler": schedule, "interval": "step"}}

    def _rise_and_fall(self, step: int) -> float:
        warm_up = self._config.warmup * self._config.steps
        if step < warm_up:
            return (step + 1) / (warm_up + 1)
        return 0.5 * (1 + math.cos(math.pi * (step - warm_up) / max(1.0, self._config.steps - warm_up)))


def moved(images: Tensor, regions: Tensor, generator: torch.Generator) -> tuple[Tensor, Tensor]:
    """Pictures [B, C, H, W] with their regions [B, H, W], each shifted, turned and resized at random.

    What comes into view at the border repeats the border's pixels.
    """
    count = len(images)
    shift, turn, size = (
        (2 * torch.rand(shape, generator=generator) - 1) * largest
        for shape, largest in (((count, 2), _SHIFT), ((count,), _TURN_RAD), ((count,), _RESIZE))
    )
    cos, sin = torch.cos(turn) * torch.exp(size), torch.sin(turn) * torch.exp(size)
    matrix = torch.stack([torch.stack([cos, -sin, shift[:, 0]], 1), torch.stack([sin, cos, shift[:, 1]], 1)], 1)
    grid = affine_grid(matrix, list(images.shape), align_corners=False)
    labels = grid_sample(regions[:, None].float(), grid, mode="nearest", padding_mode="zeros", align_corners=False)
    return grid_sample(images, grid, padding_mode="border", align_corners=False), labels[:, 0].to(regions.dtype)


def contrast(logits: Tensor, right: Tensor) -> Tensor:
    """Mean of both directions of the contrastive loss, for logits [B, T] of B pictures and T distinct captions.

    `right` [B] is the caption of each picture. Other captions are negatives for all pictures.
    """
    of_picture = cross_entropy(logits, right)
    own = torch.nn.functional.one_hot(right, logits.shape[1]).float().T  # [T, B]
    used = own.sum(1) > 0
    of_caption = cross_entropy(logits.T[used], own[used] / own[used].sum(1, keepdim=True))
    return 0.5 * (of_picture + of_caption)


def _several(logits: Tensor, present: Tensor) -> Tensor:
    """Cross entropy of kinds [B, K] of which several may be right, over pictures with known objects."""
    known = present.sum(1) > 0
    if not known.any():
        return logits.sum() * 0
    return cross_entropy(logits[known], present[known] / present[known].sum(1, keepdim=True))


def _one_each(logits: Tensor, wanted: Tensor) -> Tensor:
    """Cross entropy of kinds [B, L, K] over patches that show an object, with targets `wanted` [B, L] (-1: none)."""
    known = wanted >= 0
    return cross_entropy(logits[known], wanted[known]) if known.any() else logits.sum() * 0


def patch_kinds(regions: Tensor, region_kinds: Tensor, patches: int) -> Tensor:
    """The kind [B, L] of the object that covers most of each patch; -1 if objects cover less than a fifth.

    Args:
        regions: [B, H, W], labels.
        region_kinds: [B, R], the kind of each label.
        patches: L, a square number.
    """
    labels = torch.arange(1, region_kinds.shape[1])
    if len(labels) == 0:
        return torch.full((len(regions), patches), -1)
    shares = adaptive_avg_pool2d((regions[:, None] == labels[:, None, None]).float(), math.isqrt(patches))
    most, label = shares.flatten(2).max(1)
    return region_kinds.gather(1, label + 1).masked_fill(most < 0.2, -1)
