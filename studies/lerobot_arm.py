"""Whether LeRobot's own SO-101 class paints through the driver `lerobot`, with simulated servos.

    python3 -m venv ENV && ENV/bin/pip install '.[lerobot]'
    ENV/bin/python -m studies.lerobot_arm

Six STS3215 on a pseudo-terminal speak Feetech's protocol, turn at a limited speed and stay in the range that they were
calibrated to. All above them is LeRobot's: connection, calibration, the conversion from degrees to steps. A stroke must
be painted where it was commanded; a lost cable and a missing calibration must be one sentence. Places are tested, and
not times: timeouts are longer than with servos. Exit status 1 where anything differs.
"""

from __future__ import annotations

import importlib.metadata
import json
import os
import pty
import sys
import tempfile
import threading
import time
import tty
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

import pentimento.robots.lerobot as driver
from pentimento.control.guard import GuardedRobot
from pentimento.control.safety import envelope_for
from pentimento.robots.arm import pose_from, tool_of
from pentimento.robots.hardware import HardwareRobot
from pentimento.robots.journey import poses_of
from pentimento.robots.kinematics import load_arm, solve
from pentimento.robots.machine import MachineError
from pentimento.robots.motion import timed_path
from pentimento.robots.rig import Rig, load_rig
from pentimento.robots.tools import load_tool

STEPS, MIDDLE = 4096, 2047
SPEED: Final = 3400.0
"""Steps a second: 300 degrees, an STS3215 at 12 V without a load."""
_PING, _READ, _WRITE, _SYNC_READ, _SYNC_WRITE, _ALL = 1, 2, 3, 0x82, 0x83, 0xFE
_MODEL, _LOW, _HIGH, _TORQUE, _GOAL, _PRESENT = 3, 9, 11, 40, 42, 56
"""Addresses in a servo's memory, of two bytes each, little-endian; the torque's is of one."""
WITHIN_M: Final = 2.5e-3
"""Max distance of a measured place from the commanded one: the servos lag by a period, at 50 mm/s by 1 mm, and half a
step of each joint at 0.3 m of reach adds 0.5 mm."""


class Servos:
    """Servos with the numbers 1 to 6 at the other end of `port`."""

    def __init__(self, angles_deg: list[float], limits_deg: list[float]) -> None:
        """Args: where each stands, and how far it was calibrated to turn to both sides of its middle."""
        self._end, slave = pty.openpty()
        tty.setraw(slave)
        self.port = os.ttyname(slave)
        self.memory = {number: bytearray(256) for number in range(1, len(angles_deg) + 1)}
        for number, (angle, limit) in enumerate(zip(angles_deg, limits_deg, strict=True), 1):
            self._put(number, _MODEL, 777)  # the model number of an STS3215
            self._put(number, _LOW, max(MIDDLE - round(limit * STEPS / 360), 0))
            self._put(number, _HIGH, min(MIDDLE + round(limit * STEPS / 360) + 1, STEPS - 1))
            self._put(number, _PRESENT, MIDDLE + round(angle * (STEPS - 1) / 360))
        self.unplugged = False
        self._moved_s = time.monotonic()
        threading.Thread(target=self._serve, daemon=True).start()

    def get(self, number: int, address: int) -> int:
        return int.from_bytes(self.memory[number][address : address + 2], "little")

    def _put(self, number: int, address: int, value: int) -> None:
        self.memory[number][address : address + 2] = value.to_bytes(2, "little")

    def _serve(self) -> None:
        held = b""
        while True:
            held += os.read(self._end, 1024)
            while len(held) >= 6 and len(held) >= 4 + held[3]:
                packet, held = held[: 4 + held[3]], held[4 + held[3] :]
                assert packet[:2] == b"\xff\xff" and packet[-1] == _checksum(packet[2:-1]), packet.hex()
                if not self.unplugged:
                    self._move()
                    self._answer(packet[2], packet[4], packet[5:-1])

    def _answer(self, number: int, instruction: int, values: bytes) -> None:
        if instruction == _PING:
            for each in self.memory if number == _ALL else [number]:
                self._say(each, b"")
        elif instruction == _READ:
            self._say(number, self.memory[number][values[0] : values[0] + values[1]])
        elif instruction == _WRITE:
            self.memory[number][values[0] : values[0] + len(values) - 1] = values[1:]
            self._say(number, b"")
        elif instruction == _SYNC_READ:
            for each in values[2:]:
                self._say(each, self.memory[each][values[0] : values[0] + values[1]])
        elif instruction == _SYNC_WRITE:
            address, length = values[:2]
            for at in range(2, len(values), length + 1):
                self.memory[values[at]][address : address + length] = values[at + 1 : at + 1 + length]

    def _say(self, number: int, values: bytes) -> None:
        body = bytes([number, len(values) + 2, 0]) + values
        os.write(self._end, b"\xff\xff" + body + bytes([_checksum(body)]))

    def _move(self) -> None:
        """Turn what has torque towards its goal."""
        now_s = time.monotonic()
        reach, self._moved_s = SPEED * (now_s - self._moved_s), now_s
        for number, memory in self.memory.items():
            if memory[_TORQUE] and self.get(number, _GOAL):
                goal = min(max(self.get(number, _GOAL), self.get(number, _LOW)), self.get(number, _HIGH))
                here = self.get(number, _PRESENT)
                self._put(number, _PRESENT, here + round(min(max(goal - here, -reach), reach)))


