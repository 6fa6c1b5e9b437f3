"""The picture that is aimed at: a photograph, or what the goal planner makes of the canvas and a person's words."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from pentimento.bundle.sampler import Networks, NoiseSchedule, complete, round_trip
from pentimento.bundle.tokenizer import Tokenizer
from pentimento.bundle.torch_noise import normal, seed_for
from pentimento.control.compose_goal import keep_canvas
from pentimento.control.paint_context import as_picture
from pentimento.control.painter import as_linear
from pentimento.planning.strokes.target import fit_to_canvas, fit_to_ink
from pentimento.robots.tools import Tool

Picture = NDArray[np.uint8]

DARKEST = 0.35
"""Lightness, 0 to 1, of the darkest tone that a pen's few hundred lines are asked for."""


def goal_from_picture(picture: Picture, canvas: Picture, tool: Tool) -> Picture:
    """A picture uint8 [h, w, 3] as the goal for a canvas uint8 [H, W, 3]: its largest centred part that fits.

    For a tool with its own ink it is fitted to the tones of a pen, and what is on the canvas stays part of it, or the
    planner would try to undo it.
    """
    height, width = canvas.shape[:2]
    light = fit_to_canvas(picture, (height, width))
    if tool.color_srgb is None:
        return as_picture(light.astype(np.float32))
    return np.minimum(as_picture(fit_to_ink(light, DARKEST).astype(np.float32)), canvas)


def goal_from_words(
    words: str,
    canvas: Picture,
    networks: Networks,
    schedule: NoiseSchedule,
    tokenizer: Tokenizer,
    side_px: int,
    latents: tuple[int, int],
    steps: int,
    guidances: tuple[float, float],
    seed: int,
) -> Picture:
    """What the goal planner makes of the canvas uint8 [H, W, 3] and of what a person asks for; "" only completes it.

    The goal planner sees and completes the largest centred square, at the size that it was trained with; the rest of
    the canvas stays as it is, and so does what it leaves of the square. The same seed gives the same goal as in the
    workshop.

    Args:
        latents: channels, and the side of the square of pixels that a place of the latents stands for.
        guidances: by the image and by the text.
    """
    height, width = canvas.shape[:2]
    square = min(height, width)
    top, left = (height - square) // 2, (width - square) // 2
    inner = np.ascontiguousarray(canvas[top : top + square, left : left + square])
    shown = _resized(inner, side_px)
    channels, step_px = latents
    noise = normal((1, channels, side_px // step_px, side_px // step_px), seed_for(seed, 0))
    made = complete(
        networks, schedule, shown[None], tokenizer.encode([words]), tokenizer.encode([""]), noise, steps, *guidances
    )
    made = keep_canvas(shown[None], made, round_trip(networks, shown[None]), step_px)[0]
    changed = (made != shown).any(-1).astype(np.uint8)
    changed = cv2.resize(changed, (square, square), interpolation=cv2.INTER_NEAREST)[..., None] > 0
    goal = canvas.copy()  # not resized where nothing is to change, which would blur it
    goal[top : top + square, left : left + square] = np.where(changed, _resized(made, square), inner)
    return goal


def _resized(picture: Picture, side_px: int) -> Picture:
    """A square picture at another size, its light averaged down or interpolated up."""
    if picture.shape[0] == side_px:
        return picture
    way = cv2.INTER_AREA if side_px < picture.shape[0] else cv2.INTER_LINEAR
    return as_picture(np.asarray(cv2.resize(as_linear(picture), (side_px, side_px), interpolation=way), np.float32))
