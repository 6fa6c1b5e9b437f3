"""Greedy search for the next action: the best of many candidates on the present clay, refined (thesis 7.3.5)."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.frames import pixel_to_canvas
from pentimento.planning.pushes.config import DEPTH, LENGTH, THETA, Reach, SculptorConfig
from pentimento.planning.pushes.refine import newton
from pentimento.planning.pushes.rollout import EnsembleRollout
from pentimento.planning.pushes.screening import best_of_all_places

Array = NDArray[np.float32]
FloatArray = NDArray[np.float64]

_ALONG = 0.5
"""Share of the guided candidates that travel along the ridge of excess material. The others head anywhere."""
_SPREAD = 0.4
"""Standard deviation of the logarithm of a guided candidate's depth, relative to the excess height."""
PARENTS = 8
"""Number of best candidates that are varied in each round."""


def best_action(
    states_m: Array, foresight: EnsembleRollout, reach: Reach, *, config: SculptorConfig, rng: np.random.Generator
) -> tuple[FloatArray, float]:
    """The action [5] of all candidates with the lowest value on the members' clay [M, H, W], and that value.

    It may be worse than no action: compare with ``foresight.value(states_m)``.
    """
    height_m = states_m.mean(axis=0)
    actions = candidates(height_m, foresight, reach, config, rng)
    if config.screened > 0:
        actions = np.concatenate([best_of_all_places(height_m, foresight, reach, config.screened), actions])
    values = foresight.values_after(states_m, actions)
    for number in range(config.rounds):
        parents = actions[np.argsort(values, kind="stable")[:PARENTS]]
        varied = _varied(parents, config.candidates, 0.5**number, reach, rng)
        actions = np.concatenate([actions, varied])
        values = np.concatenate([values, foresight.values_after(states_m, varied)])
    best = int(np.argmin(values))
    action, value = actions[best], float(values[best])
    if config.refine == "newton":
        return newton(action, value, states_m, foresight, reach=reach, iterations=config.iterations)
    return action, value


def candidates(
    height_m: Array, foresight: EnsembleRollout, reach: Reach, config: SculptorConfig, rng: np.random.Generator
) -> FloatArray:
    """Candidates [K, 5] on clay [H, W]: guided ones end where the clay is too high, as deep as the excess; others are
    uniform.

    A push is deepest at its end, where it removes most. A pinch raises the clay between its fingers and presses the
    clay below them, so it is tried wherever the height is wrong.
    """
    guided = round(config.guided_share * config.candidates)
    anywhere = reach.draw(config.candidates - guided, rng)
    objective, window_m = foresight.objective, foresight.members[0].window_m
    scale_px = max(0.25 * reach.width_m * objective.pixels_per_m, 0.6)
    difference = (height_m - objective.goal_m).astype(np.float64)
    excess = np.asarray(cv2.GaussianBlur(difference, (0, 0), scale_px), dtype=np.float64)
    wanted = np.maximum(excess, 0.0) ** 2 if reach.travels else excess**2
    if guided == 0 or not wanted.any():
        return anywhere
    rows, columns = stratified_pixels(wanted, guided, rng)
    end_m = pixel_to_canvas(np.stack([columns, rows], axis=1), window_m, objective.pixels_per_m)
    end_m += rng.uniform(-0.5, 0.5, end_m.shape) / objective.pixels_per_m
    along = _ridge_heading(excess, scale_px)[rows, columns] + rng.normal(0, 0.15, guided)
    along += np.pi * rng.integers(0, 2, guided)
    theta = np.where(rng.random(guided) < _ALONG, along, rng.uniform(-np.pi, np.pi, guided))
    actions = np.zeros((guided, 5))
    actions[:, THETA] = theta
    actions[:, LENGTH] = rng.uniform(*reach.length_m, guided)
    actions[:, DEPTH] = np.abs(excess[rows, columns]) * np.exp(rng.normal(0.2, _SPREAD, guided))
    actions[:, :2] = end_m
    if reach.travels:
        actions[:, :2] -= actions[:, LENGTH, None] * np.stack([np.cos(theta), np.sin(theta)], axis=1)
    return np.concatenate([reach.keep_within(actions), anywhere])


def _varied(parents: FloatArray, count: int, share: float, reach: Reach, rng: np.random.Generator) -> FloatArray:
    """Variations [count, 5] of the parents, with standard deviations of this share of ``Reach.spread``."""
    chosen = parents[np.arange(count) % len(parents)]
    return reach.keep_within(chosen + share * reach.spread() * rng.normal(size=(count, 5)))


def stratified_pixels(
    wanted: FloatArray, count: int, rng: np.random.Generator
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Rows and columns in proportion to ``wanted``, by stratified sampling."""
    total = np.cumsum(wanted.ravel())
    drawn = (np.arange(count) + rng.random(count)) / count * total[-1]
    flat = np.minimum(np.searchsorted(total, drawn, side="right"), wanted.size - 1)
    rows, columns = np.unravel_index(flat, wanted.shape)
    return rows, columns


def _ridge_heading(excess: FloatArray, scale_px: float) -> FloatArray:
    """[H, W] heading along ridges and edges nearby, canvas frame (y up), from the structure tensor."""
    right, down = cv2.Sobel(excess, cv2.CV_64F, 1, 0), cv2.Sobel(excess, cv2.CV_64F, 0, 1)
    xx, yy, xy = (cv2.GaussianBlur(p, (0, 0), 2 * scale_px) for p in (right * right, down * down, right * down))
    steepest = 0.5 * np.arctan2(2 * xy, xx - yy)
    return -(steepest + np.pi / 2)
