"""A push model as the planner's seam: batches, steps and gradients agree with each other."""

import numpy as np
import pytest

from pentimento.dynamics.pushes.planned import planned_clay, planned_members
from pentimento.planning.pushes.rollout import PushModel
from tests.dynamics.pushes.conftest import Trained

WINDOW = np.array([0.0, 0.0, 0.12, 0.12])
ACTION = np.array([0.05, 0.055, 0.4, 0.02, 0.006])


def height() -> np.ndarray:
    rng = np.random.default_rng(0)
    return (0.04 + 2e-4 * rng.standard_normal((60, 60))).astype(np.float32)


def test_alternatives_are_what_each_step_gives(trained: Trained) -> None:
    clay: PushModel = planned_clay(trained.model, WINDOW)
    actions = np.stack([ACTION, ACTION + np.array([0.01, 0.0, 1.0, 0.0, -0.002])])
    both = clay.after(height(), actions)
    assert both.shape == (2, 60, 60)
    assert both.dtype == np.float32
    for number in range(2):
        np.testing.assert_allclose(both[number], clay.step(height(), actions[number])[0], atol=1e-7)
    assert clay.after(height(), np.empty((0, 5))).shape == (0, 60, 60)
    assert clay.end_effector == "ball"


def test_the_way_back_agrees_with_finite_differences(trained: Trained) -> None:
    clay = planned_clay(trained.model, WINDOW)
    # Upon noise, the median from which a depth counts moves otherwise than the mean that gives its gradient.
    row, column = np.mgrid[:60, :60]
    smooth = (0.04 + 1e-3 * np.sin(row / 12 + column / 17)).astype(np.float32)
    weights = (np.sin(np.arange(60) / 9)[:, None] * np.cos(np.arange(60) / 7)).astype(np.float32)

    def value(height_m: np.ndarray, action: np.ndarray) -> float:
        return float((clay.step(height_m, action)[0].astype(np.float64) * weights).sum())

    to_height, to_action = clay.step(smooth, ACTION)[1](weights)
    for index, small in enumerate([5e-5, 5e-5, 1e-3, 2e-5, 2e-5]):
        moved = small * np.eye(5)[index]
        slope = (value(smooth, ACTION + moved) - value(smooth, ACTION - moved)) / (2 * small)
        # Bilinear sampling has kinks between pixels, which the start's place crosses.
        assert to_action[index] == pytest.approx(slope, rel=0.02, abs=0.05 if index < 2 else 1e-3)
    # At the end of the travel: nearer to the start it would move the median.
    down, across = (np.arange(60) - 27)[:, None], np.arange(60) - 35
    bump = 1e-4 * np.exp(-(down**2 + across**2) / 12).astype(np.float32)
    slope = value(smooth + bump, ACTION) - value(smooth - bump, ACTION)
    assert 2 * float((to_height * bump).sum()) == pytest.approx(slope, rel=0.05, abs=2e-6)


def test_the_mean_of_the_members_is_the_model(trained: Trained) -> None:
    whole = planned_clay(trained.model, WINDOW).after(height(), ACTION[None])
    members = [clay.after(height(), ACTION[None]) for clay in planned_members(trained.model, WINDOW)]
    assert len(members) == 2
    np.testing.assert_allclose(np.mean(members, axis=0), whole, atol=1e-7)
    assert np.abs(members[0] - members[1]).max() > 1e-6
