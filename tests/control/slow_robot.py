"""Test support: a robot whose strokes take time, and that logs when its tool goes down and up."""

from __future__ import annotations

import threading
import time
from pathlib import Path

import numpy as np

from pentimento.contracts.observations import Photo
from pentimento.control.robot_process import Ask, RobotProcess
from pentimento.robots.tools import Tool

STROKE = np.array([[0, 0.02, 0.02, -0.0005, 0], [30, 0.06, 0.02, -0.0005, 0]])


class SlowRobot:
    """Writes lines ``down <time>`` and ``up <time>`` into a file."""

    canvas_size_m = (0.1, 0.1)

    def __init__(self, log: Path, ask: Ask) -> None:
        self._log, self._ask, self._halt = log, ask, threading.Event()

    @property
    def clock_s(self) -> float:
        return time.monotonic()

    def change_tool(self, tool: Tool) -> None:
        self._ask(f"Fit the {tool.name}.")

    def load_palette(self, colors_srgb: np.ndarray) -> None:
        raise ValueError("there are no wells.")

    def dip(self, paint: int) -> None: ...

    def wipe(self) -> None: ...

    def force_n(self) -> np.ndarray:
        return np.zeros(0)

    def move(self, path: np.ndarray) -> np.ndarray:
        self._halt.clear()
        self._note("down")
        halted = self._halt.wait(path[-1, 0])
        self._note("up")
        if halted:
            raise RuntimeError("halted.")
        return path

    def lift(self) -> None:
        self._halt.set()
        time.sleep(0.02)
        self._note("up")

    def photo(self) -> Photo:
        return Photo(np.zeros((4, 4, 3), np.uint8), 0.01, 1.0, np.ones(3), time.monotonic())

    def scan(self) -> np.ndarray:
        return np.zeros((2, 2))

    def new_sheet(self) -> None: ...

    def wait(self, seconds: float) -> None:
        time.sleep(seconds)

    def _note(self, what: str) -> None:
        with self._log.open("a") as log:
            log.write(f"{what} {time.monotonic()}\n")


def make(log: Path, ask: Ask) -> SlowRobot:
    """For ``RobotProcess``."""
    return SlowRobot(log, ask)


def broken(log: Path, ask: Ask) -> SlowRobot:
    """For ``RobotProcess``: a robot that cannot be opened."""
    raise ValueError(f"{log.name} is no robot.")


def draw_long_stroke(log: Path) -> None:
    """A process that commands a stroke and is killed during it."""
    robot = RobotProcess(make, (log,), lambda _: None)
    print("drawing", flush=True)
    robot.move(STROKE)


if __name__ == "__main__":
    import sys

    draw_long_stroke(Path(sys.argv[1]))
