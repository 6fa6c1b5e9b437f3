"""What a robot measured of its strokes: its delay, its paths without their noise, and press from force."""

from types import SimpleNamespace
from typing import cast

import numpy as np
import pyarrow as pa
import pytest

from pentimento.contracts.schema import PATH
from pentimento.contracts.strokes import example_table
from pentimento.diagnosis.strokes.executed import Following, executed, followed, following_of, measures_paths
from pentimento.diagnosis.strokes.fit import first_model, fit
from pentimento.diagnosis.strokes.measured import load_measured
from pentimento.diagnosis.strokes.predict import action_losses
from pentimento.diagnosis.strokes.problem import (
    FittedStrokes,
    StrokeResult,
    as_commanded,
    established_mechanisms,
    stroke_problem,
)
from pentimento.dynamics.strokes.mechanisms import VOCABULARY
from pentimento.robots.motion import timed_path
from pentimento.studio.shared import Gears
from pentimento.studio.strokes.motion import execute
from pentimento.studio.strokes.world import Robot
from tests.studio.strokes.worlds import world_with

NOISE_M = 5e-5


def commands(count: int = 30, seed: int = 0) -> list[np.ndarray]:
    """Bent strokes of all headings at 2 to 10 cm/s."""
    rng, s = np.random.default_rng(seed), np.linspace(0, 1, 32)
    paths = []
    for _ in range(count):
        turn, length, bend = rng.uniform(-np.pi, np.pi), rng.uniform(0.02, 0.06), rng.uniform(-0.01, 0.01)
        xy = np.stack([length * s, 4 * bend * s * (1 - s)], axis=1)
        cos, sin = np.cos(turn), np.sin(turn)
        xy = xy @ np.array([[cos, sin], [-sin, cos]]) + rng.uniform(0.05, 0.15, 2)
        paths.append(timed_path(np.column_stack([xy, np.full(32, -0.002), np.zeros(32)]), rng.uniform(0.02, 0.1)))
    return paths


def delayed(path: np.ndarray, delay_s: float) -> np.ndarray:
    """The motion of a path, later, at 100 Hz and until it has arrived."""
    t_s = np.arange(0.0, path[-1, 0] + max(delay_s, 0.0), 0.01)
    return np.column_stack([t_s, *(np.interp(t_s - delay_s, path[:, 0], column) for column in path[:, 1:].T)])


