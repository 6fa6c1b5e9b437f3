"""Plans of placed pellets: chosen greedily where the goal lies above the clay, then improved together.

The value of a plan is its expected objective: that of the predicted clay, plus the squared error that the place model
is known to leave of its pellets (``PlaceModel.unexplained``), with the weight of the 3D error. It compares with the
value of a plan of pushes, which has the ensemble's variance there (``rollout.EnsembleRollout``).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.errors import ContractError
from pentimento.contracts.frames import Window, check_window, pixel_to_canvas
from pentimento.planning.adam import Adam
from pentimento.planning.objectives import ClayObjective
from pentimento.planning.pushes.config import SculptorConfig
from pentimento.planning.pushes.initialise import PARENTS, stratified_pixels
from pentimento.planning.pushes.places import VOLUME, PlaceModel
from pentimento.planning.pushes.plan import PushPlan, helps
from pentimento.robots.tools import Feeder, ball_m3

Array = NDArray[np.float32]
FloatArray = NDArray[np.float64]

_MM = 1e3
_SHORTFALL = 0.5
"""Share of the smallest pellet's peak by which the goal must lie above the clay: below it, the pellet would overshoot
by more than it supplies."""
_PEAKS = 0.3
"""Standard deviation of the logarithm of a candidate's peak, relative to the height that is lacking."""
_CANDIDATES = 32
"""Candidates for each pellet."""
_ROUNDS = 1
"""Rounds in which as many candidates again are tried around the best."""
_VOLUME_STEP = 0.1
"""Adam's largest step of the logarithm of a volume."""
_REFINING = 4
"""Iterations of refinement for each of the pushes': a footprint costs a fraction of a network."""


@dataclass(frozen=True)
class PlaceReach:
    """Bounds of pellets."""

    window_m: tuple[float, float, float, float]
    """x_min, y_min, x_max, y_max of their middles, canvas frame."""
    volume_m3: tuple[float, float]

    def __post_init__(self) -> None:
        check_window(self.window_m)
        if not 0 < self.volume_m3[0] <= self.volume_m3[1]:
            raise ValueError(f"volume_m3 is {self.volume_m3}; give two volumes above 0, the smaller first.")

    def keep_within(self, places: FloatArray) -> FloatArray:
        """Places [K, 3] clipped to the bounds."""
        low = (*self.window_m[:2], self.volume_m3[0])
        high = (*self.window_m[2:], self.volume_m3[1])
        return np.clip(places, low, high)


def place_reach_for(feeder: Feeder, model: PlaceModel, area_m: tuple[float, float], edge_m: float) -> PlaceReach:
    """Pellets that a feeder can set on a slab and that the model has seen, ``edge_m`` from the slab's edge.

    Raises:
        ContractError: the model was fitted to another feeder, or to pellets of other volumes.
    """
    low = max(feeder.volume_m3[0], model.volume_m3[0])
    high = min(feeder.volume_m3[1], model.volume_m3[1])
    if model.feeder != feeder.name or low > high:
        raise ContractError(
            f"The place model was fitted to the feeder {model.feeder} and pellets of {model.volume_m3[0]:.3g} to "
            f"{model.volume_m3[1]:.3g} m³; the {feeder.name} sets {feeder.volume_m3[0]:.3g} to "
            f"{feeder.volume_m3[1]:.3g} m³. Fit it to this feeder's pellets."
        )
    edge_m = max(edge_m, 0.5 * feeder.diameter_m[1])  # the largest pellet lies on the slab
    return PlaceReach((edge_m, edge_m, area_m[0] - edge_m, area_m[1] - edge_m), (low, high))


