"""The sculpting robot of the virtual studio."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.scan import Scan
from pentimento.robots.end_effectors import EndEffector
from pentimento.robots.sculpting import Push
from pentimento.studio.clay.studio import ClayStudio
from pentimento.studio.clay.world import load_clay_world

FloatArray = NDArray[np.float64]


def virtual_sculpting_robot(world: str, scan_pixels: int, seed: int) -> VirtualSculptingRobot:
    """The robot of a clay world, by its name or file, under a scanner with this many pixels a side.

    Raises ConfigError if there is no such world.
    """
    known = load_clay_world(world)
    return VirtualSculptingRobot(ClayStudio(replace(known, scanner=replace(known.scanner, pixels=scan_pixels)), seed))


class VirtualSculptingRobot:
    """A SculptingRobot (see robots/sculpting.py) whose hand, clay and scanner are a ClayStudio."""

    def __init__(self, studio: ClayStudio) -> None:
        self._studio = studio

    @property
    def area_m(self) -> tuple[float, float]:
        return self._studio.size_m

    @property
    def clock_s(self) -> float:
        """The studio's own time, which passes only by what is done in it."""
        return self._studio.clock_s

    @property
    def material_name(self) -> str:
        """Name of the material in the tray."""
        return self._studio.material_name

    def change_tool(self, end_effector: EndEffector) -> None:
        self._studio.take(end_effector.name)

    def push(self, push: Push) -> FloatArray:
        return self._studio.push(push.action, push.surface_m, push.speed_m_s, push.dwell_s, push.retract_speed_m_s)

    def scan(self) -> Scan:
        return self._studio.scan()

    def smooth(self) -> None:
        self._studio.smooth()

    def ambient(self) -> dict[str, float]:
        air = self._studio.air()
        return {"temperature_c": air.temperature_c, "humidity": air.humidity}

    def wait(self, seconds: float) -> None:
        self._studio.wait(seconds)
