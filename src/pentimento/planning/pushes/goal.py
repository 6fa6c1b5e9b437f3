"""A goal for the material at hand: a relief scaled and shifted to what is there (thesis 7.3.5, eq. 7.3 and 7.4)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.errors import PentimentoError
from pentimento.contracts.ranges import above_zero, at_least

Array = NDArray[np.float32]
FloatArray = NDArray[np.float64]

_MM = 1e3
_GOLDEN = (np.sqrt(5) - 1) / 2
_ROUNDING_M = 1e-9
_HALVINGS = 40
"""Of an interval by a half, or by a golden section's .618: to a micrometre of metres, at least."""
_TOO_MUCH_M = 1e3


class GoalError(PentimentoError):
    """Something cannot be a goal for this material."""


@dataclass(frozen=True)
class GoalFit:
    """A goal, and how it came about: Ŝ = α S_t + β within the border."""

    height_m: Array
    """[H, W] above the table."""
    alpha: float
    """Metres per unit of the relief; 0 for a flat one."""
    beta_m: float
    raised: int
    """Pixels that lay below the floor and were raised to it."""
    material_share: float
    """Its volume over that of the clay."""


@dataclass(frozen=True)
class GoalSettings:
    """How a relief becomes a goal: the weights of (7.4), and its bounds."""

    volume: float
    """w_0, for as much material as there is: of the squared imbalance in mean height, mm²."""
    floor: float
    """w_1, for nothing below the floor: of the mean depth below it, mm."""
    definition: float
    """w_2, for a strong relief: of its range, mm."""
    kept: float
    """Share of what is pressed away that comes up elsewhere; 1 keeps the volume (7.4), foam swallows most of it."""
    reach_m: float
    """The floor lies so far below the clay's mean height, for tools reach no deeper, and nowhere below the table."""
    border: float
    """Share of the area along each edge that stays as it is."""

    def __post_init__(self) -> None:
        above_zero(self, "volume", "floor")
        above_zero(self, "reach_m")
        at_least(self, 0, "definition", "border", "kept")
        if self.kept > 1:
            raise ValueError(f"kept is {self.kept}; it is a share, at most 1.")
        if self.border >= 0.5:
            raise ValueError(f"border is {self.border}; below .5, something is left to sculpt.")


def fit_goal(relief: FloatArray, height_m: Array, settings: GoalSettings) -> GoalFit:
    """The goal Ŝ [H, W] that a relief [H, W], up is more, asks for of clay [H, W], metres above the table.

    Ŝ = S_0[M] + (α S_t + β)[1 − M], M the border, with α and β that minimise

        w_0 (mean (Ŝ − S_0)⁺ − kept · mean (S_0 − Ŝ)⁺)² + w_1 mean (floor − Ŝ)⁺ − w_2 α range(S_t),  α ≥ 0.

    Where all is kept, the first term is (mean Ŝ − mean S_0)²: (7.4) as printed has no square, so that less material
    would always be better, and counts depths; these are heights. What still lies below the floor is raised to it. A
    flat relief asks for smooth clay.

    Raises:
        GoalError: shapes differ, holes, heights that are no metres, or w_2 outweighs w_1 so that α has no bound.
    """
    relief = np.asarray(relief, dtype=np.float64)
    _check(relief, height_m, settings)
    inside = ~border_mask(height_m.shape, settings.border)
    wanted, clay = relief[inside], height_m[inside].astype(np.float64)
    low, extent = float(wanted.min()), float(np.ptp(wanted))
    share = (wanted - low) / extent if extent > 0 else np.zeros_like(wanted)  # 0 to 1, so that alpha is a height
    floor_m = max(float(clay.mean()) - settings.reach_m, 0.0)
    height, shift = _fitted(share, clay, floor_m, settings)
    goal = np.array(height_m, dtype=np.float64)
    goal[inside] = height * share + shift
    below = inside & (goal < floor_m - _ROUNDING_M)
    goal[inside] = np.maximum(goal[inside], floor_m)
    alpha = height / extent if extent > 0 else 0.0
    material_share = float(goal.mean() / height_m.mean(dtype=np.float64))
    return GoalFit(goal.astype(np.float32), alpha, shift - alpha * low, int(below.sum()), material_share)


def border_mask(shape: tuple[int, ...], share: float) -> NDArray[np.bool_]:
    """True [H, W] along the edges, for this share of each side."""
    mask = np.ones(shape, dtype=bool)
    rows, columns = (round(share * side) for side in shape)
    mask[rows : shape[0] - rows, columns : shape[1] - columns] = False
    return mask


