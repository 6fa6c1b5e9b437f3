"""Goals for sculpting: a relief, scaled and shifted to the present clay (thesis 7.3.5, eq. 7.3 and 7.4); letters."""

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
"""Steps of bisection, or of golden section (0.618 each), which narrow an interval of metres to a micrometre."""
_MAX_HEIGHT_M = 1e3
"""A relief of this height is taken as unbounded growth."""


class GoalError(PentimentoError):
    """An input cannot become a goal for this material."""


@dataclass(frozen=True)
class GoalFit:
    """A goal and its fit: Ŝ = α S_t + β within the border."""

    height_m: Array
    """[H, W] above the table."""
    alpha: float
    """Metres per unit of the relief; 0 for a flat one."""
    beta_m: float
    raised: int
    """Number of pixels below the floor, which were raised to it."""
    material_share: float
    """Volume of the goal over that of the clay."""


@dataclass(frozen=True)
class GoalSettings:
    """Weights of (7.4) and bounds of the fit."""

    volume_weight: float
    """w_0, of the squared volume error, as mean height in mm²."""
    floor_weight: float
    """w_1, of the mean depth below the floor, mm."""
    range_weight: float
    """w_2, of the relief's range, mm, which the fit maximises."""
    rising_share: float
    """Share of the displaced volume that rises at other places. 1 conserves the volume (7.4); foam absorbs most of it.
    """
    depth_m: float
    """Depth of the floor below the clay's mean height, as deep as the tools reach. The floor is never below the table.
    """
    border_share: float
    """Share of the area along each edge that stays unchanged."""

    def __post_init__(self) -> None:
        above_zero(self, "volume_weight", "floor_weight")
        above_zero(self, "depth_m")
        at_least(self, 0, "range_weight", "border_share", "rising_share")
        if self.rising_share > 1:
            raise ValueError(f"rising_share is {self.rising_share}; it is a share, at most 1.")
        if self.border_share >= 0.5:
            raise ValueError(
                f"border_share is {self.border_share}; it must be below 0.5, or nothing is left to sculpt."
            )


def fit_goal(relief: FloatArray, height_m: Array, settings: GoalSettings) -> GoalFit:
    """The goal Ŝ [H, W] of a relief [H, W] (any unit, larger is higher) for clay [H, W], metres above the table.

    Ŝ = S_0[M] + (α S_t + β)[1 − M], M the border, where α and β minimise

        w_0 (mean (Ŝ − S_0)⁺ − rising_share · mean (S_0 − Ŝ)⁺)² + w_1 mean (floor − Ŝ)⁺ − w_2 α range(S_t),  α ≥ 0.

    With rising_share = 1 the first term is (mean Ŝ − mean S_0)². Eq. (7.4) as printed has no square, so that less
    material would always be better, and it has depths in place of heights. Pixels that are still below the floor are
    raised to it. The goal of a flat relief is smooth clay.

    Raises:
        GoalError: shapes differ, a map has holes, heights are not metres, or w_2 outweighs w_1 so that α is unbounded.
    """
    relief = np.asarray(relief, dtype=np.float64)
    _check(relief, height_m)
    inside = ~border_mask(height_m.shape, settings.border_share)
    wanted, clay = relief[inside], height_m[inside].astype(np.float64)
    low, extent = float(wanted.min()), float(np.ptp(wanted))
    share = (wanted - low) / extent if extent > 0 else np.zeros_like(wanted)  # 0 to 1, so that α is a height
    floor_m = max(float(clay.mean()) - settings.depth_m, 0.0)
    height, shift = _fitted(share, clay, floor_m, settings)
    goal = np.array(height_m, dtype=np.float64)
    goal[inside] = height * share + shift
    below = inside & (goal < floor_m - _ROUNDING_M)
    goal[inside] = np.maximum(goal[inside], floor_m)
    alpha = height / extent if extent > 0 else 0.0
    material_share = float(goal.mean() / height_m.mean(dtype=np.float64))
    return GoalFit(goal.astype(np.float32), alpha, shift - alpha * low, int(below.sum()), material_share)


