"""A rig and a machine for tests, without any hardware."""

import threading
from collections.abc import Callable

import numpy as np

from pentimento.robots.machine import HaltedError
from pentimento.robots.rig import Palette, Rig


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
