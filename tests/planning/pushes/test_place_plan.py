"""Plans of pellets: where they are proposed, that they help, and their gradients."""

from dataclasses import replace

import numpy as np
import pytest

from pentimento.contracts.errors import ContractError
from pentimento.planning.objectives import ClayObjective, Weights
from pentimento.planning.pushes.goal import GoalError, raised_goal
from pentimento.planning.pushes.place_plan import (
    PlaceForesight,
    PlaceReach,
    place_candidates,
    place_reach_for,
    plan_places,
)
from pentimento.robots.tools import ball_m3, load_feeder
from tests.planning.pushes.clay import SIDE_PX, SURFACE_M, WINDOW_M, flat
from tests.planning.pushes.settings import CONFIG
from tests.planning.pushes.test_places import MODEL

REACH = PlaceReach((0.01, 0.01, 0.09, 0.09), (ball_m3(0.006), ball_m3(0.014)))
PLACES = np.array([[0.035, 0.04, ball_m3(0.01)], [0.06, 0.06, ball_m3(0.013)]])
SHAPE = (SIDE_PX, SIDE_PX)


def foresight(goal_m: np.ndarray, disagreement_weight: float = 1.0) -> PlaceForesight:
    return PlaceForesight(MODEL, ClayObjective(goal_m, WINDOW_M, Weights(1.0, 1.0)), WINDOW_M, disagreement_weight)


def raised() -> np.ndarray:
    return (flat() + MODEL.change(PLACES, SHAPE, WINDOW_M).sum(axis=0)).astype(np.float32)


def test_pellets_are_planned_where_the_goal_lies_above() -> None:
    found = plan_places(flat(), foresight(raised()), REACH, config=CONFIG, count=8, item=(0,))
    assert 1 <= len(found.actions) <= CONFIG.horizon
    assert found.values[-1] < 0.35 * found.values[0]
    assert np.all(np.diff(found.values) < 0)
    nearest = np.hypot(*(found.actions[:, None, :2] - PLACES[None, :, :2]).T).min(axis=0)
    assert nearest.max() < 0.01
    np.testing.assert_array_equal(REACH.keep_within(found.actions), found.actions)
    again = plan_places(flat(), foresight(raised()), REACH, config=CONFIG, count=8, item=(0,))
    np.testing.assert_array_equal(found.actions, again.actions)


@pytest.mark.parametrize("goal_m", [flat(), flat() - np.float32(0.003), flat() + np.float32(0.0004)])
def test_no_pellet_where_the_goal_is_at_or_below_or_hardly_above(goal_m: np.ndarray) -> None:
    assert len(place_candidates(flat(), foresight(goal_m), REACH, 20, np.random.default_rng(0))) == 0
    assert plan_places(flat(), foresight(goal_m), REACH, config=CONFIG, count=8, item=(0,)).actions.shape == (0, 3)


def test_what_the_model_leaves_counts_and_refuses_uncertain_pellets() -> None:
    sure, unsure = foresight(raised(), 0.0), foresight(raised(), 1.0)
    after = float(unsure.values_after(flat(), PLACES[:1])[0] - sure.values_after(flat(), PLACES[:1])[0])
    area_m2 = 0.01
    assert after == pytest.approx(1e6 * MODEL.unexplained * MODEL.energy_m4(PLACES[0, 2]) / area_m2)
    hopeless = foresight(raised(), 100.0)
    assert len(plan_places(flat(), hopeless, REACH, config=CONFIG, count=8, item=(0,)).actions) == 0


def test_gradients_are_those_of_finite_differences() -> None:
    rough = (flat() + np.random.default_rng(1).normal(0, 1e-4, SHAPE)).astype(np.float64)
    given = foresight(raised().astype(np.float64))
    places = PLACES * [1.03, 0.98, 1.1]
    value, gradient = given.value_and_gradient(rough, places)
    assert value == pytest.approx(given.objective.values(rough + MODEL.change(places, SHAPE, WINDOW_M).sum(axis=0))
                                  + given.unexplained(places))  # fmt: skip
    for row in range(2):
        for column, step in enumerate((1e-6, 1e-6, 1e-4 * PLACES[row, 2])):
            moved = []
            for sign in (1, -1):
                there = places.copy()
                there[row, column] += sign * step
                moved.append(given.value_and_gradient(rough, there)[0])
            assert gradient[row, column] == pytest.approx((moved[0] - moved[1]) / (2 * step), rel=1e-4)


def test_refined_pellets_are_better_than_the_chosen_ones() -> None:
    chosen = plan_places(flat(), foresight(raised()), REACH, config=replace(CONFIG, refine="none"), count=4, item=(0,))
    refined = plan_places(flat(), foresight(raised()), REACH, config=CONFIG, count=4, item=(0,))
    assert refined.values[-1] < chosen.values[-1]


def test_reach_is_what_feeder_and_model_share() -> None:
    feeder = load_feeder("pellets")
    reach = place_reach_for(feeder, MODEL, (0.2, 0.1), 0.002)
    edge_m = 0.5 * feeder.diameter_m[1]
    assert reach.window_m == pytest.approx((edge_m, edge_m, 0.2 - edge_m, 0.1 - edge_m))
    with pytest.raises(ContractError, match="fitted to the feeder syringe"):
        place_reach_for(feeder, replace(MODEL, feeder="syringe"), (0.2, 0.1), 0.01)
    with pytest.raises(ContractError, match="Fit it to this feeder's pellets"):
        place_reach_for(feeder, replace(MODEL, volume_m3=(1e-5, 2e-5)), (0.2, 0.1), 0.01)


def test_raised_goal_stands_on_the_mean_of_the_clay() -> None:
    relief = np.zeros(SHAPE)
    relief[20:28, 20:28] = 2.0
    fit = raised_goal(relief, flat(), raised_m=0.004, border_share=0.1)
    assert fit.height_m.max() == pytest.approx(SURFACE_M + 0.004) and fit.height_m.min() == pytest.approx(SURFACE_M)
    assert fit.material_share > 1
    for broken, height_m in ((np.zeros(SHAPE), 0.004), (relief, 0.0)):
        with pytest.raises(GoalError, match="needs a height above 0"):
            raised_goal(broken, flat(), raised_m=height_m, border_share=0.1)
