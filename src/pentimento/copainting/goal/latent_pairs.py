"""Pairs as a goal planner's UNet sees them: latents, computed once before training."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from pentimento.contracts.errors import ContractError
from pentimento.copainting.goal.planner import GoalPlanner, check_pictures
from pentimento.copainting.goal.vae import encode
from pentimento.copainting.scenes.edits import Pair


@dataclass(frozen=True, eq=False)
class LatentPairs:
    """Pairs in latents: pictures that several pairs share stand once."""

    latents: Tensor
    """Of each different picture, [P, C, h, w]: their modes. Published training draws a target's latents at random about
    its mode; what nothing can foretell only makes the little training here noisier."""
    input: Tensor
    """For each pair, which picture is its input, int64 [N]."""
    target: Tensor
    tokens: Tensor
    """Of the captions, int64 [N, T], padded."""


def encode_pairs(planner: GoalPlanner, pairs: Sequence[Pair]) -> LatentPairs:
    """Encode pairs with a planner's autoencoder and tokenizer.

    Raises:
        ContractError: no pair, or pictures of a size that the planner does not take.
    """
    if not pairs:
        raise ContractError("There is no pair of pictures to train the goal planner on; make the dataset larger.")
    shapes = {picture.shape for pair in pairs for picture in (pair.input, pair.target)}
    if len(shapes) > 1:
        raise ContractError(f"The pairs' pictures are of {len(shapes)} sizes, e.g. {sorted(shapes)[:2]}; resize them.")
    check_pictures(planner, pairs[0].input[None])
    place: dict[bytes, int] = {}
    pictures: list[NDArray[np.uint8]] = []

    def index_of(picture: NDArray[np.uint8]) -> int:
        key = picture.tobytes()
        if key not in place:
            place[key] = len(pictures)
            pictures.append(picture)
        return place[key]

    inputs = [index_of(pair.input) for pair in pairs]
    targets = [index_of(pair.target) for pair in pairs]
    return LatentPairs(
        encode(planner.vae, np.stack(pictures)),
        Tensor(inputs).long(),
        Tensor(targets).long(),
        tokens_of(planner, [pair.caption for pair in pairs]),
    )


def tokens_of(planner: GoalPlanner, captions: Sequence[str]) -> Tensor:
    """Captions as the pipeline itself would tokenise them, int64 [N, T]: padded, and cut where too long."""
    return planner.tokenizer(
        list(captions),
        padding="max_length",
        max_length=planner.tokenizer.model_max_length,
        truncation=True,
        return_tensors="pt",
    ).input_ids