class PlaceForesight:
    """Values of pellets on clay [H, W] for one goal."""

    def __init__(
        self, model: PlaceModel, objective: ClayObjective, window_m: Window, disagreement_weight: float
    ) -> None:
        self.model, self.objective, self.window_m = model, objective, window_m
        x_min, y_min, x_max, y_max = check_window(window_m)
        area_m2 = (x_max - x_min) * (y_max - y_min)
        weight = disagreement_weight * objective.weights.error_3d
        self._cost = weight * _MM**2 * model.unexplained / area_m2  # of an energy of 1 m⁴

    def unexplained(self, places: FloatArray) -> float:
        """The expected cost of what the model leaves of pellets [K, 3]."""
        return self._cost * sum(self.model.energy_m4(float(volume)) for volume in places[:, VOLUME])

    def values_after(self, height_m: Array, places: FloatArray) -> FloatArray:
        """The value [K] after each of K alternative pellets [K, 3] on clay [H, W]."""
        after = height_m + self._added(places)
        costs = np.array([self.unexplained(place[None]) for place in places])
        return self.objective.values(after.astype(np.float32)) + costs

    def after_each(self, height_m: Array, places: FloatArray) -> Array:
        """The clay [K + 1, H, W] before the first and after each pellet [K, 3] of a sequence."""
        added = np.concatenate([np.zeros((1, *height_m.shape)), np.cumsum(self._added(places), axis=0)])
        return (height_m + added).astype(np.float32)

    def value_and_gradient(self, height_m: Array, places: FloatArray) -> tuple[float, FloatArray]:
        """The value after all pellets [K, 3], and its gradient [K, 3]."""
        shape = (height_m.shape[0], height_m.shape[1])
        steps = [self.model.step(place, shape, self.window_m) for place in places]
        after = (height_m + sum(added for added, _ in steps)).astype(np.float64)
        value, cotangent = self.objective(after)  # type: ignore[arg-type]
        gradient = np.stack([pull(np.asarray(cotangent, np.float64)) for _, pull in steps])
        for row, place in zip(gradient, places, strict=True):
            volume = float(place[VOLUME])
            row[VOLUME] += self._cost * self.model.energy_m4(volume) * (2 - 2 * self.model.growth) / volume
        return value + self.unexplained(places), gradient

    def _added(self, places: FloatArray) -> FloatArray:
        height, width = self.objective.goal_m.shape
        return self.model.change(places, (height, width), self.window_m)


def plan_places(
    height_m: Array, foresight: PlaceForesight, reach: PlaceReach, *, config: SculptorConfig, count: int,
    item: tuple[int, ...],
) -> PushPlan:  # fmt: skip
    """Up to ``count`` pellets, at most the horizon, that bring clay [H, W] nearer to the goal; see ``plan.plan``."""
    rng = np.random.default_rng([config.seed, *item, 1])
    places = np.zeros((0, 3))
    height, value = height_m, float(foresight.objective.values(height_m))
    while len(places) < min(count, config.horizon):
        found = _best(height, foresight, reach, rng)
        if found is None:
            break
        lower = float(foresight.values_after(height, found[None])[0])
        if not helps(value, lower, config):
            break
        places = np.concatenate([places, found[None]])
        height = foresight.after_each(height, found[None])[1]
        value = float(foresight.objective.values(height))
    if len(places) > 0 and config.refine != "none" and config.iterations > 0:
        places = _refined(places, height_m, foresight, reach, config)
    after = foresight.after_each(height_m, places)
    costs = [foresight.unexplained(places[:number]) for number in range(len(places) + 1)]
    return PushPlan(places, after, foresight.objective.values(after) + np.array(costs))


def _best(height_m: Array, foresight: PlaceForesight, reach: PlaceReach, rng: np.random.Generator) -> FloatArray | None:
    """The pellet [3] of all candidates with the lowest value; None where the goal lies nowhere far enough above."""
    places = place_candidates(height_m, foresight, reach, _CANDIDATES, rng)
    if len(places) == 0:
        return None
    values = foresight.values_after(height_m, places)
    for number in range(_ROUNDS):
        parents = places[np.argsort(values, kind="stable")[:PARENTS]]
        varied = parents[np.arange(_CANDIDATES) % len(parents)]
        spread_m = 0.5**number * 0.5 * foresight.model.radius_m(foresight.model.reference_m3)
        varied[:, :2] += spread_m * rng.normal(size=(len(varied), 2))
        varied[:, VOLUME] *= np.exp(0.5**number * _PEAKS * rng.normal(size=len(varied)))
        varied = reach.keep_within(varied)
        places = np.concatenate([places, varied])
        values = np.concatenate([values, foresight.values_after(height_m, varied)])
    return np.asarray(places[int(np.argmin(values))])


