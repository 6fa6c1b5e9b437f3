"""The best push of all places is the one that a search through all places finds."""

from dataclasses import replace

import numpy as np
import pytest

from pentimento.contracts.frames import pixel_to_canvas
from pentimento.planning.objectives import ClayObjective, Weights
from pentimento.planning.pushes.config import Reach, ends
from pentimento.planning.pushes.rollout import EnsembleRollout
from pentimento.planning.pushes.screening import best_of_all_places
from tests.planning.pushes.clay import SIDE_PX, WINDOW_M, PressedClay, flat
from tests.planning.pushes.settings import REACH

SCALE = SIDE_PX / 0.1
MODEL = PressedClay(kept=0.3)
ONE = replace(REACH, length_m=(0.02, 0.02), depth_m=(0.004, 0.004))
"""All pushes are equally long and deep."""


def towards(goal: np.ndarray) -> EnsembleRollout:
    return EnsembleRollout([MODEL], ClayObjective(goal, WINDOW_M, Weights(1.0, 4.0)), disagreement_weight=0.0)


def at(column: int, row: int, theta: float = 0.0) -> np.ndarray:
    return np.array([*pixel_to_canvas((column, row), WINDOW_M, SCALE), theta, 0.02, 0.004])


def after(*actions: np.ndarray) -> np.ndarray:
    return towards(flat()).roll_out(flat(), np.stack(actions))[0]


@pytest.mark.parametrize(("column", "row", "theta"), [(15, 20, 0.0), (30, 32, np.pi / 2), (25, 30, -3 * np.pi / 4)])
def test_the_push_that_made_the_goal_is_found(column: int, row: int, theta: float) -> None:
    made = at(column, row, theta)
    (found,) = best_of_all_places(flat(), towards(after(made)), ONE, 1)
    np.testing.assert_allclose(found, made, atol=1e-9)


def test_no_push_of_any_place_is_better() -> None:
    """Every heading at every pixel of a small reach, on a goal that no single push makes."""
    reach = replace(ONE, window_m=(0.03, 0.035, 0.065, 0.06))
    foresight = towards(after(at(17, 20, 0.7), at(22, 27, -2.0)))
    (found,) = best_of_all_places(flat(), foresight, reach, 1)
    turns = 2 * np.pi * np.arange(16) / 16 - np.pi
    every = np.array([at(c, r, theta) for c in range(SIDE_PX) for r in range(SIDE_PX) for theta in turns])
    within = every[(np.abs(every - reach.keep_within(every)) < 1e-9).all(axis=1)]
    assert len(within) > 200
    values = foresight.values_after(foresight.start(flat()), within)
    best = float(foresight.values_after(foresight.start(flat()), found[None])[0])
    assert best <= values.min() + 0.01 * np.ptp(values)  # a change moves with a push, but for the pixels that it meets


def test_pushes_move_with_the_goal() -> None:
    first, second = (
        best_of_all_places(flat(), towards(np.roll(after(at(18, 22, 0.3)), shift, axis=(0, 1))), REACH, 5)
        for shift in ((0, 0), (3, 5))
    )
    moved = second - first
    np.testing.assert_allclose(moved, np.tile([5 / SCALE, -3 / SCALE, 0, 0, 0], (5, 1)), atol=1e-9)


def test_pushes_keep_within_reach_and_differ() -> None:
    rng = np.random.default_rng(0)
    goal = flat() - 0.003 * (rng.random(flat().shape) > 0.7).astype(np.float32)
    found = best_of_all_places(flat(), towards(goal), REACH, 20)
    np.testing.assert_allclose(found, REACH.keep_within(found))
    stops = ends(found)
    assert (stops >= 0.01 - 1e-9).all() and (stops <= 0.09 + 1e-9).all()
    assert len(np.unique(found, axis=0)) == 20


def test_pinches_start_anywhere_within_reach() -> None:
    """A pinch does not travel, so its closing takes nothing from its reach."""
    pinches = replace(REACH, travels=False, length_m=(0.05, 0.05), window_m=(0.045, 0.045, 0.055, 0.055))
    found = best_of_all_places(flat(), towards(after(at(20, 24))), pinches, 4)
    assert len(found) == 4
    np.testing.assert_allclose(found, pinches.keep_within(found))


def test_a_reach_without_a_pixel_has_no_push() -> None:
    between = Reach((0.0501, 0.0501, 0.0502, 0.0502), (0.0, 0.0), (0.001, 0.008), width_m=0.012, travels=True)
    assert best_of_all_places(flat(), towards(after(at(20, 24))), between, 4).shape == (0, 5)
