"""Tip motion: times for a path, and the speeds and accelerations of a timed path.

A path is float64[N, 5] in the canvas frame: t_s, x_m, y_m, z_m, yaw_rad. The tip starts and ends at rest.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.errors import ContractError

FloatArray = NDArray[np.float64]

ACCELERATION_M_S2 = 2.0
"""Low enough that no brush sheds paint; the ramps are short (1 mm at 60 mm/s) against a stroke."""
YAW_RATE_RAD_S = 3.0
"""Max turning rate of the tool, half a turn a second."""
MIN_STEP_S = 1e-3
"""The control period of common arms: points closer in time cannot be followed."""


def tip_speeds(path: FloatArray) -> FloatArray:
    """Mean tip speed [m/s] over each of the N − 1 segments of path[N, 5]."""
    speeds: FloatArray = np.linalg.norm(_velocities(path), axis=1)
    return speeds


def tip_accelerations(path: FloatArray) -> FloatArray:
    """Tip acceleration [m/s²] at each of the N points of path[N, 5], by finite differences.

    A segment's mean velocity is taken to hold at the middle of its time, and the tip to be at rest at the
    first and the last point; uniformly accelerated motion is therefore measured exactly.
    """
    velocity = np.vstack((np.zeros(3), _velocities(path), np.zeros(3)))  # [N + 1, 3]
    accelerations: FloatArray = np.linalg.norm(np.diff(velocity, axis=0), axis=1) / acceleration_spans(path)
    return accelerations


def acceleration_spans(path: FloatArray) -> FloatArray:
    """Time [s] between the two velocities that each of tip_accelerations' N values compares."""
    half_s = np.diff(path[:, 0]) / 2
    spans: FloatArray = np.append(half_s, 0.0) + np.insert(half_s, 0, 0.0)
    return spans


def _velocities(path: FloatArray) -> FloatArray:
    velocities: FloatArray = np.diff(path[:, 1:4], axis=0) / np.diff(path[:, 0])[:, None]
    return velocities


def timed_path(
    xyz_yaw: FloatArray,
    speed_m_s: float,
    acceleration_m_s2: float = ACCELERATION_M_S2,
    yaw_rate_rad_s: float = YAW_RATE_RAD_S,
) -> FloatArray:
    """Give times to the points of xyz_yaw[N, 4] (canvas frame): float64[N, 5] with t from 0.

    The tip starts at rest, runs at `speed_m_s` where the bends allow it, and ends at rest; neither speed,
    acceleration (as `tip_accelerations` measures it) nor yaw rate passes its limit, and no step is shorter
    than MIN_STEP_S. The points themselves are not changed.

    Raises ContractError for fewer than two points, values that are not finite, limits that are not above
    zero, and neighbouring points at one place.
    """
    points = np.array(xyz_yaw, dtype=np.float64)
    _check(points, (speed_m_s, acceleration_m_s2, yaw_rate_rad_s))
    step_m = np.linalg.norm(np.diff(points[:, :3], axis=0), axis=1)  # [N - 1]
    turn_rad = np.abs(np.diff(points[:, 3]))  # [N - 1]
    # Along and across the path each get an equal part, so that their vector sum keeps the limit.
    share_m_s2 = acceleration_m_s2 / np.sqrt(2)

    cap_m_s = _speed_caps(
        points, step_m, turn_rad, speed_m_s=speed_m_s, across_m_s2=share_m_s2, yaw_rate_rad_s=yaw_rate_rad_s
    )
    speed = _reachable(cap_m_s, step_m, share_m_s2)
    if len(points) == 2:
        duration_s = np.array([_rest_to_rest_s(float(step_m[0]), float(cap_m_s[0]), share_m_s2)])
    else:
        duration_s = 2 * step_m / (speed[:-1] + speed[1:])
    path = np.column_stack((np.append(0.0, np.cumsum(duration_s)), points))
    # Uneven sampling can leave a few per cent too much, and stretching time is always enough.
    path[:, 0] *= max(
        1.0,
        float(np.max(tip_speeds(path))) / speed_m_s,
        float(np.sqrt(np.max(tip_accelerations(path)) / acceleration_m_s2)),
        float(np.max(turn_rad / duration_s)) / yaw_rate_rad_s,
        MIN_STEP_S / float(np.min(duration_s)),
    )
    return path


def _check(points: FloatArray, limits: tuple[float, float, float]) -> None:
    if points.ndim != 2 or points.shape[1] != 4 or len(points) < 2:
        raise ContractError(f"A path to be timed is [N, 4] (x, y, z, yaw) with N of 2 or more; got {points.shape}.")
    if not np.all(np.isfinite(points)):
        row = int(np.argmin(np.all(np.isfinite(points), axis=1)))
        raise ContractError(f"Point {row} of the path to be timed is not finite: {points[row].tolist()}.")
    if not all(np.isfinite(limit) and limit > 0 for limit in limits):
        raise ContractError(f"Speed, acceleration and yaw rate must be finite and above zero; got {limits}.")
    together = np.flatnonzero(np.linalg.norm(np.diff(points[:, :3], axis=0), axis=1) < 1e-8)
    if together.size:
        raise ContractError(
            f"Points {together[0]} and {together[0] + 1} of the path to be timed are at one place; "
            "leave one of them out."
        )


def _speed_caps(
    points: FloatArray,
    step_m: FloatArray,
    turn_rad: FloatArray,
    *,
    speed_m_s: float,
    across_m_s2: float,
    yaw_rate_rad_s: float,
) -> FloatArray:
    """Max speed [N] at each point under the speed limit, the bends and the yaw rate."""
    heading = np.diff(points[:, :3], axis=0) / step_m[:, None]
    change = np.linalg.norm(np.diff(heading, axis=0), axis=1)  # 2 sin(angle / 2) at the inner points
    cap = np.full(len(points), speed_m_s)
    bend_m = (step_m[:-1] + step_m[1:]) / 2
    # v · change / (bend_m / v) <= across
    cap[1:-1] = np.minimum(cap[1:-1], np.sqrt(across_m_s2 * bend_m / np.maximum(change, 1e-12)))
    segment = np.minimum(speed_m_s, yaw_rate_rad_s * step_m / np.maximum(turn_rad, 1e-12))
    cap[:-1] = np.minimum(cap[:-1], segment)
    cap[1:] = np.minimum(cap[1:], segment)
    return cap


def _reachable(cap_m_s: FloatArray, step_m: FloatArray, along_m_s2: float) -> FloatArray:
    """Speeds [N] under the caps, from rest to rest, with v² changing by no more than 2 a ds a step."""
    square = cap_m_s**2
    square[0] = square[-1] = 0.0
    for i in range(1, len(square)):
        square[i] = min(square[i], square[i - 1] + 2 * along_m_s2 * step_m[i - 1])
    for i in range(len(square) - 2, -1, -1):
        square[i] = min(square[i], square[i + 1] + 2 * along_m_s2 * step_m[i])
    return np.sqrt(square)


def _rest_to_rest_s(length_m: float, speed_m_s: float, acceleration_m_s2: float) -> float:
    """Duration of one straight step that begins and ends at rest."""
    if length_m <= speed_m_s**2 / acceleration_m_s2:
        return 2 * float(np.sqrt(length_m / acceleration_m_s2))
    return length_m / speed_m_s + speed_m_s / acceleration_m_s2
