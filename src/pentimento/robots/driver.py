"""The interface that every robot serves, virtual or real."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.errors import PentimentoError
from pentimento.contracts.photo import Photo
from pentimento.robots.tools import Tool

FloatArray = NDArray[np.float64]


class MissingAbilityError(PentimentoError):
    """The robot was asked for something that it has no device for."""


class Robot(Protocol):
    """A robot that paints on one canvas.

    All paths are float64[N, 5] in the canvas frame (t_s from 0, x_m, y_m, z_m, yaw_rad), at rest at both
    ends. How the tip travels between strokes is the driver's business. Callers reach a robot through
    `control.safety.GuardedRobot`, so that no command passes unchecked.
    """

    @property
    def canvas_size_m(self) -> tuple[float, float]:
        """Width and height of the canvas."""
        ...

    @property
    def clock_s(self) -> float:
        """Seconds on the robot's own clock; every photo carries a time of the same clock."""
        ...

    def change_tool(self, tool: Tool) -> None:
        """Take `tool`; nothing happens where it is already held."""
        ...

    def load_palette(self, colors_srgb: FloatArray) -> None:
        """Lay out paints of these masstones, float[K, 3]; nothing happens where they already lie there."""
        ...

    def dip(self, paint: int) -> None:
        """Load the tool from paint `paint` of the palette."""
        ...

    def wipe(self) -> None:
        """Wash and wipe the tool, so that it carries no paint."""
        ...

    def move(self, path: FloatArray) -> FloatArray:
        """Execute one stroke; returns the measured path [N, 5], NaN where nothing was measured."""
        ...

    def lift(self) -> None:
        """Stop where the tool is and raise it off the canvas.

        May be called at any time: from another thread, while a move is on its way (which then raises), and
        after a fault. Returns when the tool is up; raises where that cannot be said.
        """
        ...

    def photo(self) -> Photo:
        """The raw camera frame."""
        ...

    def scan(self) -> FloatArray:
        """Heights of the surface in metres, [H, W]. MissingAbilityError without a scanner."""
        ...

    def new_sheet(self) -> None:
        """Put a blank sheet in the canvas's place."""
        ...

    def wait(self, seconds: float) -> None:
        """Let time pass."""
        ...
