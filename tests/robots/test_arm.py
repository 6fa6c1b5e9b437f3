"""Poses between poses, and the conventions of angles: round trips and closed forms."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pentimento.robots.arm import (
    check_start,
    measured_at,
    pose_from,
    quaternion,
    resampled,
    roll_pitch_yaw,
    velocities,
)
from pentimento.robots.journey import poses_of
from pentimento.robots.machine import MachineError
from pentimento.robots.motion import timed_path
from pentimento.robots.rig import rotation_of
from tests.robots.machines import make_rig

PROPERTY = settings(max_examples=80, deadline=None, derandomize=True, database=None)
angles = st.floats(-3.1, 3.1)


def way(points: int = 20) -> tuple[np.ndarray, np.ndarray]:
    s = np.linspace(0, 1, points)
    path = timed_path(np.column_stack((0.1 + 0.04 * s, 0.1 + 0.02 * s**2, -0.002 * s, 1.2 * s)), 0.05)
    return path[:, 0], poses_of(path, make_rig())


@PROPERTY
@given(roll=angles, pitch=st.floats(-1.5, 1.5), yaw=angles)
def test_roll_pitch_yaw_are_inverted(roll: float, pitch: float, yaw: float) -> None:
    rotation = rotation_of(roll, pitch, yaw)
    assert rotation_of(*roll_pitch_yaw(rotation)) == pytest.approx(rotation, abs=1e-9)


@PROPERTY
@given(roll=angles, pitch=angles, yaw=angles)
def test_a_quaternion_turns_as_its_matrix(roll: float, pitch: float, yaw: float) -> None:
    """v' = v + 2 w (u × v) + 2 u × (u × v) for (u, w) of unit length."""
    rotation = rotation_of(roll, pitch, yaw)
    q = quaternion(rotation)
    u, w = q[:3], q[3]
    assert np.linalg.norm(q) == pytest.approx(1)
    for v in np.eye(3):
        assert v + 2 * w * np.cross(u, v) + 2 * np.cross(u, np.cross(u, v)) == pytest.approx(rotation @ v, abs=1e-7)


def test_half_a_turn_is_a_unit_quaternion_too() -> None:
    assert np.abs(quaternion(rotation_of(math.pi, 0, 0))) == pytest.approx([1, 0, 0, 0], abs=1e-9)


def test_resampling_keeps_the_ends_the_line_and_the_period() -> None:
    times_s, poses = way()
    even_s, ways = resampled(times_s, poses, 0.01)
    assert np.diff(even_s).max() <= 0.01 + 1e-12 and even_s[-1] == times_s[-1]
    assert ways[0] == pytest.approx(poses[0]) and ways[-1] == pytest.approx(poses[-1], abs=1e-9)
    for axis in range(3):
        assert ways[:, axis, 3] == pytest.approx(np.interp(even_s, times_s, poses[:, axis, 3]))
    assert np.linalg.det(ways[:, :3, :3]) == pytest.approx(np.ones(len(ways)))


def test_velocities_are_the_way_s_own() -> None:
    """Even motion of 0.1 m/s along x and 0.5 rad/s about z; at rest at both ends."""
    times_s = np.linspace(0, 1, 11)
    poses = np.array([pose_from(np.array([0.1 * t, 0, 0]), np.array([0, 0, 0.5 * t])) for t in times_s])
    found = velocities(times_s, poses)
    assert found[1:-1] == pytest.approx(np.tile([0.1, 0, 0, 0, 0, 0.5], (9, 1)), abs=1e-9)
    assert not found[[0, -1]].any()


def test_motion_from_a_moved_tip_is_rejected() -> None:
    pose = pose_from(np.array([0.3, 0, 0.1]), np.array([math.pi, 0, 0]))
    check_start(pose, pose, "arm")
    with pytest.raises(MachineError, match=r"5\.0 mm"):
        check_start(pose_from(np.array([0.305, 0, 0.1]), np.array([math.pi, 0, 0])), pose, "arm")
    with pytest.raises(MachineError, match=r"5\.7 degrees"):
        check_start(pose_from(np.array([0.3, 0, 0.1]), np.array([math.pi, 0, 0.1])), pose, "arm")
    with pytest.raises(MachineError, match="does not say where"):
        check_start(np.full((4, 4), np.nan), pose, "arm")


def test_what_was_seen_is_laid_over_the_way_s_times() -> None:
    times_s, poses = way()
    even_s, ways = resampled(times_s, poses, 0.005)
    seen = measured_at(times_s, list(even_s), list(ways))
    assert seen[:, :3, 3] == pytest.approx(poses[:, :3, 3], abs=2e-4)
    assert np.isnan(measured_at(times_s, [0.0], [ways[0]])).all()
