"""Test support: a machine whose tip presses real heights down, and a camera program that saves them into a folder."""

from __future__ import annotations

import math
import threading
from pathlib import Path

import numpy as np

from pentimento.contracts.frames import pixel_to_canvas
from pentimento.contracts.observations import Scan
from pentimento.control.robot_process import Ask
from pentimento.robots.journey import path_of, poses_of
from pentimento.robots.machine import HaltedError
from pentimento.robots.rig import Rig
from pentimento.robots.sculpting import HardwareSculptor

RADIUS_M = 0.008


class ClayMachine:
    """A Machine (see robots/machine.py) that follows at once; below the surface its ball leaves a groove."""

    def __init__(self, rig: Rig, pixels: int = 48, height_m: float = 0.03) -> None:
        self.rig, self.ways = rig, list[np.ndarray]()
        self.pose = poses_of(np.array([[0.0, 0.1, 0.1, rig.travel_height_m, 0.0]]), rig)[0]
        self.height_m = np.full((pixels, pixels), height_m)
        side_m = rig.canvas_size_m[0]
        rows, columns = np.indices(self.height_m.shape)
        places = np.stack([columns, rows], axis=-1)
        self._xy_m = pixel_to_canvas(places, np.array([0.0, 0.0, side_m, side_m]), pixels / side_m)
        self._halted = False

    def where(self) -> np.ndarray:
        return self.pose

    def follow(self, times_s: np.ndarray, poses: np.ndarray) -> np.ndarray:
        if self._halted:
            raise HaltedError("halted")
        path = path_of(times_s, poses, self.rig)
        self.ways.append(path)
        for x, y, z in path[:, 1:4]:
            across = np.hypot(*(self._xy_m - (x, y)).transpose(2, 0, 1))
            ball = z + RADIUS_M - np.sqrt(np.clip(RADIUS_M**2 - across**2, 0, None))
            under = across < RADIUS_M
            self.height_m[under] = np.minimum(self.height_m[under], ball[under])
        self.pose = poses[-1]
        return poses.copy()

    def halt(self) -> None:
        """It is always at rest when it is called."""

    def close(self) -> None:
        self._halted = True


class CameraProgram:
    """Saves the heights of a machine's clay into a folder, again and again, until it is ended."""

    def __init__(self, machine: ClayMachine, folder: Path) -> None:
        self._machine, self._folder, self._end = machine, folder, threading.Event()
        self._thread = threading.Thread(target=self._save, daemon=True)
        self._thread.start()

    def _save(self) -> None:
        number = 0
        while not self._end.wait(0.05):
            number += 1
            with (self._folder / "part").open("wb") as file:
                np.save(file, self._machine.height_m + 1e-5 * math.sin(number))
            (self._folder / "part").rename(self._folder / f"scan_{number:05}.npy")

    def end(self) -> None:
        self._end.set()
        self._thread.join()


class HeightScanner:
    """A Scanner (see robots/scanner.py) of a machine's clay."""

    def __init__(self, machine: ClayMachine) -> None:
        self._machine = machine

    def scan(self) -> Scan:
        window = np.array([0.0, 0.0, *self._machine.rig.canvas_size_m])
        return Scan(self._machine.height_m.copy(), window, np.full(3, np.nan), "clay", math.nan)

    def close(self) -> None: ...


def make_sculptor(rig: Rig, ask: Ask) -> HardwareSculptor:
    """A robot for ``SculptingRobotProcess``."""
    machine = ClayMachine(rig)
    return HardwareSculptor(machine, rig, HeightScanner(machine), ask)