def raised_goal(relief: FloatArray, height_m: Array, *, raised_m: float, border_share: float) -> GoalFit:
    """The goal [H, W] of a relief [H, W] that stands above clay [H, W], for robots that can place material.

    Within the border the relief's lowest point is the clay's mean height, and its highest ``raised_m`` above that.

    Raises:
        GoalError: as ``fit_goal``; or the height is not above 0, or the relief is flat.
    """
    relief = np.asarray(relief, dtype=np.float64)
    _check(relief, height_m)
    inside = ~border_mask(height_m.shape, border_share)
    low, extent = float(relief[inside].min()), float(np.ptp(relief[inside]))
    if not (raised_m > 0 and extent > 0):
        raise GoalError(
            f"A goal above the surface needs a height above 0 (here {raised_m:g} m) and a relief with shape."
        )
    beta_m = float(height_m[inside].mean(dtype=np.float64)) - raised_m / extent * low
    goal = np.array(height_m, dtype=np.float64)
    goal[inside] = raised_m / extent * relief[inside] + beta_m
    material_share = float(goal.mean() / height_m.mean(dtype=np.float64))
    return GoalFit(goal.astype(np.float32), raised_m / extent, beta_m, 0, material_share)


def border_mask(shape: tuple[int, ...], share: float) -> NDArray[np.bool_]:
    """[H, W] True within this share of each side along the edges."""
    mask = np.ones(shape, dtype=bool)
    rows, columns = (round(share * side) for side in shape)
    mask[rows : shape[0] - rows, columns : shape[1] - columns] = False
    return mask


def _fitted(share: FloatArray, clay: FloatArray, floor_m: float, settings: GoalSettings) -> tuple[float, float]:
    """α and β, metres, for a relief from 0 to 1 on this clay."""

    def imbalance(goal: FloatArray) -> float:
        risen = goal - clay
        return float(np.maximum(risen, 0).mean() - settings.rising_share * np.maximum(-risen, 0).mean())

    def cost(height: float, shift: float) -> float:
        goal = height * share + shift
        below = np.maximum(floor_m - goal, 0.0).mean()
        square = settings.volume_weight * (_MM * imbalance(goal)) ** 2
        return float(square + _MM * (settings.floor_weight * below - settings.range_weight * height))

    def best_shift(height: float) -> float:
        # The optimum is the shift that conserves the volume, or above it where the relief passes the floor.
        low, high = float((clay - height * share).min()), float((clay - height * share).max())
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if imbalance(height * share + middle) < 0 else (low, middle)
        return _minimum(lambda shift: cost(height, shift), low, floor_m) if low < floor_m else low

    if np.ptp(share) == 0:
        return 0.0, best_shift(0.0)
    largest = float(clay.mean()) - floor_m
    while cost(2 * largest, best_shift(2 * largest)) < cost(largest, best_shift(largest)):
        largest *= 2
        if largest > _MAX_HEIGHT_M:
            raise GoalError(
                f"range_weight {settings.range_weight:g} outweighs floor_weight {settings.floor_weight:g}: the relief "
                "would grow without end. Raise floor_weight, or lower range_weight."
            )
    height = _minimum(lambda height: cost(height, best_shift(height)), 0.0, 2 * largest)
    return height, best_shift(height)


def _minimum(cost: Callable[[float], float], low: float, high: float) -> float:
    """The minimiser of a convex function, by golden section."""
    for _ in range(_HALVINGS):
        left, right = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
        if cost(left) <= cost(right):
            high = right
        else:
            low = left
    return 0.5 * (low + high)


def _check(relief: FloatArray, height_m: Array) -> None:
    if relief.shape != height_m.shape or relief.ndim != 2:
        raise GoalError(
            f"The relief has shape {relief.shape} and the clay {height_m.shape}; bring the relief to the scan's grid."
        )
    for name, values in (("relief", relief), ("clay", height_m)):
        holes = int((~np.isfinite(values)).sum())
        if holes:
            raise GoalError(f"The {name} has {holes} holes (NaN) or infinite heights; fill them first.")
    mean_m = float(height_m.mean(dtype=np.float64))
    if not 0 < mean_m < 1:
        raise GoalError(
            f"The clay is {mean_m:g} m high on average; heights are metres above the table. Check the scan's units."
        )


_FONT = cv2.FONT_HERSHEY_SIMPLEX
_THIN = 1
"""Thickness of OpenCV's strokes, px: a seventh of the letter's height, about the width of a ball's groove in a slab."""
_DRAWN_PX = 512
_MARGIN_PX = 32


def sunken_letters(text: str, shape: tuple[int, int], share: float, soften_px: float) -> FloatArray:
    """A relief [H, W] of letters at −1 in a plate at 0, in OpenCV's plain font: centred, filling ``share`` of a side.

    Args:
        soften_px: standard deviation of the Gaussian that blurs the letters' edges.

    Raises:
        GoalError: the text is empty, or has a character that the font lacks.
    """
    if not text.strip() or not all(" " <= character <= "~" for character in text):
        raise GoalError(f"The text {text!r} cannot be drawn; give printable ASCII characters.")
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
