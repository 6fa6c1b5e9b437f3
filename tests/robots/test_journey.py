"""Ways of the tip, and frames: closed forms of a turned canvas, round trips, rest at both ends."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pentimento.contracts.errors import EnvelopeViolation
from pentimento.robots.journey import (
    LANDING_M_S,
    RISING_M_S,
    check_reach,
    off_surface,
    on_surface,
    path_of,
    poses_of,
    straight,
    to_and_fro,
    way_up,
    ways_to,
)
from pentimento.robots.motion import ACCELERATION_M_S2, YAW_RATE_RAD_S, tip_accelerations, tip_speeds
from tests.robots.machines import make_rig

PROPERTY = settings(max_examples=60, deadline=None, derandomize=True, database=None)
RIG = make_rig()
places = st.tuples(st.floats(0, 0.3), st.floats(0, 0.2), st.floats(-0.004, 0.05), st.floats(-3, 3)).map(np.array)


def test_a_quarter_turn_takes_the_canvas_x_to_the_robot_y() -> None:
    """canvas (x, y, z) -> robot (0.4 − y, 0.1 + x, 0.05 + z); the tool points down, its x along the canvas's x."""
    pose = poses_of(np.array([[0.0, 0.2, 0.05, -0.001, 0.0]]), RIG)[0]
    assert pose[:3, 3] == pytest.approx([0.35, 0.3, 0.049])
    assert pose[:3, 2] == pytest.approx([0, 0, -1], abs=1e-12)
    assert pose[:3, 0] == pytest.approx([0, 1, 0], abs=1e-12)
    assert np.linalg.det(pose[:3, :3]) == pytest.approx(1)


def test_yaw_turns_the_tool_about_the_canvas_normal() -> None:
    pose = poses_of(np.array([[0.0, 0, 0, 0, math.pi / 2]]), make_rig(turn_rad=(0.0, 0.0, 0.0)))[0]
    assert pose[:3, 0] == pytest.approx([0, 1, 0], abs=1e-12)


@PROPERTY
@given(seed=st.integers(0, 2**31), turn=st.tuples(*[st.floats(-1.4, 1.4)] * 3))
def test_frames_go_there_and_back(seed: int, turn: tuple[float, float, float]) -> None:
    rng = np.random.default_rng(seed)
    rig = make_rig(turn_rad=turn, surface=(1e-3, -2e-3, 5e-3))
    path = np.column_stack((np.arange(20.0), rng.normal(size=(20, 3)), np.cumsum(rng.uniform(-1, 1, 20))))
    path[:, 4] -= path[0, 4]
    assert path_of(path[:, 0], poses_of(path, rig), rig) == pytest.approx(path, abs=1e-9)
    assert off_surface(on_surface(path, rig), rig) == pytest.approx(path, abs=1e-12)


def test_heights_are_counted_from_the_found_surface() -> None:
    """a + b x + c y = 1 mm + 0.01 · 0.1 m − 0.02 · 0.05 m = 1 mm."""
    path = np.array([[0, 0.1, 0.05, -0.002, 0.3]])
    assert on_surface(path, make_rig(surface=(1e-3, 0.01, -0.02)))[0, 3] == pytest.approx(-0.001)


@PROPERTY
@given(here=places, start=places)
def test_the_way_to_a_stroke_goes_up_across_and_down(here: np.ndarray, start: np.ndarray) -> None:
    ways = ways_to(here, start, RIG)
    if not ways:
        assert here == pytest.approx(start, abs=1e-5)
        return
    assert ways[0][0, 1:] == pytest.approx(here, abs=1e-5) and ways[-1][-1, 1:] == pytest.approx(start, abs=1e-5)
    for one, other in pairwise(ways):
        assert one[-1, 1:] == pytest.approx(other[0, 1:], abs=1e-5)
    for way in ways:
        assert way[0, 0] == 0 and (np.diff(way[:, 0]) > 0).all()
        moved = np.ptp(way[:, 1:3], axis=0).max()
        if moved > 1e-5:  # sideways only in the air
            assert way[:, 3].min() >= RIG.travel_height_m - 1e-9
            assert tip_speeds(way).max() <= RIG.travel_speed_m_s * (1 + 1e-9)
        else:
            allowed_m_s = LANDING_M_S if way[-1, 3] < way[0, 3] else RISING_M_S
            assert tip_speeds(way).max() <= allowed_m_s * (1 + 1e-9)
        assert tip_accelerations(way).max() <= ACCELERATION_M_S2 * (1 + 1e-9)
        assert (np.abs(np.diff(way[:, 4])) / np.diff(way[:, 0])).max() <= YAW_RATE_RAD_S * 1.01


def test_a_tip_in_the_air_needs_no_way_up() -> None:
    assert way_up(np.array([0.1, 0.1, RIG.travel_height_m, 0.0]), RIG) is None
    way = way_up(np.array([0.1, 0.1, -0.002, 0.7]), RIG)
    assert way is not None
    assert way[-1, 1:] == pytest.approx([0.1, 0.1, RIG.travel_height_m, 0.7])
    assert (np.diff(way[:, 3]) > 0).all()


def test_a_turn_on_the_spot_takes_its_time() -> None:
    """3 s² − 2 s³ has its greatest rate, 1.5 times the mean, in the middle."""
    here = np.array([0.1, 0.1, 0.03, 0.0])
    way = straight(here, here + np.array([0, 0, 0, 3.0]), 0.1)
    assert way is not None and way[-1, 0] == pytest.approx(1.5 * 3.0 / YAW_RATE_RAD_S)
    assert straight(here, here, 0.1) is None


def test_to_and_fro_ends_where_it_began_and_never_stands_still_in_time() -> None:
    low, high = np.array([0.34, 0.05, -0.004, 0.0]), np.array([0.34, 0.056, -0.004, 0.0])
    way = to_and_fro(low, high, 3)
    assert way[0, 1:] == pytest.approx(low) and way[-1, 1:] == pytest.approx(low)
    assert (np.diff(way[:, 0]) > 0).all() and way[:, 2].max() == pytest.approx(0.056)
    assert np.sum(np.isclose(way[:, 2], 0.056)) == 3


@PROPERTY
@given(axis=st.integers(0, 2), sign=st.sampled_from((-1, 1)), beyond_m=st.floats(1e-5, 10))
def test_one_pose_out_of_reach_is_refused(axis: int, sign: int, beyond_m: float) -> None:
    poses = poses_of(np.array([[0.0, 0.1, 0.1, 0.0, 0.0], [1.0, 0.12, 0.1, 0.0, 0.0]]), RIG)
    check_reach(poses, RIG, "stroke")
    poses[1, axis, 3] = np.array(RIG.reach_m)[(sign + 1) // 2, axis] + sign * beyond_m
    with pytest.raises(EnvelopeViolation, match="out of the reach"):
        check_reach(poses, RIG, "stroke")


def test_a_pose_that_is_no_number_is_out_of_reach() -> None:
    poses = poses_of(np.array([[0.0, 0.1, math.nan, 0.0, 0.0]]), RIG)
    with pytest.raises(EnvelopeViolation):
        check_reach(poses, RIG, "stroke")
