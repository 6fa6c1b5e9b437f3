"""A goal for the material at hand: a relief scaled and shifted to what is there (thesis 7.3.5, eq. 7.3 and 7.4)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

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
