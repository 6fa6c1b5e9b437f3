"""Rigs, machines and what is done with them, for tests without any hardware."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np

from pentimento.control.guard import GuardedRobot
from pentimento.control.safety import envelope_for
from pentimento.robots.hardware import HardwareRobot
from pentimento.robots.machine import HaltedError, Machine
from pentimento.robots.motion import timed_path
from pentimento.robots.rig import Palette, Rig
from pentimento.robots.tools import load_tool


def make_rig(**changes: object) -> Rig:
    """A level canvas of 0.3 x 0.2 m, a quarter turned, with two paints at its right."""
    entries: dict[str, object] = {
        "name": "bench",
        "driver": "fake",
        "canvas_size_m": (0.3, 0.2),
        "origin_m": (0.4, 0.1, 0.05),
        "turn_rad": (0.0, 0.0, np.pi / 2),
        "reach_m": ((0.1, 0.0, 0.03), (0.5, 0.6, 0.3)),
        "travel_height_m": 0.03,
        "travel_speed_m_s": 0.1,
        "palette": Palette(((0.34, 0.05), (0.34, 0.1)), (0.38, 0.05), (0.38, 0.1), 0.004),
        "park_m": (0.1, -0.05),
        "digest": "0" * 64,
    }
    return Rig(**(entries | changes))  # type: ignore[arg-type]


class FakeMachine:
    """Follows exactly, in no time; notes every way in the robot's frame."""

    def __init__(self, start: np.ndarray) -> None:
        self.pose = start
        self.ways: list[tuple[np.ndarray, np.ndarray]] = []
        self.halts = 0
        self.closed = False
        self.at_way: dict[int, Callable[[], None]] = {}
        self.halted = threading.Event()

    def where(self) -> np.ndarray:
        return self.pose

    def follow(self, times_s: np.ndarray, poses: np.ndarray) -> np.ndarray:
        number = len(self.ways)
        self.ways.append((times_s, poses))
        if number in self.at_way:
            self.pose = poses[len(poses) // 2]
            self.at_way[number]()
            raise HaltedError("halted")
        self.pose = poses[-1]
        return poses.copy()

    def halt(self) -> None:
        self.halts += 1
        self.halted.set()

    def close(self) -> None:
        self.closed = True


def guarded(machine: Machine, rig: Rig) -> GuardedRobot:
    """A machine as a guarded robot that holds the round brush."""
    tool = load_tool("round_brush")
    guard = GuardedRobot(HardwareRobot(machine, rig, lambda _: None), envelope_for(tool, rig.canvas_size_m))
    guard.change_tool(tool)
    return guard


def stroke_at(x_m: float = 0.1) -> np.ndarray:
    """A stroke [24, 5] of 40 mm along x at 60 mm/s, pressed by 2 mm in its middle."""
    s = np.linspace(0, 1, 24)
    return timed_path(np.column_stack((x_m + 0.04 * s, 0.1 + 0 * s, -0.002 * np.sin(np.pi * s), 0.5 + 0 * s)), 0.06)


@contextmanager
def in_thread(act: Callable[[], object]) -> Iterator[list[BaseException]]:
    """Act in a thread beside the block, which gets a list for the error of it, and wait for its end."""
    errors: list[BaseException] = []

    def acting() -> None:
        try:
            act()
        except BaseException as error:
            errors.append(error)

    thread = threading.Thread(target=acting)
    thread.start()
    yield errors
    thread.join(5)
