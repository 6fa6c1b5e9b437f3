"""Travel of the tip between strokes, and the map from the canvas frame to the robot's.

Pure functions: a motion is a value, float64[N, 5] in the canvas frame (t_s, x_m, y_m, z_m, yaw_rad), at rest at both
ends, and can be checked before anything moves.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.errors import EnvelopeViolation
from pentimento.robots.motion import YAW_RATE_RAD_S, timed_path
from pentimento.robots.rig import Rig, rotation_of

FloatArray = NDArray[np.float64]

LANDING_M_S = 0.02
"""Speed towards the canvas, slow enough for a tip on an uneven sheet."""
RISING_M_S = 0.05
"""Speed away from it."""
_POINTS = 33  # of a straight motion, so that a driver that follows points resolves its acceleration
_SAME_M = 1e-6  # places and angles nearer than this are the same
_SAME_RAD = 1e-6
_FACING = rotation_of(np.pi, 0.0, 0.0)  # the tip's z axis points into the canvas


def ways_to(here: FloatArray, start: FloatArray, rig: Rig) -> list[FloatArray]:
    """Motions from `here` [4] (x, y, z, yaw) up, across at travel height, and down to `start` [4]."""
    height_m = max(rig.travel_height_m, float(here[2]))
    up, above = here.copy(), start.copy()
    up[2] = above[2] = height_m
    legs = ((here, up, RISING_M_S), (up, above, rig.travel_speed_m_s), (above, start, LANDING_M_S))
    return [way for begin, end, speed in legs if (way := straight(begin, end, speed)) is not None]


def way_up(here: FloatArray, rig: Rig, speed_m_s: float | None = None) -> FloatArray | None:
    """From `here` [4] straight up to travel height; None where the tip is there already.

    speed_m_s: if not RISING_M_S.
    """
    if here[2] >= rig.travel_height_m - _SAME_M:
        return None
    up = here.copy()
    up[2] = rig.travel_height_m
    return straight(here, up, RISING_M_S if speed_m_s is None else speed_m_s)


def straight(begin: FloatArray, end: FloatArray, speed_m_s: float) -> FloatArray | None:
    """A straight motion [N, 5] between two places [4] (x, y, z, yaw), turning evenly; None where they are one."""
    share = np.linspace(0.0, 1.0, _POINTS)[:, None]
    turn_rad = abs(float(end[3] - begin[3]))
    if np.linalg.norm(end[:3] - begin[:3]) > _SAME_M:
        return timed_path(begin + share * (end - begin), speed_m_s)
    if turn_rad <= _SAME_RAD:
        return None
    # Turning on the spot, with a smooth start and end: 3 s² − 2 s³ is at most 1.5 times as fast as its mean.
    smooth = share**2 * (3 - 2 * share)
    times_s = share * 1.5 * turn_rad / YAW_RATE_RAD_S
    return np.column_stack((times_s, begin + smooth * (end - begin)))


def to_and_fro(begin: FloatArray, end: FloatArray, times: int) -> FloatArray:
    """From `begin` [4] to `end` [4] and back, `times` times, at landing speed: [N, 5]. The two places differ."""
    ways = [way for pair in ((begin, end), (end, begin)) if (way := straight(*pair, LANDING_M_S)) is not None]
    whole = ways[0]
    for way in (ways * times)[1:]:
        later = way[1:].copy()
        later[:, 0] += whole[-1, 0]
        whole = np.vstack((whole, later))
    return whole


def on_surface(path: FloatArray, rig: Rig) -> FloatArray:
    """The path [N, 5] with its heights relative to the surface of the touch calibration."""
    a, b, c = rig.surface
    moved = path.copy()
    moved[:, 3] += a + b * path[:, 1] + c * path[:, 2]
    return moved


def off_surface(path: FloatArray, rig: Rig) -> FloatArray:
    """The inverse of on_surface."""
    a, b, c = rig.surface
    moved = path.copy()
    moved[:, 3] -= a + b * path[:, 1] + c * path[:, 2]
    return moved


def poses_of(path: FloatArray, rig: Rig) -> FloatArray:
    """The tip's poses [N, 4, 4] in the robot's frame along a motion [N, 5] of the canvas frame."""
    cos, sin = np.cos(path[:, 4]), np.sin(path[:, 4])
    poses = np.zeros((len(path), 4, 4))
    poses[:, 0, 0], poses[:, 0, 1], poses[:, 1, 0], poses[:, 1, 1] = cos, -sin, sin, cos
    poses[:, 2, 2] = poses[:, 3, 3] = 1.0
    poses[:, :3, :3] = poses[:, :3, :3] @ _FACING
    poses[:, :3, 3] = path[:, 1:4]
    placed: FloatArray = rig.canvas_to_robot @ poses
    return placed


def path_of(times_s: FloatArray, poses: FloatArray, rig: Rig) -> FloatArray:
    """The motion [N, 5] in the canvas frame of the tip's poses [N, 4, 4] in the robot's: the inverse of poses_of.

    Yaws are continuous along the motion; NaN stays NaN.
    """
    local = np.linalg.inv(rig.canvas_to_robot) @ poses
    yaw = np.arctan2(local[:, 1, 0], local[:, 0, 0])
    return np.column_stack((times_s, local[:, :3, 3], np.unwrap(yaw)))


def check_reach(poses: FloatArray, rig: Rig, what: str) -> None:
    """Raise EnvelopeViolation if a pose [N, 4, 4] lies out of the rig's reach, or is not finite."""
    low, high = np.array(rig.reach_m)
    places = poses[:, :3, 3]
    outside = ~np.all((places >= low - _SAME_M) & (places <= high + _SAME_M), axis=1)  # true for NaN, too
    if outside.any():
        place = np.round(places[outside][0], 4).tolist()
        raise EnvelopeViolation(
            f"The {what} would lead to {place} m in the robot's frame, out of the reach from {low.tolist()} to "
            f"{high.tolist()} m of {rig.name}; correct the rig's place of the canvas or plan at another place. "
            "The command was refused."
        )