def _checksum(body: bytes) -> int:
    return ~sum(body) & 0xFF


def main() -> int:
    """Command line; the exit status."""
    rig, arm = load_rig("so101"), load_arm("so101")
    start = solve(
        arm,
        poses_of(np.array([[0, 0.08, 0.06, rig.travel_height_m, 0.0]]), rig)[0],
        pose_from(*tool_of(rig)),
        np.radians([0.0, 20.0, 10.0, 60.0, 0.0]),
    )
    limits = [float(np.degrees(joint.range_rad[1])) for joint in arm.joints]
    servos = Servos([*np.degrees(start).tolist(), 0.0], [*limits, 180.0])
    with tempfile.TemporaryDirectory() as home:
        os.environ["HF_LEROBOT_CALIBRATION"] = home  # read when LeRobot is imported
        patient()
        wired = replace(rig, machine={**rig.machine, "config": {**rig.machine["config"], "port": servos.port}})
        faults = uncalibrated(wired)
        calibrate(servos, [*(joint.name for joint in arm.joints), "gripper"], Path(home), rig)
        faults += painted(wired, servos)
    version = importlib.metadata.version("lerobot")
    print("\n".join(faults) or f"The SO-101 of LeRobot {version} paints a stroke through the driver.")
    return 1 if faults else 0


def patient() -> None:
    """Wait for answers and actions as long as a busy computer needs: places are tested here, and not times."""
    from lerobot.motors.feetech import feetech

    def set_timeout(port: Any, length: int) -> None:
        port.packet_start_time, port.packet_timeout = port.getCurrentTime(), 10_000.0

    feetech.patch_setPacketTimeout = set_timeout
    driver.LATE_S = 600.0  # type: ignore[misc]
    sys.setswitchinterval(1e-4)  # Feetech's package waits without sleeping, which would hold the servos up


def uncalibrated(rig: Rig) -> list[str]:
    """What goes wrong with an arm without a calibration file: a sentence each."""
    try:
        driver.connect(rig)
    except MachineError as error:
        return [] if "lerobot-calibrate" in str(error) else [f"Without a calibration it says: {error}"]
    return ["An arm without a calibration is connected."]


def calibrate(servos: Servos, names: list[str], home: Path, rig: Rig) -> None:
    """Write the file that `lerobot-calibrate` would write of these servos."""
    from lerobot.robots.so_follower import SO101Follower

    entries = {
        name: {
            "id": number,
            "drive_mode": 0,
            "homing_offset": 0,
            "range_min": servos.get(number, _LOW),
            "range_max": servos.get(number, _HIGH),
        }
        for number, name in enumerate(names, 1)
    }
    file = home / "robots" / SO101Follower.name / f"{rig.machine['config']['id']}.json"
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(json.dumps(entries), encoding="utf-8")


def painted(rig: Rig, servos: Servos) -> list[str]:
    """What goes wrong with a stroke, and then with a lost cable: a sentence each."""
    machine = driver.connect(rig)
    tool = load_tool("round_brush")
    robot = GuardedRobot(HardwareRobot(machine, rig, lambda _: None), envelope_for(tool, rig.canvas_size_m))
    robot.change_tool(tool)
    path = stroke()
    begun_s = time.monotonic()
    measured = robot.move(path)
    took_s = time.monotonic() - begun_s
    away_m = np.linalg.norm(measured[:, 1:4] - path[:, 1:4], axis=1)
    print(f"A stroke of {path[-1, 0]:.2f} s, with lift and travel {took_s:.2f} s: {1000 * away_m.max():.2f} mm away.")
    faults = [] if away_m.max() < WITHIN_M else [f"The stroke is {1000 * away_m.max():.1f} mm away from its path."]
    servos.unplugged, port = True, machine._robot.bus.port_handler
    patient_timeout, port.setPacketTimeout = port.setPacketTimeout, lambda _: port.setPacketTimeoutMillis(50)
    try:
        machine.where()
        faults.append("A lost cable is not noticed.")
    except MachineError as error:
        print(f"A lost cable: {error}")
    servos.unplugged, port.setPacketTimeout = False, patient_timeout
    machine.close()
    if any(memory[_TORQUE] for memory in servos.memory.values()):
        faults.append("The servos have torque after the end.")
    return faults


def stroke() -> NDArray[np.float64]:
    """A stroke [24, 5] of 30 mm along x at 50 mm/s, pressed by 2 mm in its middle."""
    s = np.linspace(0, 1, 24)
    return timed_path(np.column_stack((0.06 + 0.03 * s, 0.06 + 0 * s, -0.002 * np.sin(np.pi * s), 0.3 * s)), 0.05)


if __name__ == "__main__":
    sys.exit(main())
