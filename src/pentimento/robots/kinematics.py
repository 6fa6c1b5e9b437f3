"""Forward and inverse kinematics of an arm of revolute joints in series, from an arm file.

The inverse is Levenberg–Marquardt on the twist from the tip to its target (Sugihara 2011, with a constant damping). An
arm of five joints reaches every place with an upright tool and any yaw in its range; a tilted target leaves a rest.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pentimento.contracts.codec import check_keys, find_toml, from_table, read_toml
from pentimento.contracts.errors import ConfigError
from pentimento.robots.arm import pose_from

FloatArray = NDArray[np.float64]

_ARMS: Final = Path(__file__).with_name("arms")
_ROUNDS: Final = 100
_DAMPING: Final = 1e-5
_LEVER_M: Final = 0.1
"""Lever arm that makes rotations comparable with displacements: the length of a hand with its tool."""
_ENOUGH: Final = 1e-9
"""Step of the joints (rad) at which the search ends."""


@dataclass(frozen=True)
class Joint:
    """A joint that turns about the z axis of its frame."""

    name: str
    place_m: tuple[float, float, float]
    """Of its frame in that of the joint before it; of the first, in the arm's base frame."""
    turn_rad: tuple[float, float, float]
    """Roll, pitch, yaw of that frame at the joint's zero (R = Rz Ry Rx)."""
    range_rad: tuple[float, float]


@dataclass(frozen=True)
class Arm:
    """The joints of an arm from its base to its hand."""

    name: str
    joints: tuple[Joint, ...]

    @property
    def ranges_rad(self) -> FloatArray:
        """[J, 2]: minimum and maximum of each joint."""
        return np.array([joint.range_rad for joint in self.joints])

    @cached_property
    def fixed(self) -> list[FloatArray]:
        """Pose [4, 4] of each joint's frame in that of the joint before it, at its zero."""
        return [pose_from(np.array(joint.place_m), np.array(joint.turn_rad)) for joint in self.joints]


def load_arm(name_or_path: str | Path) -> Arm:
    """Read an arm by the name of a shipped file (`so101`) or by the path of a TOML file.

    Raises:
        ConfigError: an unknown name, an unreadable file, or an unknown, missing or bad key.
    """
    where = f"Arm {name_or_path}"
    table = read_toml(find_toml(name_or_path, _ARMS, "arm"), "arm")
    check_keys(table, frozenset({"name", "joints"}), frozenset(), where)
    if not isinstance(table["joints"], list):
        raise ConfigError(f"{where}: write each joint as a table [[joints]].")
    joints = [from_table(Joint, one, f"{where}, joint {number}") for number, one in enumerate(table["joints"], 1)]
    arm = Arm(str(table["name"]), tuple(joints))
    if not arm.joints:
        raise ConfigError(f"{where} has no joints; list them from the base to the hand.")
    if len({joint.name for joint in arm.joints}) < len(arm.joints):
        raise ConfigError(f"{where} names two joints alike; give each its name.")
    for joint in arm.joints:
        if not joint.range_rad[0] < joint.range_rad[1]:
            raise ConfigError(f"{where}: range of {joint.name} must rise.")
    return arm


def hand_pose(arm: Arm, angles_rad: FloatArray) -> FloatArray:
    """Pose [4, 4], last joint's frame -> base, at joint angles [J]."""
    return _frames(arm, angles_rad)[-1]


def solve(arm: Arm, target: FloatArray, hand_to_tip: FloatArray, start_rad: FloatArray) -> FloatArray:
    """Joint angles [J] within their ranges at which the tip comes as near to a pose as it can from ``start_rad``.

    Args:
        target: [4, 4], tip -> base.
        hand_to_tip: [4, 4], tip -> the last joint's frame.

    Whether it is near enough is for the caller to check, with ``miss``.
    """
    low, high = arm.ranges_rad.T
    angles = np.clip(start_rad, low, high)
    for _ in range(_ROUNDS):
        error, jacobian = _twist(arm, angles, target, hand_to_tip)
        step = np.linalg.solve(jacobian.T @ jacobian + _DAMPING * np.eye(len(angles)), jacobian.T @ error)
        moved = np.clip(angles + step, low, high)
        if np.abs(moved - angles).max() < _ENOUGH:
            return moved
        angles = moved
    return angles


def miss(arm: Arm, angles_rad: FloatArray, target: FloatArray, hand_to_tip: FloatArray) -> tuple[float, float]:
    """Distance in metres and rotation in radians from the tip to a target pose [4, 4]."""
    tip = hand_pose(arm, angles_rad) @ hand_to_tip
    turn = Rotation.from_matrix(tip[:3, :3].T @ target[:3, :3]).magnitude()
    return float(np.linalg.norm(tip[:3, 3] - target[:3, 3])), float(turn)


def _frames(arm: Arm, angles_rad: FloatArray) -> list[FloatArray]:
    """Pose [4, 4] of each joint's frame in the base frame, turned by its angle."""
    pose, found = np.eye(4), []
    for fixed, cos, sin in zip(arm.fixed, np.cos(angles_rad), np.sin(angles_rad), strict=True):
        pose = pose @ fixed
        pose[:, :2] = pose[:, :2] @ np.array([[cos, -sin], [sin, cos]])
        found.append(pose)
    return found


def _twist(arm: Arm, angles: FloatArray, target: FloatArray, hand_to_tip: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The way left to the target [6] in metres (rotations by ``_LEVER_M``), and its Jacobian [6, J]."""
    frames = _frames(arm, angles)
    tip = frames[-1] @ hand_to_tip
    turn = Rotation.from_matrix(target[:3, :3] @ tip[:3, :3].T).as_rotvec()
    error = np.concatenate([target[:3, 3] - tip[:3, 3], _LEVER_M * turn])
    axes = np.array([frame[:3, 2] for frame in frames])
    levers = tip[:3, 3] - np.array([frame[:3, 3] for frame in frames])
    return error, np.vstack([np.cross(axes, levers).T, _LEVER_M * axes.T])
