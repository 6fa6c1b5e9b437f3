"""Gauss-Newton steps of one action."""

from dataclasses import replace

import numpy as np
import pytest

from pentimento.planning.objectives import ClayObjective, Weights
from pentimento.planning.pushes.config import Reach
from pentimento.planning.pushes.initialise import best_action
from pentimento.planning.pushes.memory import FRESH, PushMemory
from pentimento.planning.pushes.refine import newton
from pentimento.planning.pushes.rollout import EnsembleRollout
from tests.planning.pushes.clay import WINDOW_M, PressedClay, flat
from tests.planning.pushes.settings import CONFIG, REACH

MADE = np.array([0.04, 0.045, 0.5, 0.022, 0.005])


def towards(goal: np.ndarray, *members: object) -> EnsembleRollout:
    objective = ClayObjective(goal, WINDOW_M, Weights(1.0, 1.0))
    return EnsembleRollout(members or (PressedClay(),), objective, disagreement_weight=0.0)  # type: ignore[arg-type]


def refined(action: np.ndarray, foresight: EnsembleRollout, iterations: int, reach: Reach = REACH):
    states = foresight.start(flat())
    value = float(foresight.values_after(states, action[None])[0])
    found, lower = newton(action, value, states, foresight, reach=reach, iterations=iterations)
    assert lower <= value
    assert lower == pytest.approx(float(foresight.values_after(states, found[None])[0]), abs=1e-12)
    return found, lower / value


class Linear(PressedClay):
    """Clay whose change is linear in the action's place, length and depth, and does not depend on its heading."""

    patterns = np.random.default_rng(0).normal(size=(4, *flat().shape))

    def after(self, height_m: np.ndarray, actions: np.ndarray, memory: PushMemory = FRESH) -> np.ndarray:
        change = np.tensordot(actions[:, [0, 1, 3, 4]], self.patterns, axes=1)
        return (height_m + change).astype(np.float32)


def test_steps_solve_a_linear_least_squares_problem() -> None:
    """Of a linear model the remaining error falls by the square of the damping, a hundredth, with each step."""
    wide = replace(REACH, width_m=1.0, length_m=(0.0, 0.03), depth_m=(0.0, 0.03))
    model = Linear()
    best = np.array([0.05, 0.045, 0.3, 0.02, 0.015])
    off = best + np.array([0.004, -0.006, 0.2, -0.003, 0.002])
    foresight = towards(model.after(flat(), best[None])[0], model)
    for iterations in (1, 2):
        found, left = refined(off, foresight, iterations, wide)
        assert left < 1.1e-4**iterations
    np.testing.assert_allclose(found[[0, 1, 3, 4]], best[[0, 1, 3, 4]], atol=1e-5)
    assert found[2] == pytest.approx(off[2])


def test_a_displaced_push_returns_to_the_one_that_made_the_goal() -> None:
    foresight = towards(PressedClay().after(flat(), MADE[None])[0])
    found, left = refined(MADE + np.array([0.002, -0.002, 0.2, -0.003, -0.001]), foresight, 6)
    assert left < 0.01
    assert (np.abs(found - MADE) < [5e-4, 5e-4, 0.06, 1e-3, 3e-4]).all()


def test_headings_take_the_shorter_turn() -> None:
    made = np.array([0.06, 0.05, -np.pi + 0.1, 0.025, 0.006])
    foresight = towards(PressedClay().after(flat(), made[None])[0])
    found, left = refined(made + np.array([0, 0, 2 * np.pi - 0.3, 0, 0]), foresight, 4)
    assert left < 0.02
    assert np.cos(found[2] - made[2]) > np.cos(0.05)


@pytest.mark.parametrize("seed", range(4))
def test_actions_at_their_bounds_stay_within(seed: int) -> None:
    corner = REACH.keep_within(REACH.draw(1, np.random.default_rng(seed)) + np.array([1, -1, 0, 1, 1]))[0]
    foresight = towards(PressedClay().after(flat(), MADE[None])[0])
    found, _ = refined(corner, foresight, 3)
    np.testing.assert_allclose(found, REACH.keep_within(found[None])[0])


def test_a_coordinate_without_range_is_kept() -> None:
    fixed = replace(REACH, length_m=(0.02, 0.02))
    off = MADE + np.array([0.003, 0.002, 0.1, -0.002, -0.002])
    found, left = refined(off, towards(PressedClay().after(flat(), MADE[None])[0]), 3, fixed)
    assert found[3] == 0.02 and left < 0.3


def test_the_best_action_of_two_members_is_refined_on_both() -> None:
    foresight = towards(PressedClay().after(flat(), MADE[None])[0], PressedClay(), PressedClay(strength=0.7))
    states = foresight.start(flat())
    config = replace(CONFIG, screened=4, candidates=8)
    values = [
        best_action(states, foresight, REACH, config=each, rng=np.random.default_rng(0))[1]
        for each in (replace(config, refine="none"), replace(config, refine="newton"))
    ]
    assert values[1] < 0.9 * values[0]
