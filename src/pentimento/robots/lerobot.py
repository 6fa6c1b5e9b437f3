"""Any robot with LeRobot's `Robot` interface, such as the SO-101 (extra `lerobot`): joint angles in degrees.

The interface has `connect`, `disconnect`, `get_observation`, `send_action` and `action_features`; a joint's angle is
the value `<joint>.pos` of an observation and of an action. Angles come from the arm file (`kinematics`) and are
streamed. All of a motion is solved before its first angle is sent. What the robot changes in an action is refused,
because a command that was clamped leads to another place.
"""

from __future__ import annotations

import importlib
import re
import threading
import time
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.codec import check_keys
from pentimento.contracts.errors import ConfigError
from pentimento.robots.arm import check_start, measured_at, pose_from, resampled, tool_of
from pentimento.robots.kinematics import Arm, hand_pose, load_arm, miss, solve
from pentimento.robots.machine import HaltedError, MachineError
from pentimento.robots.rig import Rig

FloatArray = NDArray[np.float64]

PERIOD_S: Final = 0.02
"""Between two actions; a bus of six servos at 1 Mbaud answers within 10 ms."""
LATE_S: Final = 0.5
"""Max delay of a motion by a busy computer; beyond it the motion is broken off."""
REACHED_M: Final = 2e-4
"""Max distance of a solved pose from the commanded one."""
REACHED_RAD: Final = 0.02
"""Max rotation from it."""
LEAP_RAD: Final = np.radians(10.0)
"""Max turn of a joint at once: from where it stands to a motion's first pose, and from one action to the next. Between
actions it is 500 degrees a second, more than a servo turns."""
_CHECKED: Final = 5  # poses of a motion that are solved before a journey
_ARRIVED_M: Final = 5e-3  # 0.5 degrees of backlash at 0.4 m of reach are 3.5 mm
_SAME_DEG: Final = 0.1  # a servo's step is 0.09 degrees; an action that comes back otherwise was changed
_ARRIVE_S: Final = 1.0  # max time to come to the last pose
_HALT_S: Final = 1.0  # for the stream of actions to end after a halt
_KEYS: Final = frozenset({"robot", "arm", "config", "tool_centre", "tool_turn"})
_CLASS: Final = re.compile(r"[A-Za-z_][\w.]*:[A-Za-z_]\w*")


