"""Plans of pushes: chosen greedily one by one, then improved together (thesis 7.3.5)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pentimento.planning.pushes.config import Reach, SculptorConfig
from pentimento.planning.pushes.initialise import best_action
from pentimento.planning.pushes.refine import cross_entropy, descend
from pentimento.planning.pushes.rollout import EnsembleRollout

Array = NDArray[np.float32]
FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class PushPlan:
    """Actions and their predicted effect."""

    actions: FloatArray
    """[N, 5] pushes, or [N, 3] placed pellets (``place_plan``), in the order of execution. N is 0 where no action
    lowers the value."""
    predicted_m: Array
    """[N + 1, H, W]: mean over the members of the clay before the first and after each action, metres."""
    values: FloatArray
    """[N + 1]: the value of each of these; see ``EnsembleRollout``."""


def plan(
    height_m: Array,
    foresight: EnsembleRollout,
    reach: Reach,
    *,
    config: SculptorConfig,
    count: int,
    item: tuple[int, ...],
    begun: FloatArray | None = None,
) -> PushPlan:
    """Up to ``count`` actions, at most the horizon, that bring clay [H, W] nearer to the goal.

    Args:
        item: what is planned, such as the goal's number and the number of executed actions. It seeds the random
            generator together with ``config.seed``.
        begun: [N, 5] actions of an earlier plan to continue from. Those that no longer help are removed.
    """
    rng = np.random.default_rng([config.seed, *item])
    wanted = min(count, config.horizon)
    actions = _helping(begun[:wanted], height_m, foresight, config=config) if begun is not None else np.zeros((0, 5))
    actions = _extended(actions, height_m, foresight, reach=reach, config=config, wanted=wanted, rng=rng)
    if len(actions) > 0 and config.iterations > 0:
        if config.refine == "gradient":
            actions, _ = descend(actions, height_m, foresight, reach=reach, config=config)
        elif config.refine == "cross_entropy":
            actions, _ = cross_entropy(actions, height_m, foresight, reach=reach, config=config, rng=rng)
    return predicted(actions, height_m, foresight)


def predicted(actions: FloatArray, height_m: Array, foresight: EnsembleRollout) -> PushPlan:
    """The predicted effect of actions [N, 5] on clay [H, W]."""
    states = foresight.start(height_m)
    means, values = [states.mean(axis=0)], [foresight.value(states)]
    for action in actions:
        states, foresight = foresight.step(states, action)
        means.append(states.mean(axis=0))
        values.append(foresight.value(states))
    return PushPlan(actions, np.stack(means), np.array(values))


def _extended(
    actions: FloatArray,
    height_m: Array,
    foresight: EnsembleRollout,
    *,
    reach: Reach,
    config: SculptorConfig,
    wanted: int,
    rng: np.random.Generator,
) -> FloatArray:
    """The actions, followed by greedily chosen ones while these help."""
    states, foresight = foresight.after_all(height_m, actions)
    value = foresight.value(states)
    while len(actions) < wanted:
        action, lower = best_action(states, foresight, reach, config=config, rng=rng)
        if not helps(value, lower, config):
            break
        actions = np.concatenate([actions, action[None]])
        (states, foresight), value = foresight.step(states, action), lower
    return actions


def _helping(actions: FloatArray, height_m: Array, foresight: EnsembleRollout, *, config: SculptorConfig) -> FloatArray:
    """The actions that lower the value, each tried on the clay that the kept ones before it leave."""
    states = foresight.start(height_m)
    value, kept = foresight.value(states), []
    for action in actions:
        after, following = foresight.step(states, action)
        lower = following.value(after)
        if helps(value, lower, config):
            states, value, foresight = after, lower, following
            kept.append(action)
    return np.stack(kept) if kept else np.zeros((0, 5))


def helps(value: float, lower: float, config: SculptorConfig) -> bool:
    """Whether an action that brings the value to ``lower`` is worth it."""
    return lower < value * (1 - config.min_relative_gain)
