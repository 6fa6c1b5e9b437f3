"""How far a goal is from what the robot's plan will make of it: pixels (thesis 6.1) and meaning (thesis 6.2)."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pentimento.copainting.scenes.ink import ink_mask, ink_recall
from pentimento.semantics.encoder import Encoder
from pentimento.semantics.scores import embed_all

FloatArray = NDArray[np.float64]
Pictures = NDArray[np.uint8]


def delta_pix(goals: Pictures, plans: Pictures) -> FloatArray:
    """Mean squared difference [B] of goals and foretold plans, uint8 [B, H, W, 3]; sRGB in [0, 1].

    The thesis's (6.1), divided by the number of values, so that it does not grow with the picture.
    """
    difference = (goals.astype(np.float64) - plans) / 255
    return np.square(difference).mean(axis=(1, 2, 3))


def delta_sem(encoder: Encoder, goals: Pictures, plans: Pictures) -> FloatArray:
    """1 - cos [B] of the embeddings of goals and foretold plans, uint8 [B, H, W, 3]: the Semantic Sim2Real Gap.

    The thesis prints (6.2) without `1 -`, but calls it a distance and lowers it.
    """
    seen = embed_all(encoder, as_tensor(goals)) * embed_all(encoder, as_tensor(plans))
    return np.asarray(1 - seen.sum(-1).double().numpy())


def surviving_ink(canvases: Pictures, pictures: Pictures) -> FloatArray:
    """Share [B] of each canvas's ink that a picture still shows within 1 px; NaN where a canvas has none."""
    return np.array([ink_recall(before, after) for before, after in zip(canvases, pictures, strict=True)])


def inked_share(pictures: Pictures) -> FloatArray:
    """Share [B] of each picture's pixels that are inked."""
    return np.asarray(ink_mask(pictures).mean(axis=(1, 2)), dtype=np.float64)


def changed_share(canvases: Pictures, pictures: Pictures, minimum: int = 64) -> FloatArray:
    """Share [B] of the pixels of which any channel moved by `minimum` levels of 255 or more."""
    moved = np.abs(canvases.astype(np.int16) - pictures).max(-1) >= minimum
    return np.asarray(moved.mean(axis=(1, 2)), dtype=np.float64)


def as_tensor(pictures: Pictures) -> Tensor:
    """uint8 [B, H, W, 3] as sRGB [B, 3, H, W] in [0, 1], as encoders take them."""
    return torch.from_numpy(np.ascontiguousarray(pictures)).permute(0, 3, 1, 2).float() / 255