def _fitted(share: FloatArray, clay: FloatArray, floor_m: float, settings: GoalSettings) -> tuple[float, float]:
    """α and β, metres, for a relief from 0 to 1 upon this clay."""

    def imbalance(goal: FloatArray) -> float:
        risen = goal - clay
        return float(np.maximum(risen, 0).mean() - settings.kept * np.maximum(-risen, 0).mean())

    def cost(height: float, shift: float) -> float:
        goal = height * share + shift
        below = np.maximum(floor_m - goal, 0.0).mean()
        square = settings.volume * (_MM * imbalance(goal)) ** 2
        return float(square + _MM * (settings.floor * below - settings.definition * height))

    def best_shift(height: float) -> float:
        # It lies no lower than balance, and above it only as far as the relief would dip below the floor.
        low, high = float((clay - height * share).min()), float((clay - height * share).max())
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if imbalance(height * share + middle) < 0 else (low, middle)
        return _minimum(lambda shift: cost(height, shift), low, floor_m) if low < floor_m else low

    if np.ptp(share) == 0:
        return 0.0, best_shift(0.0)
    most = float(clay.mean()) - floor_m
    while cost(2 * most, best_shift(2 * most)) < cost(most, best_shift(most)):
        most *= 2
        if most > _TOO_MUCH_M:
            raise GoalError(
                f"A definition of {settings.definition:g} outweighs a floor of {settings.floor:g}: the relief would "
                "grow without end. Raise floor, or lower definition."
            )
    height = _minimum(lambda height: cost(height, best_shift(height)), 0.0, 2 * most)
    return height, best_shift(height)


def _minimum(cost: Callable[[float], float], low: float, high: float) -> float:
    """Where a convex function is least, by golden section."""
    for _ in range(_HALVINGS):
        left, right = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
        if cost(left) <= cost(right):
            high = right
        else:
            low = left
    return 0.5 * (low + high)


def _check(relief: FloatArray, height_m: Array, settings: GoalSettings) -> None:
    if relief.shape != height_m.shape or relief.ndim != 2:
        raise GoalError(
            f"The relief has shape {relief.shape} and the clay {height_m.shape}; bring the relief to the scan's grid."
        )
    for name, values in (("relief", relief), ("clay", height_m)):
        holes = int((~np.isfinite(values)).sum())
        if holes:
            raise GoalError(f"The {name} has {holes} holes (NaN) or infinite heights; fill them before it is fitted.")
    mean_m = float(height_m.mean(dtype=np.float64))
    if not 0 < mean_m < 1:
        raise GoalError(
            f"The clay is {mean_m:g} m high on average; heights are metres above the table. Check the scan's units."
        )


_FONT = cv2.FONT_HERSHEY_SIMPLEX
_THIN = 1
"""Strokes of a seventh of the letter's height: about as wide as a ball's groove where the letter fills a slab."""
_DRAWN_PX = 512
_MARGIN_PX = 32


def sunken_letters(text: str, shape: tuple[int, int], share: float, soften_px: float) -> FloatArray:
    """Letters at −1 in a plate at 0, [H, W]: as large as fits ``share`` of the area's sides, in its middle.

    Args:
        soften_px: width of the Gaussian that the letters' edges are softened by.

    Raises:
        GoalError: there is nothing to draw, or a character that these letters lack.
    """
    if not text.strip() or not all(" " <= character <= "~" for character in text):
        raise GoalError(f"The letters {text!r} cannot be drawn; give one or more of A to Z, digits and plain signs.")
    scale = cv2.getFontScaleFromHeight(_FONT, _DRAWN_PX, _THIN)
    (width, height), below = cv2.getTextSize(text, _FONT, scale, _THIN)
    drawn = np.zeros((height + below + height // 2 + 2 * _MARGIN_PX, width + 2 * _MARGIN_PX), np.uint8)
    cv2.putText(drawn, text, (_MARGIN_PX, height + _MARGIN_PX), _FONT, scale, 255, _THIN, cv2.LINE_AA)
    rows, columns = np.flatnonzero(drawn.any(axis=1)), np.flatnonzero(drawn.any(axis=0))
    drawn = drawn[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    fit = share * min(shape[0] / drawn.shape[0], shape[1] / drawn.shape[1])
    tall, wide = (max(round(fit * side), 1) for side in drawn.shape)
    relief = np.zeros(shape)
    top, left = (shape[0] - tall) // 2, (shape[1] - wide) // 2
    small = cv2.resize(drawn, (wide, tall), interpolation=cv2.INTER_AREA)
    relief[top : top + tall, left : left + wide] = small / -255.0
    return np.asarray(cv2.GaussianBlur(relief, (0, 0), soften_px), dtype=np.float64) if soften_px > 0 else relief
