"""The studio's robot passes commands on to the studio, and its answers back."""

import numpy as np
import pytest

from pentimento.contracts.errors import ConfigError, ContractError
from pentimento.robots.driver import MissingAbilityError, Robot
from pentimento.robots.motion import timed_path
from pentimento.robots.tools import load_tool
from pentimento.robots.virtual import VirtualRobot, virtual_robot
from pentimento.studio.strokes.studio import Studio
from pentimento.studio.strokes.world import load_world

RED_BLUE = np.array([[0.8, 0.1, 0.1], [0.1, 0.1, 0.8]])


@pytest.fixture(scope="module")
def robot() -> VirtualRobot:
    return VirtualRobot(Studio(load_world("plain"), seed=0))


def path_across() -> np.ndarray:
    xyz_yaw = np.zeros((32, 4))
    xyz_yaw[:, 0] = np.linspace(0.1, 0.15, 32)
    xyz_yaw[:, 1], xyz_yaw[:, 2] = 0.1, -0.002
    return timed_path(xyz_yaw, 0.06)


def test_a_stroke_in_the_paint_of_its_dip_shows_on_the_sheet(robot: VirtualRobot) -> None:
    studio = robot._studio
    robot.new_sheet()
    robot.change_tool(load_tool("round_brush"))
    robot.load_palette(RED_BLUE)
    before = studio.truth_image(1000)
    robot.dip(1)
    measured = robot.move(path_across())
    after = studio.truth_image(1000)
    assert measured.shape == (32, 5)
    assert measured[:, 1:3] == pytest.approx(path_across()[:, 1:3], abs=2e-3)
    assert robot.force_n().shape == (32,) and robot.force_n().mean() > 0.05
    row, column = 100, 125
    assert after[row, column, 0] < 0.5 * before[row, column, 0]
    assert after[row, column, 2] > 2 * after[row, column, 0]
    assert np.allclose(after[20:60], before[20:60], atol=0.02)


def test_time_passes_by_what_is_done(robot: VirtualRobot) -> None:
    start_s = robot.clock_s
    robot.wait(12.5)
    assert robot.clock_s == pytest.approx(start_s + 12.5)
    photo = robot.photo()
    assert start_s + 12.5 <= photo.t_s <= robot.clock_s
    robot.wipe()
    assert robot.clock_s > photo.t_s


def test_what_the_studio_lacks_is_said(robot: VirtualRobot) -> None:
    as_robot: Robot = robot
    assert as_robot.canvas_size_m == (0.3, 0.2)
    with pytest.raises(MissingAbilityError, match="scanner"):
        as_robot.scan()
    with pytest.raises(ContractError, match="holds a round_brush and the marker"):
        as_robot.change_tool(load_tool("marker"))
    with pytest.raises(ContractError, match="Paint 7"):
        as_robot.dip(7)


def test_a_world_can_be_given_a_sheet_of_another_size() -> None:
    robot = virtual_robot("marker", (0.08, 0.06), seed=1)
    assert robot.canvas_size_m == (0.08, 0.06)
    with pytest.raises(ConfigError):
        virtual_robot("nowhere", (0.08, 0.06), seed=1)
