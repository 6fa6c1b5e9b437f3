"""UFACTORY's xArm, through its maker's package `xarm-python-sdk` (extra `xarm`): millimetres and degrees.

Poses are streamed in servo mode, a hundred a second. The controller executes nothing that was not sent, so that an arm
whose link is lost stays where it is. Errors of the controller are never cleared from here.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.codec import check_keys
from pentimento.contracts.errors import ConfigError
from pentimento.robots.arm import check_start, measured_at, number, pose_from, resampled, roll_pitch_yaw, tool_of
from pentimento.robots.machine import HaltedError, MachineError
from pentimento.robots.rig import Rig, lengths

FloatArray = NDArray[np.float64]

PERIOD_S = 0.01
"""Between poses; the controller takes 100 to 250 a second."""
LATE_S = 0.5
"""Max delay of a motion by a busy computer; beyond it the motion is broken off."""
_SERVO = 1  # of set_mode
_READY = 0  # of set_state
_STOP = 4  # of set_state
_ARRIVED_M = 1e-3  # max distance from a motion's last pose
_ARRIVE_S = 1.0  # max time to come so near
_HALT_S = 1.0  # for the stream of poses to end after a halt
_KEYS = frozenset({"address", "tool_centre", "tool_turn", "load_kg", "load_centre", "collision_sensitivity"})


class XArm:
    """A Machine and PlanningMachine (see machine.py). The robot's frame is the arm's base frame."""

    def __init__(self, api: Any, rig: Rig, sleep: Callable[[float], None] = time.sleep) -> None:
        """`api` is an open `xarm.wrapper.XArmAPI`. Sets tool, load, fence and servo mode; MachineError if refused."""
        self._api, self._sleep = api, sleep
        self._halted, self._streaming = threading.Event(), threading.Lock()
        self._check_errors()
        centre_m, turn_rad = tool_of(rig)
        where = f"[machine] of rig {rig.name}"
        load_m = lengths(rig.machine["load_centre"], 3, f"load_centre in {where}")
        low, high = rig.reach_m
        fence_mm = [bound for k in range(3) for bound in (math.ceil(1000 * high[k]), math.floor(1000 * low[k]))]
        self._done("motion_enable", api.motion_enable(True))
        tool = [*(1000 * centre_m).tolist(), *np.degrees(turn_rad).tolist()]
        self._done("set_tcp_offset", api.set_tcp_offset(tool, is_radian=False))
        load_kg = number(rig.machine["load_kg"], 0, 10, f"load_kg in {where}")
        self._done("set_tcp_load", api.set_tcp_load(load_kg, [1000 * value for value in load_m]))
        sensitivity = number(rig.machine["collision_sensitivity"], 0, 5, f"collision_sensitivity in {where}")
        self._done("set_collision_sensitivity", api.set_collision_sensitivity(int(sensitivity)))
        # The controller's fence is a second check of the reach.
        self._done("set_reduced_tcp_boundary", api.set_reduced_tcp_boundary(fence_mm))
        self._done("set_fence_mode", api.set_fence_mode(True))
        self._make_ready()

    def where(self) -> FloatArray:
        code, pose = self._api.get_position(is_radian=False)
        self._done("get_position", code)
        return pose_from(np.array(pose[:3]) / 1000, np.radians(pose[3:6]))

    def follow(self, times_s: FloatArray, poses: FloatArray) -> FloatArray:
        even_s, even = resampled(times_s, poses, PERIOD_S)
        with self._streaming:
            check_start(self.where(), poses[0], "xArm")
            seen_s: list[float] = [0.0]
            seen = [self.where()]
            begun_s = time.monotonic()
            late_s = 0.0
            for at_s, pose in zip(even_s[1:], even[1:], strict=True):
                self._refuse_if_halted()
                now_s, due_s = time.monotonic(), begun_s + late_s + at_s
                # A delay is kept: catching up would be too fast, and so would two poses at once after a pause.
                late_s += max(now_s + PERIOD_S / 2 - due_s, 0.0)
                if late_s > LATE_S:
                    raise MachineError(f"The motion was {late_s:.1f} s late: the computer is too busy.")
                self._sleep(max(due_s - now_s, PERIOD_S / 2))
                self._done("set_servo_cartesian", self._api.set_servo_cartesian(_target(pose), is_radian=False))
                seen_s.append(float(at_s))
                seen.append(self.where())
            self._await_arrival(poses[-1])
            seen_s.append(float(times_s[-1]) + PERIOD_S)
            seen.append(self.where())
        return measured_at(times_s, seen_s, seen)

    def check_reach(self, motions: Sequence[FloatArray]) -> None:
        """Asks the controller for the joint angles at the end of each motion; the way between is straight."""
        for motion in motions:
            code, _ = self._api.get_inverse_kinematics(_target(motion[-1]), input_is_radian=False)
            if code != 0:
                place = np.round(motion[-1, :3, 3], 3).tolist()
                raise MachineError(
                    f"The xArm cannot bring its tip to {place} m in this direction (code {code}); put the canvas "
                    "nearer, or correct the rig's reach. The motion was not begun."
                )

    def halt(self) -> None:
        self._halted.set()
        self._done("set_state", self._api.set_state(_STOP))
        if not self._streaming.acquire(timeout=_HALT_S):
            raise MachineError("The stream of poses to the xArm did not end when it was halted.")
        try:
            self._halted.clear()
            self._check_errors()
            self._done("motion_enable", self._api.motion_enable(True))
            self._make_ready()
        finally:
            self._streaming.release()

    def close(self) -> None:
        self._api.disconnect()

    def _make_ready(self) -> None:
        self._done("set_mode", self._api.set_mode(_SERVO))
        self._done("set_state", self._api.set_state(_READY))

    def _refuse_if_halted(self) -> None:
        if self._halted.is_set():
            raise HaltedError("The xArm was halted.")

    def _await_arrival(self, pose: FloatArray) -> None:
        """Wait until the arm, which lags by a few poses, is at the last one."""
        deadline_s = time.monotonic() + _ARRIVE_S
        while np.linalg.norm(self.where()[:3, 3] - pose[:3, 3]) > _ARRIVED_M:
            self._refuse_if_halted()
            if time.monotonic() > deadline_s:
                raise MachineError("The xArm did not arrive where it was sent; look at it before it goes on.")
            self._sleep(PERIOD_S)

    def _check_errors(self) -> None:
        code, (error, _warning) = self._api.get_err_warn_code()
        self._done("get_err_warn_code", code)
        if error:
            raise MachineError(
                f"The xArm's controller reports error {error}; look at the arm, clear the error in UFACTORY Studio, "
                "and lift the tool by hand. It is not cleared from here."
            )

    def _done(self, call: str, code: int) -> None:
        if code != 0:
            if self._halted.is_set():
                raise HaltedError("The xArm was halted.")
            raise MachineError(
                f"The xArm answered {call} with code {code} (see its maker's list); the motion was broken off."
            )


def _target(pose: FloatArray) -> list[float]:
    """A pose [4, 4] as the controller takes it: x, y, z in mm, roll, pitch, yaw in degrees."""
    return [*(1000 * pose[:3, 3]).tolist(), *np.degrees(roll_pitch_yaw(pose[:3, :3])).tolist()]


def connect(rig: Rig) -> XArm:
    """The entry point `xarm`. Raises ConfigError where the extra is missing, MachineError where nobody answers."""
    check_keys(rig.machine, _KEYS, frozenset(), f"[machine] of rig {rig.name}")
    try:
        from xarm.wrapper import XArmAPI
    except ImportError as error:
        raise ConfigError(
            "The xArm needs its maker's package; install it with: pip install 'pentimento[xarm]'."
        ) from error
    api = XArmAPI(rig.machine["address"], is_radian=False)
    if not api.connected:
        raise MachineError(f"Nobody answers at {rig.machine['address']}; check the cable and the address.")
    return XArm(api, rig)
