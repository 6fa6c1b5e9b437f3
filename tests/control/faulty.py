"""Test support: a robot whose camera, link, pen and time can fail on demand."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np

from pentimento.contracts.observations import Photo
from pentimento.robots.driver import Robot
from pentimento.robots.tools import Tool


class FaultyRobot:
    """Passes every command to a robot through functions that a test sets."""

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self.moves = 0
        self.lifts: list[float] = []
        """Times of lifts, by time.monotonic."""
        self.on_move: Callable[[int, np.ndarray], np.ndarray] = lambda _number, path: path
        self.on_photo: Callable[[Photo], Photo] = lambda photo: photo

    @property
    def canvas_size_m(self) -> tuple[float, float]:
        return self.robot.canvas_size_m

    @property
    def clock_s(self) -> float:
        return self.robot.clock_s

    def change_tool(self, tool: Tool) -> None:
        self.robot.change_tool(tool)

    def load_palette(self, colors_srgb: np.ndarray) -> None:
        self.robot.load_palette(colors_srgb)

    def dip(self, paint: int) -> None:
        self.robot.dip(paint)

    def wipe(self) -> None:
        self.robot.wipe()

    def move(self, path: np.ndarray) -> np.ndarray:
        self.moves += 1
        return self.robot.move(self.on_move(self.moves, path))

    def force_n(self) -> np.ndarray:
        return self.robot.force_n()

    def lift(self) -> None:
        self.lifts.append(time.monotonic())
        self.robot.lift()

    def photo(self) -> Photo:
        return self.on_photo(self.robot.photo())

    def scan(self) -> np.ndarray:
        return self.robot.scan()

    def new_sheet(self) -> None:
        self.robot.new_sheet()

    def wait(self, seconds: float) -> None:
        self.robot.wait(seconds)


def black(photo: Photo) -> Photo:
    """A black frame, as with a lens cap."""
    return replace(photo, frame=np.zeros_like(photo.frame))


def shifted(photo: Photo) -> Photo:
    """The frame after the camera moved by 12 pixels."""
    moved = cv2.warpAffine(
        photo.frame, np.float32([[1, 0, 12], [0, 1, 5]]), photo.frame.shape[1::-1], borderValue=(90,) * 3
    )
    return replace(photo, frame=moved)


def with_a_hand(photo: Photo) -> Photo:
    """The frame with an object of the size of a hand over the canvas."""
    height, width = photo.frame.shape[:2]
    frame = photo.frame.copy()
    cv2.ellipse(frame, (width // 2, height // 2), (width // 5, height // 7), 30, 0, 360, (196, 150, 128), -1)
    return replace(photo, frame=frame)


def slid(photo: Photo) -> Photo:
    """The frame after the sheet slid by 9 pixels between the markers."""
    height, width = photo.frame.shape[:2]
    inner = slice(round(0.24 * height), round(0.76 * height)), slice(round(0.24 * width), round(0.76 * width))
    frame = photo.frame.copy()
    frame[inner] = np.roll(photo.frame, (7, 9), axis=(0, 1))[inner]
    return replace(photo, frame=frame)


class Frozen:
    """A camera that always returns its first picture."""

    def __init__(self) -> None:
        self.photo: Photo | None = None

    def __call__(self, photo: Photo) -> Photo:
        self.photo = photo if self.photo is None else self.photo
        return replace(self.photo, t_s=photo.t_s)
