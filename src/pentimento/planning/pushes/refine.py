"""Improvement of one action by Gauss-Newton steps, or of a whole sequence of actions by gradient descent or the
cross-entropy method (thesis 7.3.5)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pentimento.planning.adam import Adam
from pentimento.planning.pushes.config import THETA, Reach, SculptorConfig
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


_DIFFERENCE = 1 / 8
"""Of finite differences, in ``Reach.spread``: about a millimetre, small beside a mark and large beside rounding."""
_DAMPING = (0.01, 0.3)
"""Levenberg-Marquardt damping of the alternative steps."""
_ENOUGH = 1e-4
"""An iteration that lowers the value by less than this share is the last."""
_RANK = 1e-9
"""Curvatures below this share of the largest count as none: an action of fixed length has none along its length."""


def newton(
    action: FloatArray,
    value: float,
    states_m: Array,
    foresight: EnsembleRollout,
    *,
    reach: Reach,
    iterations: int,
) -> tuple[FloatArray, float]:
    """Gauss-Newton steps of an action [5] with this value on the members' clay [M, H, W], within reach.

    The clay objective is quadratic in the clay, so the derivatives of the mean clay by the action give its slope and
    its curvature. They are finite differences, which one batch of predictions gives. No step is longer than
    ``Reach.spread`` in any coordinate.

    Returns:
        The action with the lowest value, the given one where no step lowers it, and that value.
    """
    objective, spread = foresight.objective, reach.spread()
    for _ in range(iterations):
        near = _neighbours(action, _DIFFERENCE * spread, reach)
        moves = _from(action, near)
        after, *others = foresight.means_after(states_m, np.concatenate([action[None], near])).astype(np.float64)
        changes = np.stack(others) - after
        gradient = objective(after)[1]
        curved = np.stack([objective(after + change)[1] - gradient for change in changes])
        slope = np.tensordot(changes, gradient, axes=2)
        curvature = np.tensordot(changes, curved, axes=([1, 2], [1, 2]))
        steps = []
        for damping in _DAMPING:
            damped = curvature + damping * np.diag(np.diag(curvature))
            step = np.linalg.lstsq(damped, -slope, rcond=_RANK)[0] @ moves
            steps.append(step / max(1.0, float(np.max(np.abs(step) / np.where(spread > 0, spread, 1.0)))))
        tried = reach.keep_within(action + np.array(steps))
        values = foresight.values_after(states_m, tried)
        best = int(np.argmin(values))
        gain = value - float(values[best])
        if gain > 0:
            action, value = tried[best], float(values[best])
        if gain < _ENOUGH * value:
            break
    return action, value


def _neighbours(action: FloatArray, difference: FloatArray, reach: Reach) -> FloatArray:
    """Five actions [5, 5], each moved up in one coordinate, or down where the bounds leave little room above."""
    up, down = (reach.keep_within(action + sign * np.diag(difference)) for sign in (1, -1))
    room = [np.abs(np.diag(_from(action, side))) for side in (up, down)]
    return np.where((room[0] >= room[1] / 2)[:, None], up, down)


def _from(action: FloatArray, others: FloatArray) -> FloatArray:
    """What others [K, 5] differ by from an action [5]; headings by the shorter turn."""
    moves = others - action
    moves[:, THETA] = np.remainder(moves[:, THETA] + np.pi, 2 * np.pi) - np.pi
    return moves


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
