"""Sculpting with pellets: the choice of plans, the executed actions, their rows and their checkpoint."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from pentimento.contracts.pushes import CONTRACT
from pentimento.contracts.schema import arrow_schema
from pentimento.contracts.tables import read_table, write_table
from pentimento.control.checkpoint import SculptureState, load_sculpture, save_sculpture
from pentimento.control.execute import Session
from pentimento.control.place_safety import place_envelope_for
from pentimento.control.placing import Placer, as_columns, better_plan, from_columns
from pentimento.control.push_safety import GuardedSculptingRobot, push_envelope_for
from pentimento.control.sculpting_settings import Execution
from pentimento.control.sculptor import Sculptor, Sculpture, sculpt
from pentimento.dynamics.pushes.measured import load_pushes
from pentimento.planning.pushes.plan import PushPlan
from pentimento.robots.driver import Place
from pentimento.robots.tools import load_feeder
from tests.control.test_sculptor import BALL, PaperRobot, reachable_goal
from tests.planning.pushes.clay import WINDOW_M, PressedClay, flat
from tests.planning.pushes.settings import CONFIG
from tests.planning.pushes.test_place_plan import raised
from tests.planning.pushes.test_places import MODEL

PLACER = Placer(load_feeder("pellets"), MODEL)
EXECUTION = Execution(replan_every=2, patience=4, dwell_s=0.5, retract_speed_m_s=0.05)


class PaperFeeder(PaperRobot):
    """A robot whose pellets are the model's."""

    def place(self, place: Place) -> None:
        self.clock_s += 10.0
        action = np.array([[place.x_m, place.y_m, place.volume_m3]])
        self.height_m = self.height_m + MODEL.change(action, self.height_m.shape, WINDOW_M)[0].astype(np.float32)


def guarded(robot: PaperRobot) -> GuardedSculptingRobot:
    limits = push_envelope_for(BALL, robot.area_m), place_envelope_for(PLACER.feeder, robot.area_m)
    return GuardedSculptingRobot(robot, *limits)


def sculpted(goal_m: np.ndarray, placer: Placer | None = PLACER) -> Sculpture:
    return sculpt(
        guarded(PaperFeeder()), BALL, "paper", goal_m=goal_m, members=[PressedClay()], grid=goal_m.shape, config=CONFIG,
        execution=EXECUTION, count=6, session=Session("test", 0.0), item=0, log=lambda *_: None, placer=placer,
    )  # fmt: skip


def mixed_goal() -> np.ndarray:
    """Two pellets, and a groove beside them."""
    push = np.array([0.025, 0.075, 0.0, 0.02, 0.006])
    return PressedClay(kept=0.0).after(raised(), push[None])[0]


def test_goal_above_the_surface_is_reached_by_pellets_and_not_by_pushes() -> None:
    with_pellets, alone = sculpted(raised()), sculpted(raised(), None)
    assert with_pellets.values[-1] < 0.4 * with_pellets.values[0]
    assert alone.values[-1] > 0.9 * alone.values[0]
    assert np.isfinite(with_pellets.volumes_m3).any() and len(with_pellets.pushes) < len(with_pellets.actions)
    assert np.isnan(alone.volumes_m3).all() and len(alone.pushes) == len(alone.actions)


def test_goal_below_the_surface_is_reached_by_the_same_pushes() -> None:
    with_pellets, alone = sculpted(reachable_goal()), sculpted(reachable_goal(), None)
    np.testing.assert_array_equal(with_pellets.actions, alone.actions)
    np.testing.assert_array_equal(with_pellets.heights_m, alone.heights_m)


def test_rows_of_pushes_and_pellets_satisfy_the_contract(tmp_path: Path) -> None:
    made = sculpted(mixed_goal())
    assert 0 < len(made.pushes) < len(made.actions)
    names = {name for row in made.rows for name in row}
    table = pa.Table.from_pylist(made.rows, schema=arrow_schema(CONTRACT, include_optional=names))
    write_table(tmp_path / "pushes", table, CONTRACT, "Sculpted.")
    read = read_table(tmp_path / "pushes", CONTRACT)
    assert not read.quarantined and read.table.num_rows == len(made.actions)
    kinds = np.array(read.table["kind"].to_pylist())
    np.testing.assert_array_equal(kinds == "place", np.isfinite(made.volumes_m3))
    samples, _ = load_pushes(read.table)  # who learns pushes sees no pellet
    np.testing.assert_allclose(samples.action, made.pushes, atol=1e-6)
    assert "volume_m3" not in samples.covariates


def test_checkpoint_keeps_mixed_actions(tmp_path: Path) -> None:
    goal = mixed_goal()
    sculptor = Sculptor(
        robot=guarded(PaperFeeder()), end_effector=BALL, material="paper", goal_m=goal, members=[PressedClay()],
        grid=goal.shape, config=CONFIG, execution=EXECUTION, count=6, session=Session("test", 0.0), item=0,
        record=lambda row: None, placer=PLACER,
    )  # fmt: skip
    begun, first = sculptor.begin()
    assert first.actions.shape[1] == 3  # what lacks most comes first
    state = sculptor.execute(begun, begun.remaining[0])
    state = replace(state, actions=(*state.actions, np.array([0.05, 0.05, 0.0, 0.02, 0.004])))
    save_sculpture(tmp_path, SculptureState(goal, state, 1, None))
    loaded = load_sculpture(tmp_path).progress
    assert [len(action) for action in loaded.actions] == [3, 5]
    for one, other in zip(loaded.actions, state.actions, strict=True):
        np.testing.assert_array_equal(one, other)
    np.testing.assert_array_equal(loaded.remaining, state.remaining)
    assert sculptor.replan(loaded, False).remaining.shape[1] in (3, 5)


def test_columns_of_mixed_actions_invert() -> None:
    actions = (np.arange(5.0), np.array([0.1, 0.2, 3e-7]))
    rows, volumes = as_columns(actions)
    assert rows.shape == (2, 5) and np.isnan(volumes[0]) and volumes[1] == 3e-7
    for one, other in zip(from_columns(rows, volumes), actions, strict=True):
        np.testing.assert_array_equal(one, other)
    assert as_columns(())[0].shape == (0, 5)


@pytest.mark.parametrize(
    ("pushes", "places", "chosen"),
    [
        ([3.0, 2.0, 1.0], [3.0, 1.5, 1.4], 5),  # after two
        ([3.0, 2.0, 1.5, 0.1], [3.0, 1.0], 3),  # all of a shorter plan, the first two of a longer one
        ([3.0], [3.0, 2.9], 3),
        ([3.0], [3.0], 5),
    ],
)
def test_plan_with_the_lower_value_after_the_batch_is_chosen(
    pushes: list[float], places: list[float], chosen: int
) -> None:
    def planned(values: list[float], columns: int) -> PushPlan:
        return PushPlan(np.zeros((len(values) - 1, columns)), flat()[None], np.array(values))

    assert better_plan(planned(pushes, 5), planned(places, 3), 2).actions.shape[1] == chosen
