"""Sculpting towards a goal: guard, rows, replanning, and stopping where acting does not help."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from pentimento.contracts.errors import EnvelopeViolation
from pentimento.contracts.observations import Scan
from pentimento.contracts.pushes import CONTRACT
from pentimento.contracts.tables import read_table, write_table
from pentimento.control.execute import Session
from pentimento.control.push_safety import GuardedSculptingRobot, push_envelope_for
from pentimento.control.sculpting_settings import Execution
from pentimento.control.sculptor import Sculpture, reach_for, sculpt, seen_m
from pentimento.planning.pushes.config import SculptorConfig
from pentimento.robots.driver import Push
from pentimento.robots.tools import EndEffector, load_end_effector
from tests.planning.pushes.clay import SIDE_PX, WINDOW_M, PressedClay, flat
from tests.planning.pushes.settings import CONFIG

BALL = load_end_effector("ball")
SHAPE = (SIDE_PX, SIDE_PX)
PUSHES = np.array([[0.03, 0.03, 0.5, 0.025, 0.006], [0.07, 0.06, 2.5, 0.02, 0.005]])


@dataclass
class PaperRobot:
    """A robot whose clay is the tests' model; ``strength`` scales its pushes relative to the model."""

    strength: float = 1.0
    clock_s: float = 0.0
    area_m: tuple[float, float] = (0.1, 0.1)
    finer: int = 1
    """Pixels of a scan for each of the model's, along a side."""

    def __post_init__(self) -> None:
        self.height_m = flat().repeat(self.finer, 0).repeat(self.finer, 1)

    def change_tool(self, end_effector: EndEffector) -> None: ...

    def push(self, push: Push) -> np.ndarray:
        self.clock_s += 5.0
        self.height_m = PressedClay(strength=self.strength).after(self.height_m, push.action[None])[0]
        return np.full((2, 5), np.nan)

    def scan(self) -> Scan:
        heights = self.height_m.astype(np.float64)
        heights[5, 7] = np.nan
        return Scan(heights, WINDOW_M, np.zeros(3), "paper", self.clock_s)

    def smooth(self) -> None: ...

    def ambient(self) -> dict[str, float]:
        return {}

    def wait(self, seconds: float) -> None: ...


def reachable_goal(finer: int = 1) -> np.ndarray:
    height = flat().repeat(finer, 0).repeat(finer, 1)
    for push in PUSHES:
        height = PressedClay().after(height, push[None])[0]
    return height


def sculpted(robot: PaperRobot, config: SculptorConfig = CONFIG, count: int = 4, **changes: object) -> Sculpture:
    execution = replace(Execution(replan_every=2, patience=4, dwell_s=0.5, retract_speed_m_s=0.05), **changes)  # type: ignore[arg-type]
    guarded = GuardedSculptingRobot(robot, push_envelope_for(BALL, robot.area_m))
    return sculpt(
        guarded, BALL, "paper", goal_m=reachable_goal(robot.finer), members=[PressedClay()], grid=SHAPE, config=config,
        execution=execution, count=count, session=Session("test", 0.0), item=3, log=lambda *_: None,
    )  # fmt: skip


def test_sculpting_reduces_the_objective_as_predicted() -> None:
    result = sculpted(PaperRobot())
    assert result.helped and result.values[-1] < 0.3 * result.values[0]
    # The robot equals the model; only the filled hole differs.
    np.testing.assert_allclose(result.heights_m[1:], result.predicted_m, atol=2e-4)


def test_finer_scans_are_sculpted_on_the_model_s_grid_and_compared_on_their_own() -> None:
    result = sculpted(PaperRobot(finer=4))
    assert result.heights_m.shape[1:] == result.predicted_m.shape[1:] == (4 * SIDE_PX, 4 * SIDE_PX)
    assert result.values[-1] < 0.3 * result.values[0]
    off_m = result.heights_m[1:] - result.predicted_m
    assert np.sqrt(np.square(off_m).mean()) < 5e-5  # of pushes 6 mm deep, whose dents the model's grid rounds


def test_sculpting_rows_satisfy_the_pushes_contract(tmp_path: Path) -> None:
    result = sculpted(PaperRobot())
    write_table(tmp_path / "pushes", pa.Table.from_pylist(result.rows), CONTRACT, "Sculpted.")
    read = read_table(tmp_path / "pushes", CONTRACT)
    assert read.table.num_rows == len(result.actions) and not read.quarantined
    assert [row["order"] for row in result.rows] == [3000 + i for i in range(len(result.actions))]
    np.testing.assert_allclose(np.array([row["action"] for row in result.rows]), result.actions)
    assert result.holes == len(result.actions) + 1


def test_sculpting_at_the_goal_executes_no_action() -> None:
    robot = PaperRobot()
    robot.height_m = reachable_goal()
    result = sculpted(robot)
    assert len(result.actions) == 0 and result.stopped == "the models know of no action that helps"
    assert result.values[-1] == result.values[0] and not result.helped


def test_sculpting_stops_when_a_wrong_model_makes_it_worse() -> None:
    """Each push goes four times as deep as the model predicts, so that every push increases the error."""
    result = sculpted(PaperRobot(strength=4.0), count=40, patience=2)
    assert len(result.actions) <= 6
    assert result.stopped == "acting no longer helped"


def test_sculpting_is_deterministic() -> None:
    np.testing.assert_array_equal(sculpted(PaperRobot()).actions, sculpted(PaperRobot()).actions)


def test_sculpting_push_outside_the_envelope_is_refused() -> None:
    robot = PaperRobot()
    narrow = replace(push_envelope_for(BALL, robot.area_m), x_max_m=0.02, y_max_m=0.02)
    with pytest.raises(EnvelopeViolation, match="off the slab"):
        sculpt(
            GuardedSculptingRobot(robot, narrow), BALL, "paper", goal_m=reachable_goal(),
            members=[PressedClay()], grid=SHAPE, config=CONFIG, execution=Execution(2, 4, 0.5, 0.05), count=4,
            session=Session("test", 0.0), item=0, log=lambda *_: None,
        )  # fmt: skip
    np.testing.assert_array_equal(robot.height_m, flat())


def test_reach_follows_the_end_effector() -> None:
    reach = reach_for(BALL, (0.2, 0.1), 0.01)
    assert reach.window_m == pytest.approx((0.01, 0.01, 0.19, 0.09))
    assert (reach.length_m, reach.depth_m, reach.travels) == (BALL.travel_m, BALL.depth_m, True)
    assert not reach_for(load_end_effector("gripper"), (0.2, 0.2), 0.01).travels


def test_seen_heights_are_levelled_and_filled() -> None:
    x = np.tile((np.arange(20) + 0.5) * 0.01, (20, 1))
    tilted = 0.04 + 0.1 * x + 0.002
    tilted[4, 4] = np.nan
    height, holes = seen_m(Scan(tilted, np.array([0, 0, 0.2, 0.2]), np.array([0.1, 0.0, 0.002]), "s", 0.0))
    np.testing.assert_allclose(height, 0.04, atol=1e-6)
    assert holes == 1