def noisy(path: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return path + NOISE_M * rng.standard_normal(path.shape) * [0, 1, 1, 1, 0]


@pytest.mark.parametrize("delay_s", [-0.02, 0.0, 0.01, 0.06, 0.3])
def test_delay_is_recovered_within_its_standard_error(delay_s: float) -> None:
    paths, rng = commands(), np.random.default_rng(1)
    found = following_of(paths, [noisy(delayed(path, delay_s), rng) for path in paths], np.arange(30))
    assert abs(found.delay_s - delay_s) < 4 * found.se_s
    assert found.se_s < 1e-4
    assert found.late == (delay_s > 0)


def test_standard_error_is_the_spread_over_noise() -> None:
    paths = commands(12)
    found = [
        following_of(
            paths, [noisy(delayed(p, 0.04), np.random.default_rng([k, i])) for i, p in enumerate(paths)], np.arange(12)
        )
        for k in range(40)
    ]
    spread = np.std([each.delay_s for each in found])
    assert 0.6 < np.mean([each.se_s for each in found]) / spread < 1.7


def test_scaled_and_shifted_frame_is_no_delay() -> None:
    paths, measured = commands(), []
    for path in paths:
        other = delayed(path, 0.0)
        other[:, 1:3] = path[0, 1:3] + (other[:, 1:3] - path[0, 1:3]) * (0.94, 0.97) + (0.001, -0.002)
        measured.append(other)
    assert abs(following_of(paths, measured, np.arange(30)).delay_s) < 1e-4


def test_a_shift_along_the_only_heading_is_no_delay() -> None:
    """A late robot rests at the start of its path, a shifted one does not."""
    s = np.linspace(0, 1, 32)
    straight = np.column_stack([s, 0.05 * s, 0 * s, 0 * s - 0.002, 0 * s])
    behind = straight - np.array([0, 0.002, 0, 0, 0])
    rng = np.random.default_rng(2)
    found = following_of([straight] * 20, [noisy(behind, rng) for _ in range(20)], np.arange(20))
    assert abs(found.delay_s) < 4 * found.se_s


def test_smoothed_path_has_less_noise_and_keeps_its_bends() -> None:
    rng = np.random.default_rng(3)
    for path in commands(8):
        true = delayed(path, 0.03)
        raw = noisy(true, rng)
        smooth = followed(path, raw, 0.03)
        np.testing.assert_array_equal(smooth[:, 0], raw[:, 0])
        assert np.abs(smooth[:, 3] - true[:, 3]).std() < 0.6 * NOISE_M
        assert np.hypot(*(smooth - true)[:, 1:3].T).mean() < NOISE_M
        np.testing.assert_allclose(followed(path, path, 0.0), path, atol=1e-12)


def test_delay_of_the_studios_servo_is_its_ramp_lag() -> None:
    """The studio has a dead time and a second-order servo; its lag behind a ramp is `latency_s` times the strength."""
    world, paths, measured = world_with(latency=0.5), commands(40), []
    robot: Robot = world.robot
    for number, path in enumerate(paths):
        gears, rng = Gears((float(path[0, 1]), float(path[0, 2]))), np.random.default_rng(number)
        tip = execute(path, robot, world.effects, canvas_size_m=(0.3, 0.2), gears=gears, rng=rng)
        measured.append(tip.encoders)
    assert following_of(paths, measured, np.arange(40)).delay_s == pytest.approx(0.5 * robot.latency_s, rel=0.05)


def with_column(table: pa.Table, name: str, values: list[object], kind: pa.DataType) -> pa.Table:
    return table.set_column(table.schema.get_field_index(name), name, pa.array(values, kind))


def test_measured_paths_are_used_where_every_row_has_one() -> None:
    table = example_table(16)
    assert measures_paths(table)
    done = executed(table)
    assert done.following is not None and not done.press_from_force
    shown, commanded = (np.array(each["path"].to_pylist()) for each in (done.table, table))
    assert 0 < np.abs(shown - commanded).max() < 1e-4
    one_missing = [None, *table["measured_path"].to_pylist()[1:]]
    untimed = [(np.array(path) * [np.nan, 1, 1, 1, 1]).tolist() for path in table["measured_path"].to_pylist()]
    for paths in (one_missing, untimed):
        unmeasured = with_column(table, "measured_path", paths, PATH)
        assert not measures_paths(unmeasured)
        assert executed(unmeasured).following is None and executed(unmeasured).table is unmeasured


def test_latency_is_no_candidate_along_measured_paths_and_part_of_a_model_of_commands() -> None:
    table = example_table(16)
    late = [delayed(np.array(path), 0.05).tolist() for path in table["path"].to_pylist()]
    measured = load_measured(with_column(table, "measured_path", late, PATH))
    problem = stroke_problem(measured, VOCABULARY, 0)
    assert "latency" not in problem.causes and "bristle_lag" in problem.causes
    assert "measured its paths" in problem.unobservable["latency"]
    assert measured.following is not None and measured.following.delay_s == pytest.approx(0.05, abs=1e-4)
    (latency,) = as_commanded(first_model(measured), measured).mechanisms
    assert latency.cause == "latency" and float(latency.values[0]) == measured.following.delay_s
    found = SimpleNamespace(established=(), extended=FittedStrokes(first_model(measured)), problem=problem)
    assert [mechanism.cause for mechanism in established_mechanisms(cast(StrokeResult, found))] == ["latency"]
    by_command = load_measured(table.drop_columns(["measured_path"]))
    assert by_command.following is None and "latency" in stroke_problem(by_command, VOCABULARY, 0).causes
    assert as_commanded(first_model(by_command), by_command).mechanisms == ()


def test_sentence_tells_a_late_robot_from_a_prompt_one() -> None:
    assert Following(0.0612, 0.0003).sentence() == (
        "The robot follows its command 61.2 ± 0.3 ms late (measured); the rest is the tool's."
    )
    assert "without a delay (−0.02 ± 0.03 ms" in Following(-2e-5, 3e-5).sentence()


def test_force_gives_the_press_where_z_is_constant() -> None:
    """The marks of the example widen with press, and its force is in proportion to that."""
    table = example_table(24).drop_columns(["measured_path"])
    assert not executed(table).press_from_force
    flat = [(np.array(path) * [1, 1, 1, 0, 1]).tolist() for path in table["path"].to_pylist()]
    table = with_column(table, "path", flat, PATH)
    by_force, blind = load_measured(table), load_measured(table.drop_columns(["force_n"]))
    assert by_force.press_from_force and not blind.press_from_force
    errors = [action_losses(fit(first_model(each), each), each).mean() for each in (by_force, blind)]
    assert errors[0] < 0.7 * errors[1]
