"""What is said of a goal that was met, half met, or missed."""

import numpy as np
import pytest

from pentimento.goals3d.measures import met
from pentimento.planning.objectives import ClayObjective, Weights

GOAL = np.random.default_rng(0).normal(0.04, 1e-3, (20, 20)).astype(np.float32)
OBJECTIVE = ClayObjective(GOAL, (0.0, 0.0, 0.02, 0.02), Weights(1.0, 1.0))
START = np.full((20, 20), 0.04, np.float32)


def test_a_goal_that_was_met_has_no_error_left() -> None:
    said = met(OBJECTIVE, np.stack([START, GOAL]), GOAL)
    for name in ("error_3d_mm2", "visual_error"):
        assert said[name]["before"] > 0 and said[name]["after"] == said[name]["planned"] == 0
        assert said[name]["removed"] == 1


def test_halfway_there_a_quarter_of_the_squared_error_is_left() -> None:
    said = met(OBJECTIVE, np.stack([START, (START + GOAL) / 2]), START)
    assert said["error_3d_mm2"]["removed"] == pytest.approx(0.75, rel=1e-4)
    assert said["error_3d_mm2"]["planned"] == said["error_3d_mm2"]["before"]


def test_what_made_it_worse_is_said_and_the_best_on_the_way_too() -> None:
    worse = 2 * START - GOAL + np.float32(0.001)
    said = met(OBJECTIVE, np.stack([START, (START + GOAL) / 2, worse]), START)["error_3d_mm2"]
    assert said["removed"] < 0 and said["minimum"] < said["before"] < said["after"]
