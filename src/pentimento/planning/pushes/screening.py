"""The best pushes of all places at once: a matched filter for the clay objective.

The clay objective Z (thesis eq. 7.7) is quadratic in the clay. Clay S that a push changes by c has the value

    Z(S) + ⟨∇Z(S), c⟩ + Q(c),

where Q is the objective of the change alone. On flat clay a push makes the same change c at every place. So the values
at all places are one correlation of ∇Z(S) with c, and cost no prediction. They are exact where the change does not
depend on the clay around it; the push model predicts those pushes again that are chosen.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from itertools import product

import cv2
import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.frames import canvas_to_pixel, pixel_to_canvas, pixels_per_m
from pentimento.planning.objectives import ClayObjective, Weights
from pentimento.planning.pushes.config import LENGTH, THETA, Reach, ends
from pentimento.planning.pushes.rollout import EnsembleRollout, PushModel

Array = NDArray[np.float32]
FloatArray = NDArray[np.float64]

_HEADINGS = 16
_LENGTHS = (0.0, 0.5, 1.0)
_DEPTHS = (0.15, 0.4, 0.7)
"""Lengths and depths that are tried, as shares of the reach."""
_THICK = 10
"""Thickness of the flat clay, in depths of the deepest push: no push reaches the table."""
_NEGLIGIBLE = 1e-3
"""Share of a push's largest change that counts as none."""
_ROUNDING_PX = 1e-6


@dataclass(frozen=True, eq=False)
class _Template:
    """A push on flat clay, which may start at any pixel of a range."""

    action: FloatArray
    """[5]; its place is replaced."""
    change_m: Array
    """[h, w] around the start."""
    cost: float
    """Q of the change."""
    start: tuple[int, int]
    """Row and column of the start within ``change_m``."""
    rows: slice
    columns: slice
    """Of the map: where it may start within reach."""


def best_of_all_places(height_m: Array, foresight: EnsembleRollout, reach: Reach, count: int) -> FloatArray:
    """At most ``count`` actions [K, 5] that would lower the objective of clay [H, W] most if it were flat, best first.

    Each is one heading, length and depth at its best place; it starts at a pixel's centre.
    """
    objective, member = foresight.objective, foresight.members[0]
    gradient = objective(height_m)[1].astype(np.float32)
    templates = _templates(member, reach, (gradient.shape[0], gradient.shape[1]), objective.weights)
    actions, values = np.array([template.action for template in templates]).reshape(-1, 5), np.empty(len(templates))
    for number, template in enumerate(templates):
        row, column = template.start
        all_places = cv2.filter2D(gradient, -1, template.change_m, anchor=(column, row), borderType=cv2.BORDER_CONSTANT)
        within = all_places[template.rows, template.columns]
        down, right = np.unravel_index(int(within.argmin()), within.shape)
        values[number] = within[down, right] + template.cost
        start = template.columns.start + right, template.rows.start + down
        actions[number, :2] = pixel_to_canvas(start, member.window_m, objective.pixels_per_m)
    return reach.keep_within(actions[np.argsort(values, kind="stable")[:count]])


@lru_cache(maxsize=4)
def _templates(member: PushModel, reach: Reach, shape: tuple[int, int], weights: Weights) -> tuple[_Template, ...]:
    """What a push model predicts on flat clay, in maps [H, W]."""
    window_m = member.window_m
    scale = pixels_per_m(shape, window_m)
    actions = _tried(reach)
    way_m = ends(actions) - actions[:, :2] if reach.travels else np.zeros((len(actions), 2))
    middle_m = np.array([window_m[[0, 2]].mean(), window_m[[1, 3]].mean()])
    starts = np.round(canvas_to_pixel(middle_m - way_m / 2, window_m, scale)).astype(int)
    actions[:, :2] = pixel_to_canvas(starts, window_m, scale)
    flat = np.full(shape, _THICK * reach.depth_m[1], np.float32)
    changes = member.after(flat, actions) - flat
    costs = ClayObjective(np.zeros(shape, np.float32), window_m, weights).values(changes)
    changes[np.abs(changes) <= _NEGLIGIBLE * np.abs(changes).max(axis=(1, 2), keepdims=True)] = 0
    x_min, y_min, x_max, y_max = reach.window_m
    made = []
    for action, start, way, change, cost in zip(actions, starts, way_m, changes, costs, strict=True):
        left, bottom = canvas_to_pixel(np.array([x_min, y_min]) - np.minimum(way, 0), window_m, scale)
        right, top = canvas_to_pixel(np.array([x_max, y_max]) - np.maximum(way, 0), window_m, scale)
        columns, rows = _whole(left, right), _whole(top, bottom)
        if rows.start < rows.stop and columns.start < columns.stop:
            around, at = _around(change, (start[1], start[0]))
            made.append(_Template(action, around, float(cost), at, rows, columns))
    return tuple(made)


def _tried(reach: Reach) -> FloatArray:
    """Actions [A, 5] of all headings, lengths and depths, at no place. The heading of a push without length is 0."""
    turns = 2 * np.pi * np.arange(_HEADINGS) / _HEADINGS - np.pi
    lengths, depths = (
        low + np.array(shares) * (high - low)
        for (low, high), shares in ((reach.length_m, _LENGTHS), (reach.depth_m, _DEPTHS))
    )
    made = np.array([(0, 0, *each) for each in product(turns, lengths, depths)])
    if reach.travels:
        made[made[:, LENGTH] == 0, THETA] = 0
    return np.unique(made, axis=0)


def _whole(low: float, high: float) -> slice:
    """The pixels whose centres lie between two coordinates."""
    return slice(math.ceil(low - _ROUNDING_PX), math.floor(high + _ROUNDING_PX) + 1)


def _around(change_m: Array, pixel: tuple[int, int]) -> tuple[Array, tuple[int, int]]:
    """The part of a change [H, W] that is not 0 and contains a pixel (row, column), and the pixel's place there."""
    marked = change_m != 0
    marked[pixel] = True
    rows, columns = (np.flatnonzero(marked.any(axis=axis)) for axis in (1, 0))
    part = change_m[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    return np.ascontiguousarray(part), (int(pixel[0] - rows[0]), int(pixel[1] - columns[0]))
