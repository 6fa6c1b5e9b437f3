"""Gradient descent through a sequence of actions (thesis 7.3.5)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pentimento.planning.adam import Adam
from pentimento.planning.pushes.actions import Reach
from pentimento.planning.pushes.config import SculptorConfig
from pentimento.planning.pushes.rollout import Foresight

Array = NDArray[np.float32]
FloatArray = NDArray[np.float64]


def descend(
    actions: FloatArray, height_m: Array, foresight: Foresight, reach: Reach, config: SculptorConfig
) -> tuple[FloatArray, float]:
    """Actions [N, 5] moved down the value of what they make of clay [H, W], within reach, and that value.

    They are where the value was least on the way, so never worse than they were.
    """
    rates = config.rates
    own = np.array([rates.place_m, rates.place_m, rates.theta_rad, rates.length_m, rates.depth_m])
    moved = actions / own  # Adam steps each number by its own rate
    adam = Adam([moved])
    best, minimum = actions, np.inf
    for iteration in range(config.iterations + 1):
        now = moved * own
        value, gradient = foresight.value_and_gradient(height_m, now)
        if value < minimum:
            best, minimum = now, value
        if iteration < config.iterations:
            adam.step([gradient * own], [0.5 * (1 + np.cos(np.pi * iteration / config.iterations))])
            moved[:] = reach.keep_within(moved * own) / own
    return best, minimum
