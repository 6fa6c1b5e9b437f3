"""Franka's Panda and Research 3, through the package `franky-control` (extra `franka`): metres and quaternions.

One command is one motion of waypoints, each with its velocity and time. The arm's controller follows it in real time
and stops where a contact exceeds the force or torque limit. Errors of the controller are never cleared from here.
"""

from __future__ import annotations

import threading
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.codec import check_keys, quantities
from pentimento.contracts.errors import ConfigError
from pentimento.robots.arm import (
    check_start,
    measured_at,
    number,
    pose_from,
    quaternion,
    resampled,
    tool_of,
    velocities,
)
from pentimento.robots.machine import HaltedError, MachineError
from pentimento.robots.rig import Rig

FloatArray = NDArray[np.float64]

PERIOD_S = 0.02
"""Between waypoints; their times are whole milliseconds."""
_LOOK_S = 0.02  # between two measured poses
_LATE = 2.0  # a motion counts as stuck after this many times its duration plus this many seconds
_ARRIVED_M = 1e-3  # max distance from the last pose at the end of a motion
_HALT_S = 1.0  # for a motion to end after a halt
_KEYS = frozenset({"address", "tool_centre", "tool_turn", "dynamics", "force_limit", "torque_limit_nm"})


class Franka:
    """A Machine (see machine.py). The robot's frame is the arm's base frame."""

    def __init__(self, robot: Any, franky: Any, rig: Rig) -> None:
        """`robot` is a connected `franky.Robot`, `franky` its module. Sets the limits; MachineError after an error."""
        self._robot, self._franky = robot, franky
        self._halted, self._moving = threading.Event(), threading.Lock()
        self._hand_to_tip = pose_from(*tool_of(rig))
        self._check_errors()
        where = f"[machine] of rig {rig.name}"
        force_n = quantities(rig.machine["force_limit"], "N", f"force_limit in {where}")
        torque_nm = number(rig.machine["torque_limit_nm"], 1, 100, f"torque_limit_nm in {where}")
        robot.relative_dynamics_factor = number(rig.machine["dynamics"], 0.01, 1, f"dynamics in {where}")
        robot.set_collision_behavior(torque_nm, number(force_n, 1, 100, f"force_limit (N) in {where}"))

    def where(self) -> FloatArray:
        hand: FloatArray = np.array(self._robot.current_pose.end_effector_pose.matrix, dtype=np.float64)
        return hand @ self._hand_to_tip

    def follow(self, times_s: FloatArray, poses: FloatArray) -> FloatArray:
        even_s, even = resampled(times_s, poses, PERIOD_S)
        with self._moving:
            if self._halted.is_set():
                raise HaltedError("The Franka was halted.")
            self._check_errors()
            check_start(self.where(), poses[0], "Franka")
            motion = self._motion(even_s, even)
            begun_s = time.monotonic()
            seen_s, seen = [0.0], [self.where()]
            try:
                self._robot.move(motion, asynchronous=True)
                while self._robot.poll_motion():
                    took_s = time.monotonic() - begun_s
                    if took_s > _LATE * times_s[-1] + _LATE:
                        self._robot.stop()
                        raise MachineError("The Franka is stuck in its motion; look at it before it goes on.")
                    time.sleep(_LOOK_S)
                    seen_s.append(took_s)
                    seen.append(self.where())
            except self._franky.Exception as error:
                if self._halted.is_set():
                    raise HaltedError("The Franka was halted.") from error
                raise MachineError(f"The Franka broke the motion off: {error}") from error
            if self._halted.is_set():
                raise HaltedError("The Franka was halted.")
            if np.linalg.norm(self.where()[:3, 3] - poses[-1, :3, 3]) > _ARRIVED_M:
                raise MachineError("The Franka did not arrive where it was sent; look at it before it goes on.")
        # The arm may take a little longer than planned; measured times are scaled to the motion's.
        took_s = max(seen_s[-1], 1e-9)
        at_s = [moment / took_s * float(times_s[-1]) for moment in seen_s]
        return measured_at(times_s, at_s, seen)

    def halt(self) -> None:
        self._halted.set()
        try:
            self._robot.stop()
        except self._franky.Exception as error:
            raise MachineError(f"The Franka could not be stopped: {error}") from error
        if not self._moving.acquire(timeout=_HALT_S):
            raise MachineError("The Franka's motion did not end when it was halted.")
        try:
            self._halted.clear()
            self._check_errors()
        finally:
            self._moving.release()

    def close(self) -> None:
        """franky has nothing to close: its connection ends with the object."""
        self._robot.stop()

    def _motion(self, times_s: FloatArray, poses: FloatArray) -> Any:
        """One motion of waypoints. Their times are rounded so that the errors do not add up."""
        franky = self._franky
        whole_ms = np.rint(1000 * times_s).astype(int)
        speeds = velocities(times_s, poses)
        waypoints = []
        for step in range(1, len(times_s)):
            pose = franky.Affine(poses[step, :3, 3], quaternion(poses[step, :3, :3]))
            velocity = franky.RobotVelocity(franky.Twist(speeds[step, :3], speeds[step, 3:]))
            waypoints.append(
                franky.CartesianWaypoint(
                    franky.CartesianState(franky.RobotPose(pose), velocity),
                    franky.ReferenceType.Absolute,
                    minimum_time=franky.Duration(int(whole_ms[step] - whole_ms[step - 1])),
                )
            )
        tip = franky.Affine(self._hand_to_tip[:3, 3], quaternion(self._hand_to_tip[:3, :3]))
        return franky.CartesianWaypointMotion(waypoints, ee_frame=tip)

    def _check_errors(self) -> None:
        if self._robot.has_errors:
            raise MachineError(
                "The Franka's controller reports an error; look at the arm, recover it in Franka Desk, and lift the "
                "tool by hand. It is not cleared from here."
            )


def connect(rig: Rig) -> Franka:
    """The entry point `franka`. Raises ConfigError where the extra is missing, MachineError where nobody answers."""
    check_keys(rig.machine, _KEYS, frozenset(), f"[machine] of rig {rig.name}")
    try:
        import franky
    except ImportError as error:
        raise ConfigError(
            "The Franka needs the package franky; install it with: pip install 'pentimento[franka]'."
        ) from error
    try:
        robot = franky.Robot(rig.machine["address"])
    except franky.Exception as error:
        raise MachineError(f"The Franka at {rig.machine['address']} cannot be reached: {error}") from error
    return Franka(robot, franky, rig)
