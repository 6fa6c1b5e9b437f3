import numpy as np
import pytest
from numpy.testing import assert_allclose

from pentimento.contracts.errors import ConfigError
from pentimento.contracts.height_maps import level
from pentimento.robots.driver import Push, SculptingRobot
from pentimento.robots.tools import load_end_effector
from pentimento.robots.virtual import virtual_sculpting_robot

ACTION = np.array([0.08, 0.14, 0.0, 0.03, 0.008])


def test_a_push_shows_in_the_scan_where_it_was_made() -> None:
    robot: SculptingRobot = virtual_sculpting_robot("dough", 64, seed=1)
    robot.change_tool(load_end_effector("ball"))
    before = robot.scan()
    path = robot.push(Push("push", ACTION, 0.04, 0.02, 0.5, 0.05))
    after = robot.scan()
    assert before.height_m.shape == (64, 64)
    assert_allclose(before.window_m, [0.0, 0.0, *robot.area_m])
    row, column = np.unravel_index(np.nanargmin(after.height_m - before.height_m), (64, 64))
    assert_allclose([(column + 0.5) / 320, 0.2 - (row + 0.5) / 320], [0.11, 0.14], atol=0.006)
    assert path.shape[1] == 5
    assert_allclose(path[[0, -1], 1:4], [[0.08, 0.14, 0.04], [0.11, 0.14, 0.032]], atol=3e-4)
    assert after.t_s > before.t_s + path[-1, 0]


def test_smoothing_brings_the_slab_back() -> None:
    robot = virtual_sculpting_robot("dough", 64, seed=1)
    robot.change_tool(load_end_effector("ball"))
    robot.push(Push("push", ACTION, 0.04, 0.02, 0.5, 0.05))
    robot.smooth()
    scan = robot.scan()
    assert np.nanstd(level(scan.height_m, scan.window_m, scan.table_plane)) < 0.0005


def test_the_room_s_sensors_are_covariates() -> None:
    robot = virtual_sculpting_robot("foam", 64, seed=1)
    first = robot.ambient()
    robot.wait(1000.0)
    assert set(first) == {"temperature_c", "humidity"}
    assert robot.ambient() != first
    assert robot.clock_s == 1000.0


def test_an_unknown_world_is_named() -> None:
    with pytest.raises(ConfigError, match="no world named"):
        virtual_sculpting_robot("marble", 64, seed=1)
