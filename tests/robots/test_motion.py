"""Timed paths: closed forms of their timing, and limits kept whatever the shape."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pentimento.contracts.errors import ContractError
from pentimento.robots.motion import (
    ACCELERATION_M_S2,
    MIN_STEP_S,
    YAW_RATE_RAD_S,
    timed_path,
    tip_accelerations,
    tip_speeds,
)


def line(length_m: float, points: int) -> np.ndarray:
    xyz_yaw = np.zeros((points, 4))
    xyz_yaw[:, 0] = np.linspace(0, length_m, points)
    return xyz_yaw


def test_uniform_acceleration_is_measured_exactly() -> None:
    """x = a t² / 2 at uneven times: finite differences of segment means are exact for a parabola."""
    t = np.array([0.0, 0.02, 0.05, 0.06, 0.1])
    path = np.column_stack((t, 0.5 * 1.7 * t**2, np.zeros((5, 3))))
    assert tip_accelerations(path)[:-1] == pytest.approx(np.full(4, 1.7))


def test_stopping_dead_counts_as_acceleration() -> None:
    """From 0.1 m/s to rest over half of a 0.02 s segment: 10 m/s²."""
    path = np.zeros((3, 5))
    path[:, 0] = [0, 0.02, 0.04]
    path[:, 1] = [0, 0.002, 0.004]
    assert tip_accelerations(path) == pytest.approx([10.0, 0.0, 10.0])
    assert tip_speeds(path) == pytest.approx([0.1, 0.1])


def test_a_long_line_takes_the_time_of_a_trapezoid() -> None:
    """Duration of a trapezoid: length / v + v / a, with a the share that runs along the path."""
    path = timed_path(line(0.05, 65), 0.06, 2.0)
    assert path[-1, 0] == pytest.approx(0.05 / 0.06 + 0.06 / (2.0 / math.sqrt(2)), rel=0.01)


def test_points_denser_than_the_control_period_are_stretched_to_it() -> None:
    path = timed_path(line(0.01, 1001), 0.06)
    assert np.diff(path[:, 0]).min() == pytest.approx(MIN_STEP_S)


def test_an_ordinary_bent_stroke_reaches_its_speed() -> None:
    """4 bend L s (1 − s) with the bend of .35 that tools allow."""
    for length_m in (0.01, 0.03, 0.06):
        s = np.linspace(0, 1, 32)
        points = np.column_stack((length_m * s, 1.4 * length_m * s * (1 - s), -0.002 * np.sin(np.pi * s), 0 * s))
        assert np.mean(tip_speeds(timed_path(points, 0.06)) > 0.9 * 0.06) > 0.8


def test_most_of_a_stroke_cruises_at_the_speed_asked_for() -> None:
    speeds = tip_speeds(timed_path(line(0.03, 32), 0.06))
    assert np.mean(np.isclose(speeds, 0.06, rtol=1e-6)) > 0.8


def test_two_points_run_from_rest_to_rest() -> None:
    """Short: a triangle of 2 √(L / a); long: L / v + v / a."""
    share = 2.0 / math.sqrt(2)
    assert timed_path(line(0.001, 2), 0.06, 2.0)[-1, 0] == pytest.approx(2 * math.sqrt(0.001 / share))
    assert timed_path(line(0.05, 2), 0.06, 2.0)[-1, 0] == pytest.approx(0.05 / 0.06 + 0.06 / share)


def test_timed_path_slows_down_at_a_sharp_corner() -> None:
    points = line(0.04, 33)
    points[17:, 1] = points[17:, 0] - points[16, 0]
    points[17:, 0] = points[16, 0]  # a right angle at point 16
    path = timed_path(points, 0.1)
    speeds = tip_speeds(path)
    assert speeds[15:17].max() < 0.6 * speeds.max() and speeds.max() > 0.07


def test_turning_slows_to_the_yaw_rate() -> None:
    points = line(0.01, 32)
    points[:, 3] = np.linspace(0, math.pi, 32)
    path = timed_path(points, 0.1)
    rate = np.diff(path[:, 4]) / np.diff(path[:, 0])
    assert rate.max() == pytest.approx(YAW_RATE_RAD_S, rel=0.02)


def test_the_points_are_kept() -> None:
    points = np.random.default_rng(3).normal(size=(12, 4))
    path = timed_path(points, 0.1)
    assert np.array_equal(path[:, 1:], points)
    assert path.dtype == np.float64 and path[0, 0] == 0.0


@settings(max_examples=100, deadline=None, derandomize=True, database=None)
@given(
    seed=st.integers(0, 2**31),
    count=st.integers(2, 60),
    step_m=st.floats(1e-6, 0.02),
    speed_m_s=st.floats(0.005, 0.5),
    acceleration_m_s2=st.floats(0.2, 10.0),
)
def test_no_limit_is_passed_whatever_the_shape(
    seed: int, count: int, step_m: float, speed_m_s: float, acceleration_m_s2: float
) -> None:
    """Random walks, with reversals, uneven steps and spinning yaw."""
    rng = np.random.default_rng(seed)
    points = np.cumsum(rng.normal(size=(count, 4)) * [step_m, step_m, step_m / 5, 0.2], axis=0)
    path = timed_path(points, speed_m_s, acceleration_m_s2)
    assert path[0, 0] == 0 and np.diff(path[:, 0]).min() >= MIN_STEP_S * (1 - 1e-9)
    assert tip_speeds(path).max() <= speed_m_s * (1 + 1e-9)
    assert tip_accelerations(path).max() <= acceleration_m_s2 * (1 + 1e-9)
    assert (np.abs(np.diff(path[:, 4])) / np.diff(path[:, 0])).max() <= YAW_RATE_RAD_S * (1 + 1e-9)


@pytest.mark.parametrize("bad", [np.zeros((1, 4)), np.zeros((3, 5)), np.zeros(4)])
def test_a_wrong_shape_is_refused(bad: np.ndarray) -> None:
    with pytest.raises(ContractError, match=r"\[N, 4\]"):
        timed_path(bad, 0.06)


def test_values_that_make_no_motion_are_refused() -> None:
    points = line(0.02, 8)
    points[3, 1] = math.nan
    with pytest.raises(ContractError, match="Point 3"):
        timed_path(points, 0.06)
    points = line(0.02, 8)
    points[5] = points[4]
    with pytest.raises(ContractError, match="Points 4 and 5"):
        timed_path(points, 0.06)
    for speed, acceleration in ((0.0, ACCELERATION_M_S2), (math.nan, 1.0), (0.06, -1.0)):
        with pytest.raises(ContractError, match="above zero"):
            timed_path(line(0.02, 8), speed, acceleration)
