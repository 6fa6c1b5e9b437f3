import math
from dataclasses import replace

import numpy as np
from numpy.testing import assert_allclose, assert_array_equal

from pentimento.studio.clay.motion import Gears, commanded_line, encoder_path, executed_line, finger_lines
from pentimento.studio.clay.world import load_clay_world
from tests.studio.clay.clay_worlds import Array, clay_with

SIZE = (0.2, 0.2)
ACTION = np.array([0.08, 0.1, 0.5, 0.03, 0.006])


def executed(action: Array = ACTION, **strengths: float) -> Array:
    world = clay_with(**strengths)
    return executed_line(
        commanded_line(action, 0.04), world.arm, world.effects, size_m=SIZE, gears=Gears(), rng=np.random.default_rng(0)
    )[0]


def test_the_tip_starts_at_the_surface_and_sinks_linearly_over_its_travel() -> None:
    line = commanded_line(ACTION, 0.04)
    assert_allclose(line[0], [0.08, 0.1, 0.04])
    assert_allclose(line[-1], [0.08 + 0.03 * math.cos(0.5), 0.1 + 0.03 * math.sin(0.5), 0.034])
    way = np.hypot(*(line[:, :2] - line[0, :2]).T)
    assert_allclose(0.04 - line[:, 2], way * 0.006 / 0.03, atol=1e-12)


def test_an_arm_without_errors_goes_where_it_is_told() -> None:
    assert_allclose(executed(), commanded_line(ACTION, 0.04), atol=1e-15)


def test_play_shifts_the_way_against_its_direction() -> None:
    play = load_clay_world("clay_table").arm.backlash_m
    for theta, axis, sign in ((0.0, 0, -1), (math.pi, 0, 1), (math.pi / 2, 1, -1), (-math.pi / 2, 1, 1)):
        action = ACTION.copy()
        action[2] = theta
        shift = executed(action, tool_backlash=1.0) - executed(action)
        assert_allclose(shift[-1, axis], sign * play[axis] / 2, rtol=1e-6)
        assert_array_equal(shift[:, 2], 0.0)


def test_the_height_offset_is_deep_and_differs_over_the_slab() -> None:
    arm = load_clay_world("clay_table").arm
    centre = np.array([0.1, 0.1, 0.0, 0.0, 0.005])
    assert_allclose((executed(centre) - executed(centre, height_offset=1.0))[:, 2], arm.offset_m)
    assert_allclose((executed(centre) - executed(centre, height_offset=2.0))[:, 2], 2 * arm.offset_m)
    corner = np.array([0.18, 0.02, 0.0, 0.0, 0.005])
    assert not np.isclose((executed(corner) - executed(corner, height_offset=1.0))[0, 2], arm.offset_m, rtol=0.05)


def test_a_gripper_closes_by_the_action_s_length_along_its_direction() -> None:
    tool = load_clay_world("clay_table").tools["gripper"]
    line = commanded_line(ACTION, 0.04)
    (one, heading), (other, opposite) = finger_lines(tool, line, ACTION)
    distance = np.hypot(*(one - other)[:, :2].T) - 2 * tool.half_length_m
    assert_allclose(distance[[0, -1]], [tool.spread_m, tool.spread_m - 0.03])
    assert_allclose((one + other)[:, :2] / 2, np.broadcast_to(ACTION[:2], (len(line), 2)))
    assert_allclose(heading, -opposite)
    assert np.all((other - one)[:, :2] @ heading > 0)


def test_encoders_see_the_command_at_its_speed() -> None:
    arm = replace(load_clay_world("clay_table").arm, encoder_noise_m=0.0)
    command = commanded_line(ACTION, 0.04)
    path = encoder_path(command, ACTION, 0.01, arm, np.random.default_rng(0))
    assert_array_equal(path[:, 1:4], command)
    assert np.all(np.diff(path[:, 0]) > 0)
    assert_allclose(path[-9, 0], 0.03 / 0.01, rtol=0.02)
