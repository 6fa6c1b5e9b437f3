"""The goal picture: a photograph, or the goal planner's completion of the canvas for a person's words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from pentimento.bundle.sampler import Networks, NoiseSchedule, complete, normal, round_trip, seed_for
from pentimento.bundle.tokenizer import Tokenizer
from pentimento.control.layout import Wish, drawn_in_windows
from pentimento.control.painter import as_picture
from pentimento.planning.strokes.target import fit_to_canvas, fit_to_ink
from pentimento.robots.tools import Tool

Picture = NDArray[np.uint8]

DARKEST: Final = 0.35
"""Lightness, 0 to 1, of the darkest tone that a goal for a pen has: what a few hundred lines can cover."""

_NOISE_LEVELS: Final = 8
"""Difference in levels of 255, after blurring, below which the goal planner's change counts as none."""
_CHANGE_LEVELS: Final = 32
"""Difference from which on the completion alone counts; between the two its weight rises linearly."""
_BLUR: Final = 0.25
"""Standard deviation of the blur as a fraction of a latent cell: a line redrawn slightly displaced is no change."""
_REACH: Final = 0.5
"""Dilation of a change as a fraction of a latent cell, so that the rim of what is drawn is included."""


@dataclass(frozen=True)
class GoalSampling:
    """How the goal planner samples a completion."""

    side_px: int
    """Side of the pictures that it was trained on."""
    latent_channels: int
    latent_step_px: int
    """Side of the square of pixels that a latent cell stands for."""
    steps: int
    image_guidance: float
    text_guidance: float
    seed: int


def goal_from_picture(picture: Picture, canvas: Picture, tool: Tool) -> Picture:
    """A picture uint8 [h, w, 3] as the goal for a canvas uint8 [H, W, 3]: its largest centred part that fits.

    For a tool with its own ink the tones are compressed to those of a pen, and what is on the canvas stays in the goal;
    otherwise the planner would try to erase it.
    """
    height, width = canvas.shape[:2]
    light = fit_to_canvas(picture, (height, width))
    if tool.color_srgb is None:
        return as_picture(light.astype(np.float32))
    return np.minimum(as_picture(fit_to_ink(light, DARKEST).astype(np.float32)), canvas)


def goal_from_words(
    wishes: Sequence[Wish],
    canvas: Picture,
    networks: Networks,
    *,
    has_ink: bool,
    schedule: NoiseSchedule,
    tokenizer: Tokenizer,
    sampling: GoalSampling,
) -> Picture:
    """The goal planner's completion of the canvas uint8 [H, W, 3] for what a person wishes.

    The goal planner completes windows of the largest centred square at the size that it was trained with. The rest of
    the canvas stays as it is, and so does what the planner leaves of a window. A seed gives the same goal as in the
    workshop.

    Args:
        wishes: what to draw where on that square, see `layout.wishes_for`.
        has_ink: see `layout.drawn_in_windows`.
    """
    there = centred_square(canvas)
    inner = np.ascontiguousarray(canvas[there])
    cells = sampling.side_px // sampling.latent_step_px

    def completed(small: Picture, words: str, number: int) -> Picture:
        noise = normal((1, sampling.latent_channels, cells, cells), seed_for(sampling.seed + number, 0))
        completion = complete(
            networks, schedule, small[None], tokens=tokenizer.encode([words]), no_words=tokenizer.encode([""]),
            noise=noise, steps=sampling.steps, image_guidance=sampling.image_guidance,
            text_guidance=sampling.text_guidance,
        )  # fmt: skip
        known = round_trip(networks, small[None])
        return np.asarray(keep_canvas(small[None], completion, known, sampling.latent_step_px)[0])

    goal = canvas.copy()
    goal[there] = drawn_in_windows(inner, wishes, side_px=sampling.side_px, has_ink=has_ink, complete=completed)
    return goal


def centred_square(canvas: Picture) -> tuple[slice, slice]:
    """Rows and columns of the largest centred square of a canvas [H, W, 3]."""
    height, width = canvas.shape[:2]
    square = min(height, width)
    top, left = (height - square) // 2, (width - square) // 2
    return slice(top, top + square), slice(left, left + square)


def keep_canvas(canvas: Picture, completion: Picture, reconstruction: Picture, cell_px: float) -> Picture:
    """Goals: the completion where it differs from the reconstructed canvas, the canvas itself everywhere else.

    A goal planner decodes the whole picture from latents, so what it does not change comes back slightly different.
    The reconstruction by the autoencoder alone shows that difference. Without this step a planner of strokes would try
    to draw it. All pictures are uint8 [B, H, W, 3].

    Args:
        canvas: what was to be completed.
        completion: the goal planner's result.
        reconstruction: the canvas, encoded and decoded by the planner's autoencoder.
        cell_px: side of the square of pixels that a latent cell stands for.
    """
    reach = np.ones((2 * round(_REACH * cell_px) + 1,) * 2, np.uint8)
    goals = np.empty_like(canvas)
    for goal, before, completed, known in zip(goals, canvas, completion, reconstruction, strict=True):
        change = completed.astype(np.float32) - known
        size = np.abs(cv2.GaussianBlur(change, (0, 0), _BLUR * cell_px)).max(-1)
        weight = np.clip((size - _NOISE_LEVELS) / (_CHANGE_LEVELS - _NOISE_LEVELS), 0, 1)
        weight = cv2.dilate(weight, reach)[..., None]
        goal[:] = np.round(before + weight * (completed.astype(np.float32) - before))
    return goals
