"""Completions of pairs by a goal planner: their scores, and a picture of them at several guidances."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.ranges import at_least
from pentimento.copainting.goal.planner import GoalPlanner, SeededSampling, complete
from pentimento.copainting.scenes.edits import Pair
from pentimento.copainting.scenes.ink import ink_recall
from pentimento.copainting.sheets import Layout, side_by_side

_LAYOUT: Final = Layout(line_px=26, column_gap_px=4, row_gap_px=0, title_baseline_px=16, caption_baseline_px=18)


@dataclass(frozen=True)
class Sampling:
    """How completions are sampled, scored and shown."""

    steps: int
    """Of DDIM."""
    image_guidance: tuple[float, ...]
    """The grid shows each value with each of `text_guidance`, all 1 or more (less would switch guidance off). The first
    of each is the default.
    """
    text_guidance: tuple[float, ...]
    shown: int
    """Pairs in the grid."""
    scored: int
    """Pairs in the metrics."""
    enlarged: int
    """Pixels of the grid for one pixel of a picture."""
    seed: int

    def __post_init__(self) -> None:
        at_least(self, 1, "steps", "shown", "scored", "enlarged")
        at_least(self, 0, "seed")
        for name in ("image_guidance", "text_guidance"):
            values = getattr(self, name)
            if not values or min(values) < 1:
                raise ValueError(f"{name} is {list(values)}; give values of 1 or more.")

    def at(self, image_guidance: float, text_guidance: float) -> SeededSampling:
        """The sampling at one value of each guidance."""
        return SeededSampling(self.steps, image_guidance, text_guidance, self.seed)


@dataclass(frozen=True)
class CompletionScores:
    """Means over pairs; sRGB in [0, 1]."""

    mse: float
    """Of the completions to the targets."""
    mse_of_copying: float
    """Of the inputs to the targets: the score of changing nothing."""
    kept: float | None
    """Fraction of the inputs' ink that the completions show within 1 px; None if no input has ink."""
    pairs: int


def score_planner(planner: GoalPlanner, pairs: Sequence[Pair], sampling: Sampling) -> CompletionScores:
    """Scores over the first `sampling.scored` pairs, at the default guidances."""
    chosen = pairs[: sampling.scored]
    inputs, targets = np.stack([pair.input for pair in chosen]), np.stack([pair.target for pair in chosen])
    first = sampling.at(sampling.image_guidance[0], sampling.text_guidance[0])
    completions = complete(planner, inputs, [pair.caption for pair in chosen], first)
    return score_completions(inputs, completions, targets)


def score_completions(
    inputs: NDArray[np.uint8], completions: NDArray[np.uint8], targets: NDArray[np.uint8]
) -> CompletionScores:
    """Scores of completions, uint8 [B, H, W, 3], with inputs and targets of the same shape."""
    kept = ink_recall(inputs, completions)
    return CompletionScores(
        _mse(completions, targets), _mse(inputs, targets), None if math.isnan(kept) else kept, len(inputs)
    )


def _mse(one: NDArray[np.uint8], other: NDArray[np.uint8]) -> float:
    return float(np.square((one.astype(np.float64) - other) / 255).mean())


def guidance_grid(planner: GoalPlanner, pairs: Sequence[Pair], sampling: Sampling) -> NDArray[np.uint8]:
    """A row for each pair: input, target, and a completion for each image × text guidance; uint8 [H, W, 3]."""
    inputs = np.stack([pair.input for pair in pairs])
    captions = [pair.caption for pair in pairs]
    columns = {"input": inputs, "target": np.stack([pair.target for pair in pairs])}
    for image in sampling.image_guidance:
        for text in sampling.text_guidance:
            columns[f"image {image:g} text {text:g}"] = complete(planner, inputs, captions, sampling.at(image, text))
    height, width = (sampling.enlarged * side for side in inputs.shape[1:3])
    return side_by_side(columns, captions, (height, width), _LAYOUT)
