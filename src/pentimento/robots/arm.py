"""What the drivers of arms share: the tool centre, resampled motions, velocities, and the check of the start pose."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pentimento.contracts.errors import ConfigError
from pentimento.robots.machine import MachineError
from pentimento.robots.rig import Rig, lengths, rotation_of

FloatArray = NDArray[np.float64]

START_M = 0.002
"""Max distance of the tip from a motion's first pose; beyond it the arm would jump at its maximum speed."""
START_RAD = 0.02
"""Max rotation from it, likewise."""


def tool_of(rig: Rig) -> tuple[FloatArray, FloatArray]:
    """The tip in the flange's (or hand's) frame, from a rig's [machine]: place [3] in metres, roll, pitch, yaw [3]."""
    where = f"[machine] of rig {rig.name}"
    centre = lengths(rig.machine["tool_centre"], 3, f"tool_centre in {where}")
    turn = lengths(rig.machine["tool_turn"], 3, f"tool_turn in {where}", "rad")
    return np.array(centre), np.array(turn)


def pose_from(place_m: FloatArray, turn_rad: FloatArray) -> FloatArray:
    """Pose [4, 4] of a place [3] and roll, pitch, yaw [3] (R = Rz Ry Rx)."""
    pose = np.eye(4)
    pose[:3, :3] = rotation_of(*(float(angle) for angle in turn_rad))
    pose[:3, 3] = place_m
    return pose


def roll_pitch_yaw(rotation: FloatArray) -> FloatArray:
    """Roll, pitch, yaw [3] of a rotation [3, 3]: the inverse of rig.rotation_of, with the pitch within ±90°."""
    pitch = np.arcsin(np.clip(-rotation[2, 0], -1.0, 1.0))
    roll = np.arctan2(rotation[2, 1], rotation[2, 2])
    yaw = np.arctan2(rotation[1, 0], rotation[0, 0])
    return np.array([roll, pitch, yaw])


def quaternion(rotation: FloatArray) -> FloatArray:
    """Unit quaternion [4] (x, y, z, w) of a rotation [3, 3]."""
    return np.asarray(Rotation.from_matrix(rotation).as_quat(canonical=True))


def resampled(times_s: FloatArray, poses: FloatArray, period_s: float) -> tuple[FloatArray, FloatArray]:
    """The motion at equal time steps of at most a period, both ends included: times [M] and poses [M, 4, 4].

    Places are interpolated linearly, rotations about the axis from one to the next.
    """
    count = int(np.ceil(times_s[-1] / period_s)) + 1
    even_s = np.linspace(0.0, times_s[-1], max(count, 2))
    before = np.clip(np.searchsorted(times_s, even_s, side="right") - 1, 0, len(times_s) - 2)
    share = (even_s - times_s[before]) / (times_s[before + 1] - times_s[before])
    even = np.zeros((len(even_s), 4, 4))
    even[:, 3, 3] = 1.0
    places = poses[:, :3, 3]
    even[:, :3, 3] = places[before] + share[:, None] * (places[before + 1] - places[before])
    turns = Rotation.from_matrix([a[:3, :3].T @ b[:3, :3] for a, b in pairwise(poses)]).as_rotvec()
    for index, (step, part) in enumerate(zip(before, share, strict=True)):
        even[index, :3, :3] = poses[step, :3, :3] @ Rotation.from_rotvec(part * turns[step]).as_matrix()
    return even_s, even


def velocities(times_s: FloatArray, poses: FloatArray) -> FloatArray:
    """Velocities [N, 6] along a motion, m/s and rad/s in the robot's frame: central differences, rest at both ends."""
    found = np.zeros((len(times_s), 6))
    for i in range(1, len(times_s) - 1):
        span_s = times_s[i + 1] - times_s[i - 1]
        found[i, :3] = (poses[i + 1, :3, 3] - poses[i - 1, :3, 3]) / span_s
        found[i, 3:] = Rotation.from_matrix(poses[i + 1, :3, :3] @ poses[i - 1, :3, :3].T).as_rotvec() / span_s
    return found


def check_start(here: FloatArray, start: FloatArray, who: str) -> None:
    """Raise MachineError unless the tip is at a motion's first pose [4, 4]."""
    if not np.isfinite(here).all():
        raise MachineError(f"The {who} does not say where its tip is. The motion was not begun.")
    apart_m = float(np.linalg.norm(here[:3, 3] - start[:3, 3]))
    apart_rad = float(Rotation.from_matrix(here[:3, :3].T @ start[:3, :3]).magnitude())
    if apart_m > START_M or apart_rad > START_RAD:
        raise MachineError(
            f"The {who}'s tip stands {1000 * apart_m:.1f} mm and {np.degrees(apart_rad):.1f} degrees from where the "
            "next motion begins; was it moved by hand? The motion was not begun."
        )


def measured_at(times_s: FloatArray, seen_s: list[float], seen: list[FloatArray]) -> FloatArray:
    """Poses [N, 4, 4] at the motion's times, from the poses measured during it; NaN where fewer than two were.

    Positions are interpolated; a rotation is that of the measurement before.
    """
    poses = np.full((len(times_s), 4, 4), np.nan)
    if len(seen) < 2:
        return poses
    at, places = np.array(seen_s), np.array(seen)
    nearest = np.clip(np.searchsorted(at, times_s, side="right") - 1, 0, len(at) - 1)
    poses[:] = places[nearest]
    for axis in range(3):
        poses[:, axis, 3] = np.interp(times_s, at, places[:, axis, 3])
    return poses


def number(value: Any, low: float, high: float, where: str) -> float:
    """A number of a rig file within its range; ConfigError names the entry."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
        raise ConfigError(f"{where} is {value!r}; it is a number from {low:g} to {high:g}.")
    return float(value)
