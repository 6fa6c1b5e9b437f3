"""What a goal planner's completions keep of their inputs and how near they come to their targets, in plain numbers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pentimento.copainting.goal.guidance_grid import Sampling
from pentimento.copainting.goal.planner import GoalPlanner, complete
from pentimento.copainting.scenes.edits import Pair
from pentimento.copainting.scenes.ink import ink_recall


@dataclass(frozen=True)
class CompletionScores:
    """Means over pairs; sRGB in [0, 1]."""

    mse: float
    """Of the completions against the targets."""
    mse_of_copying: float
    """Of the inputs against the targets: what doing nothing scores."""
    kept: float | None
    """Share of the inputs' ink that the completions show within 1 px; None where no input has ink."""
    pairs: int


def score_planner(planner: GoalPlanner, pairs: Sequence[Pair], sampling: Sampling) -> CompletionScores:
    """Scores over the first `sampling.scored` pairs, at its first guidances."""
    chosen = pairs[: sampling.scored]
    inputs, targets = np.stack([pair.input for pair in chosen]), np.stack([pair.target for pair in chosen])
    made = complete(
        planner, inputs, [pair.caption for pair in chosen], sampling.steps, sampling.image_guidance[0],
        sampling.text_guidance[0], sampling.seed,
    )  # fmt: skip
    return score_completions(inputs, made, targets)


def score_completions(
    inputs: NDArray[np.uint8], completions: NDArray[np.uint8], targets: NDArray[np.uint8]
) -> CompletionScores:
    """Scores of uint8 [B, H, W, 3]."""
    kept = ink_recall(inputs, completions)
    return CompletionScores(
        _mse(completions, targets), _mse(inputs, targets), None if math.isnan(kept) else kept, len(inputs)
    )


def _mse(one: NDArray[np.uint8], other: NDArray[np.uint8]) -> float:
    return float(np.square((one.astype(np.float64) - other) / 255).mean())