class LeRobotArm:
    """A Machine and PlanningMachine (see machine.py). The robot's frame is the arm's base frame."""

    def __init__(self, robot: Any, arm: Arm, rig: Rig, sleep: Callable[[float], None] = time.sleep) -> None:
        """`robot` is connected and has LeRobot's `Robot` interface.

        Raises:
            ConfigError: it has no action for a joint of the arm.
        """
        self._robot, self._arm, self._sleep = robot, arm, sleep
        self._halted, self._streaming = threading.Event(), threading.Lock()
        self._keys = [f"{joint.name}.pos" for joint in arm.joints]
        self._hand_to_tip = pose_from(*tool_of(rig))
        missing = sorted(set(self._keys) - set(robot.action_features))
        if missing:
            raise ConfigError(
                f"The robot of rig {rig.name} has no action {', '.join(missing)}; it has "
                f"{', '.join(sorted(robot.action_features))}. Name another arm file."
            )

    def where(self) -> FloatArray:
        return self._tip(self._angles())

    def follow(self, times_s: FloatArray, poses: FloatArray) -> FloatArray:
        even_s, even = resampled(times_s, poses, PERIOD_S)
        with self._streaming:
            here = self._angles()
            self._check_start(self._tip(here), even[0])
            path = self._solved(even, here)
            seen_s, seen = [0.0], [self._tip(here)]
            begun_s, late_s = time.monotonic(), 0.0
            for at_s, angles in zip(even_s[1:], path[1:], strict=True):
                self._refuse_if_halted()
                now_s, due_s = time.monotonic(), begun_s + late_s + at_s
                # A delay is kept: catching up would be too fast, and so would two actions at once after a pause.
                late_s += max(now_s + PERIOD_S / 2 - due_s, 0.0)
                if late_s > LATE_S:
                    raise MachineError(f"The motion was {late_s:.1f} s late: the computer is too busy.")
                self._sleep(max(due_s - now_s, PERIOD_S / 2))
                self._send(angles)
                seen_s.append(float(at_s))
                seen.append(self.where())
            self._await_arrival(poses[-1])
        return measured_at(times_s, seen_s, seen)

    def check_reach(self, motions: Sequence[FloatArray]) -> None:
        """Solves some poses of each motion, each from the one before it; `follow` solves all."""
        angles = self._angles()
        for motion in motions:
            for step in np.linspace(0, len(motion) - 1, _CHECKED).round().astype(int):
                angles = self._reached(motion[step], angles)

    def halt(self) -> None:
        self._halted.set()
        if not self._streaming.acquire(timeout=_HALT_S):
            raise MachineError("The stream of actions to the robot did not end when it was halted.")
        try:
            self._send(self._angles())  # servos hold what they were sent last; now that is where they are
            self._halted.clear()
        finally:
            self._streaming.release()

    def close(self) -> None:
        """LeRobot may let go of the servos then, and the arm sinks: the tool is up and the reach below it is free."""
        self._call("disconnect")

    def _angles(self) -> FloatArray:
        """[J] radians, as the robot measures them now."""
        observation = self._call("get_observation")
        try:
            degrees = np.array([float(observation[key]) for key in self._keys])
        except (KeyError, TypeError, ValueError) as error:
            raise MachineError(f"The robot's observation has no number for each of {', '.join(self._keys)}.") from error
        if not np.isfinite(degrees).all():
            raise MachineError("The robot does not say where its joints are; look at its cables.")
        return np.radians(degrees)

    def _tip(self, angles: FloatArray) -> FloatArray:
        return hand_pose(self._arm, angles) @ self._hand_to_tip

    def _check_start(self, here: FloatArray, start: FloatArray) -> None:
        """The place must be that of the first pose. Servos sag, so that the hand may be tilted; see `LEAP_RAD`."""
        level = here.copy()
        level[:3, :3] = start[:3, :3]
        check_start(level, start, self._arm.name)

    def _solved(self, poses: FloatArray, here: FloatArray) -> FloatArray:
        """[N, J]: the joint angles of poses [N, 4, 4], each from those before it.

        Raises:
            MachineError: a pose is out of reach, or a joint would have to leap. Nothing was sent.
        """
        found = [here]
        for pose in poses:
            found.append(self._reached(pose, found[-1]))
        for before, after in pairwise(found):
            joint = int(np.abs(after - before).argmax())
            if abs(after[joint] - before[joint]) > LEAP_RAD:
                raise MachineError(
                    f"{self._arm.joints[joint].name} would have to turn by "
                    f"{np.degrees(abs(after[joint] - before[joint])):.0f} degrees at once; move the arm by hand so "
                    "that its tool points into the canvas. The motion was not begun."
                )
        return np.array(found[1:])

    def _reached(self, pose: FloatArray, before: FloatArray) -> FloatArray:
        """[J]: the joint angles of a pose [4, 4], from those of the pose before it. MachineError if out of reach."""
        angles = solve(self._arm, pose, self._hand_to_tip, before)
        away_m, turned_rad = miss(self._arm, angles, pose, self._hand_to_tip)
        if away_m > REACHED_M or turned_rad > REACHED_RAD:
            place = np.round(pose[:3, 3], 3).tolist()
            raise MachineError(
                f"The {self._arm.name} cannot bring its tip to {place} m in this direction: it misses by "
                f"{1000 * away_m:.1f} mm and {np.degrees(turned_rad):.1f} degrees. Put the canvas nearer, "
                "level, or turned so that the yaw is in the wrist's range. The motion was not begun."
            )
        return angles

    def _send(self, angles: FloatArray) -> None:
        """Raises MachineError where the robot changes the action."""
        action = dict(zip(self._keys, np.degrees(angles).tolist(), strict=True))
        sent = self._call("send_action", action)
        for key, degrees in action.items():
            if not abs(float(sent.get(key, np.nan)) - degrees) <= _SAME_DEG:
                raise MachineError(
                    f"The robot changed the command of {key[:-4]}; leave max_relative_target out of its config, and "
                    "see that the joint's calibrated range is that of the arm file. The motion was broken off."
                )

    def _await_arrival(self, pose: FloatArray) -> None:
        """Wait until the arm, which lags, is at the last pose."""
        deadline_s = time.monotonic() + _ARRIVE_S
        while np.linalg.norm(self.where()[:3, 3] - pose[:3, 3]) > _ARRIVED_M:
            self._refuse_if_halted()
            if time.monotonic() > deadline_s:
                raise MachineError(
                    f"The {self._arm.name} did not arrive where it was sent; look at it before it goes on."
                )
            self._sleep(PERIOD_S)

    def _refuse_if_halted(self) -> None:
        if self._halted.is_set():
            raise HaltedError(f"The {self._arm.name} was halted.")

    def _call(self, name: str, *arguments: Any) -> Any:
        """A method of the robot. LeRobot's errors are OSError and RuntimeError of many kinds."""
        try:
            return getattr(self._robot, name)(*arguments)
        except (OSError, RuntimeError, ValueError) as error:
            raise MachineError(f"The robot's {name} failed: {error}") from error


def connect(rig: Rig) -> LeRobotArm:
    """The entry point `lerobot`: an object of the class that the rig names, with its `config`, connected.

    Raises:
        ConfigError: a bad table, or a class that is not installed or does not take this config.
        MachineError: the robot does not answer, or was never calibrated.
    """
    where = f"[machine] of rig {rig.name}"
    check_keys(rig.machine, _KEYS, frozenset(), where)
    name, config = rig.machine["robot"], rig.machine["config"]
    if not isinstance(name, str) or not _CLASS.fullmatch(name) or not isinstance(config, dict):
        raise ConfigError(f'{where}: robot is "package.module:Class", and [machine.config] a table of its settings.')
    arm = load_arm(rig.machine["arm"])
    module, _, kind = name.partition(":")
    try:
        made = getattr(importlib.import_module(module), kind)
        robot = made(made.config_class(**config))
    except ImportError as error:
        raise ConfigError(
            f"{where}: {module} is not installed ({error}); LeRobot is with: pip install 'pentimento[lerobot]'."
        ) from error
    except (AttributeError, TypeError, ValueError) as error:
        raise ConfigError(f"{where}: {name} cannot be made with this config: {error}.") from error
    try:
        robot.connect(calibrate=False)
        calibrated = robot.is_calibrated  # LeRobot asks the servos
    except (OSError, RuntimeError) as error:
        raise MachineError(f"The robot of rig {rig.name} cannot be reached: {error}") from error
    if not calibrated:
        robot.disconnect()
        raise MachineError(f"The robot of rig {rig.name} is not calibrated; run lerobot-calibrate for it first.")
    return LeRobotArm(robot, arm, rig)