def place_candidates(
    height_m: Array, foresight: PlaceForesight, reach: PlaceReach, count: int, rng: np.random.Generator
) -> FloatArray:
    """Candidates [K, 3] on clay [H, W], in proportion to the square of what lacks; K is 0 where no pellet fits.

    Half of the volumes fill the height that lacks in the middle, the others are anything between the bounds: over a
    narrow ridge a pellet must be smaller than its height asks for.
    """
    objective, model = foresight.objective, foresight.model
    scale_px = max(0.5 * model.radius_m(reach.volume_m3[0]) * objective.pixels_per_m, 0.6)
    above = (objective.goal_m - height_m).astype(np.float64)
    lacking = np.asarray(cv2.GaussianBlur(above, (0, 0), scale_px), dtype=np.float64)
    lacking[lacking < _SHORTFALL * model.peak_m(reach.volume_m3[0])] = 0.0
    if count == 0 or not lacking.any():
        return np.zeros((0, 3))
    rows, columns = stratified_pixels(lacking**2, count, rng)
    places = np.zeros((count, 3))
    places[:, :2] = pixel_to_canvas(np.stack([columns, rows], axis=1), foresight.window_m, objective.pixels_per_m)
    places[:, :2] += rng.uniform(-0.5, 0.5, (count, 2)) / objective.pixels_per_m
    fitting = model.volume_of_peak(lacking[rows, columns] * np.exp(rng.normal(0.0, _PEAKS, count)))
    low, high = (math.log(volume) for volume in reach.volume_m3)
    anything = np.exp(rng.uniform(low, high, count))
    places[:, VOLUME] = np.where(rng.random(count) < 0.5, fitting, anything)
    return reach.keep_within(places)


def _refined(
    places: FloatArray, height_m: Array, foresight: PlaceForesight, reach: PlaceReach, config: SculptorConfig
) -> FloatArray:
    """Gradient descent on all pellets [K, 3]; never worse than the given ones. Volumes move by their logarithm."""
    rate_m = config.learning_rates.place_m
    moved: NDArray[Any] = _scaled(places, rate_m)
    adam = Adam([moved])
    best, minimum = places, np.inf
    iterations = _REFINING * config.iterations
    for iteration in range(iterations + 1):
        now = reach.keep_within(_unscaled(moved, rate_m))
        value, gradient = foresight.value_and_gradient(height_m, now)
        if value < minimum:
            best, minimum = now, value
        if iteration < iterations:
            unit = np.column_stack([np.full((len(now), 2), rate_m), _VOLUME_STEP * now[:, VOLUME]])
            adam.step([gradient * unit], [0.5 * (1 + np.cos(np.pi * iteration / iterations))])
            moved[:] = _scaled(reach.keep_within(_unscaled(moved, rate_m)), rate_m)
    return best


def _scaled(places: FloatArray, rate_m: float) -> FloatArray:
    """Places [K, 3] in units of Adam's steps."""
    volume = np.log(places[:, VOLUME:] / ball_m3(0.01)) / _VOLUME_STEP
    return np.concatenate([places[:, :2] / rate_m, volume], axis=1)


def _unscaled(moved: FloatArray, rate_m: float) -> FloatArray:
    volume = ball_m3(0.01) * np.exp(moved[:, VOLUME:] * _VOLUME_STEP)
    return np.concatenate([moved[:, :2] * rate_m, volume], axis=1)
