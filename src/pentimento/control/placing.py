"""Placing pellets while sculpting: the choice between pushes and pellets, and mixed actions as arrays.

A push is float64[5] of the ``pushes`` contract, a pellet float64[3] x_m, y_m, volume_m3 (``planning.pushes.places``).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.frames import Window
from pentimento.planning.objectives import ClayObjective
from pentimento.planning.pushes.config import SculptorConfig
from pentimento.planning.pushes.place_plan import PlaceForesight, place_reach_for, plan_places
from pentimento.planning.pushes.places import PlaceModel
from pentimento.planning.pushes.plan import PushPlan
from pentimento.robots.tools import Feeder

Array = NDArray[np.float32]
FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Placer:
    """A feeder and the model of its pellets."""

    feeder: Feeder
    model: PlaceModel

    def plan(
        self,
        height_m: Array,
        objective: ClayObjective,
        window_m: Window,
        *,
        area_m: tuple[float, float],
        config: SculptorConfig,
        count: int,
        item: tuple[int, ...],
    ) -> PushPlan:
        """A plan of pellets; see ``place_plan.plan_places``.

        Raises:
            ContractError: the model does not fit the feeder.
        """
        foresight = PlaceForesight(self.model, objective, window_m, config.disagreement_weight)
        reach = place_reach_for(self.feeder, self.model, area_m, config.edge_m)
        return plan_places(height_m, foresight, reach, config=config, count=count, item=item)


def better_plan(pushes: PushPlan, places: PushPlan, executed: int) -> PushPlan:
    """The plan with the lower predicted value after the actions that are executed before the next one.

    Of a shorter plan all actions count. Pushes are taken where both are equal, so also where neither helps.
    """
    value, other = (float(each.values[min(executed, len(each.actions))]) for each in (pushes, places))
    return places if other < value else pushes


def is_place(action: FloatArray) -> bool:
    """Whether an action is a pellet and not a push."""
    return action.shape == (3,)


def as_columns(actions: Sequence[FloatArray]) -> tuple[FloatArray, FloatArray]:
    """Mixed actions as the contract's ``action`` [N, 5] and ``volume_m3`` [N], which is NaN of a push."""
    rows, volumes = np.zeros((len(actions), 5)), np.full(len(actions), np.nan)
    for number, action in enumerate(actions):
        if is_place(action):
            rows[number, :2], volumes[number] = action[:2], action[2]
        else:
            rows[number] = action
    return rows, volumes


def from_columns(rows: FloatArray, volumes_m3: FloatArray) -> tuple[FloatArray, ...]:
    """The inverse of ``as_columns``."""
    return tuple(
        row if np.isnan(volume) else np.array([*row[:2], volume]) for row, volume in zip(rows, volumes_m3, strict=True)
    )
