"""Improvement of a whole sequence of actions: gradient descent, or the cross-entropy method (thesis 7.3.5)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pentimento.planning.adam import Adam
from pentimento.planning.pushes.config import Reach, SculptorConfig
from pentimento.planning.pushes.rollout import EnsembleRollout

Array = NDArray[np.float32]
FloatArray = NDArray[np.float64]


def descend(
    actions: FloatArray, height_m: Array, foresight: EnsembleRollout, *, reach: Reach, config: SculptorConfig
) -> tuple[FloatArray, float]:
    """Gradient descent on the value of actions [N, 5] on clay [H, W], within reach.

    Returns:
        The actions with the lowest value of all iterations, so never worse than the given ones, and that value.
    """
    rates = config.learning_rates
    own = np.array([rates.place_m, rates.place_m, rates.theta_rad, rates.length_m, rates.depth_m])
    moved = actions / own  # in units of the learning rates
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


_SHARE = 0.15
"""Standard deviation of the first iteration, as a share of each column's range (of an angle: of half a turn)."""
_MEMORY = 0.5
"""Share of the last mean and deviation that is kept. Without it, a small elite would shrink the deviation too soon."""


def cross_entropy(
    actions: FloatArray,
    height_m: Array,
    foresight: EnsembleRollout,
    *,
    reach: Reach,
    config: SculptorConfig,
    rng: np.random.Generator,
) -> tuple[FloatArray, float]:
    """The cross-entropy method (Rubinstein 1999), for models without gradients.

    Each iteration samples ``samples`` sequences from independent normal distributions and fits these to the best
    ``elite`` of them.

    Returns:
        The best sequence [N, 5] of all samples and the given one, and its value.
    """
    x_min, y_min, x_max, y_max = reach.window_m
    ranges = [x_max - x_min, y_max - y_min, np.pi, np.ptp(reach.length_m), np.ptp(reach.depth_m)]
    mean, deviation = actions, np.tile(_SHARE * np.array(ranges), (len(actions), 1))
    best, minimum = actions, foresight.value_after_all(height_m, actions)
    kept = max(round(config.elite_share * config.samples), 2)
    for _ in range(config.iterations):
        noise = rng.normal(size=(config.samples, *actions.shape))
        drawn = np.stack([reach.keep_within(mean + deviation * sample) for sample in noise])
        values = np.array([foresight.value_after_all(height_m, sample) for sample in drawn])
        order = np.argsort(values, kind="stable")
        if values[order[0]] < minimum:
            best, minimum = drawn[order[0]], float(values[order[0]])
        elite = drawn[order[:kept]]
        # Headings wrap at ±π: unwrap each elite's heading to the turn nearest to the mean's.
        elite[..., 2] = mean[:, 2] + np.remainder(elite[..., 2] - mean[:, 2] + np.pi, 2 * np.pi) - np.pi
        mean = _MEMORY * mean + (1 - _MEMORY) * elite.mean(axis=0)
        deviation = _MEMORY * deviation + (1 - _MEMORY) * elite.std(axis=0)
    return best, minimum
