"""Errors of the arm, each against what it means."""

import numpy as np
import pytest

from pentimento.studio.strokes.motion import Gears, Tip, execute
from tests.studio.strokes.worlds import straight, world_with

SIZE = (0.3, 0.2)


def _execute(path: np.ndarray, gears: Gears | None = None, **strengths: float) -> Tip:
    world = world_with(**strengths)
    gears = gears or Gears((float(path[0, 1]), float(path[0, 2])))
    return execute(path, world.robot, world.effects, canvas_size_m=SIZE, gears=gears, rng=np.random.default_rng(3))


def test_without_errors_the_tip_goes_where_it_is_commanded() -> None:
    path = straight(yaw_rad=0.4)
    tip = _execute(path)
    for here, commanded in ((tip.pose[0], path[0]), (tip.pose[-1], path[-1])):
        assert np.allclose(here[:2], commanded[1:3], atol=3e-4)
        assert np.allclose(here[2:], commanded[3:5])
    assert np.allclose(tip.speed_m_s, 0.05, rtol=1e-6)


def test_latency_trails_by_speed_times_time() -> None:
    strokes = {speed: straight(speed_m_s=speed, length_m=0.08) for speed in (0.05, 0.1)}
    robot = world_with().robot
    for speed, path in strokes.items():
        behind = _execute(path).pose - _execute(path, latency=1.0).pose
        assert behind[-1, 0] == pytest.approx(speed * robot.latency_s, rel=0.02)
        assert np.all(behind[:, 0] > -1e-9)


def test_backlash_is_a_play_between_the_two_directions_of_an_axis() -> None:
    there, back = straight(), straight(start=(0.15, 0.1), heading_rad=np.pi)
    first = _execute(there, backlash=1.0)
    second = _execute(back, first.gears, backlash=1.0)
    plain_first, plain_second = _execute(there), _execute(back)
    late = first.pose[-1, 0] - plain_first.pose[-1, 0], second.pose[-1, 0] - plain_second.pose[-1, 0]
    play = world_with().robot.backlash_m[0]
    assert late == pytest.approx((-play / 2, play / 2), abs=1e-9)
    assert second.pose[0, 0] == pytest.approx(first.pose[-1, 0], abs=1e-9)


def test_scale_is_about_the_start_and_offset_is_the_same_along_the_stroke() -> None:
    path, robot = straight(), world_with().robot
    plain = _execute(path).pose
    scaled, shifted = _execute(path, path_scale=1.0).pose, _execute(path, path_offset=1.0).pose
    assert np.allclose(scaled[0], plain[0])
    assert scaled[-1, 0] - scaled[0, 0] == pytest.approx(robot.scale[0] * 0.05)
    shift = (shifted - plain)[:, :2]
    assert np.allclose(shift, robot.offset_m, atol=3e-4)
    assert np.ptp(shift, axis=0).max() < 1e-4


def test_encoders_see_latency_but_neither_scale_nor_offset_nor_play() -> None:
    path = straight()
    plain = _execute(path).encoders
    assert np.array_equal(plain, _execute(path, path_scale=1.0, path_offset=1.0, backlash=1.0).encoders)
    assert plain.shape == path.shape
    assert 0 < np.abs(plain - path)[:, 1:4].max() < 3e-4
    assert _execute(path, latency=1.0).encoders[16, 1] < plain[16, 1] - 0.002
