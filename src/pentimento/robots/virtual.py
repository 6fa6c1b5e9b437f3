"""The robots of the virtual studio: one paints, one sculpts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.errors import ContractError
from pentimento.contracts.observations import Photo, Scan
from pentimento.robots.driver import MissingAbilityError, Place, Push
from pentimento.robots.tools import EndEffector, Tool
from pentimento.studio.clay.studio import ClayStudio
from pentimento.studio.clay.world import load_clay_world
from pentimento.studio.strokes.studio import Studio
from pentimento.studio.strokes.world import load_world

FloatArray = NDArray[np.float64]


def virtual_robot(world: str, canvas_size_m: tuple[float, float], seed: int) -> VirtualRobot:
    """The robot of a world, by its name or file, before a sheet of this size.

    Raises ConfigError if there is no such world.
    """
    known = load_world(world)
    return VirtualRobot(Studio(replace(known, paper=replace(known.paper, size_m=canvas_size_m)), seed))


class VirtualRobot:
    """A Robot (see robots/driver.py) whose arm, paper, paint and camera are a Studio.

    A studio has one tool, which `change_tool` can only confirm.
    """

    def __init__(self, studio: Studio) -> None:
        self._studio = studio
        self._palette_srgb: FloatArray = np.zeros((0, 3))

    @property
    def canvas_size_m(self) -> tuple[float, float]:
        return self._studio.canvas_size_m

    @property
    def clock_s(self) -> float:
        """The studio's time, which advances only by commands."""
        return self._studio.clock_s

    def change_tool(self, tool: Tool) -> None:
        if tool.name != self._studio.tool_name:
            raise ContractError(
                f"This studio holds a {self._studio.tool_name} and the {tool.name} is asked for; "
                f'name a world whose file says `[tool] name = "{tool.name}"`.'
            )

    def load_palette(self, colors_srgb: FloatArray) -> None:
        self._palette_srgb = np.array(colors_srgb, dtype=np.float64).reshape(-1, 3)

    def dip(self, paint: int) -> None:
        if not 0 <= paint < len(self._palette_srgb):
            raise ContractError(
                f"Paint {paint} is not on the palette, which has {len(self._palette_srgb)} paints; "
                "load a palette that holds it."
            )
        self._studio.dip(self._palette_srgb[paint])

    def wipe(self) -> None:
        self._studio.wipe()

    def move(self, path: FloatArray) -> FloatArray:
        return self._studio.stroke(path)

    def force_n(self) -> FloatArray:
        return self._studio.force_n

    def lift(self) -> None:
        """Nothing to do: a stroke of the studio ends with the tool above the sheet."""

    def photo(self) -> Photo:
        return self._studio.photo()

    def scan(self) -> FloatArray:
        raise MissingAbilityError(
            "The virtual studio's painting table has no scanner; measure the canvas by its photos."
        )

    def new_sheet(self) -> None:
        self._studio.new_sheet()

    def wait(self, seconds: float) -> None:
        self._studio.wait(seconds)


def virtual_sculpting_robot(world: str, scan_pixels: int, seed: int) -> VirtualSculptingRobot:
    """The robot of a clay world, by its name or file, under a scanner with this many pixels a side.

    Raises ConfigError if there is no such world.
    """
    known = load_clay_world(world)
    return VirtualSculptingRobot(ClayStudio(replace(known, scanner=replace(known.scanner, pixels=scan_pixels)), seed))


class VirtualSculptingRobot:
    """A SculptingRobot (see robots/driver.py) whose arm, clay and scanner are a ClayStudio."""

    def __init__(self, studio: ClayStudio) -> None:
        self._studio = studio

    @property
    def area_m(self) -> tuple[float, float]:
        return self._studio.size_m

    @property
    def clock_s(self) -> float:
        """The studio's time, which advances only by commands."""
        return self._studio.clock_s

    @property
    def material_name(self) -> str:
        """Name of the material in the tray."""
        return self._studio.material_name

    def change_tool(self, end_effector: EndEffector) -> None:
        self._studio.take(end_effector.name)

    def push(self, push: Push) -> FloatArray:
        return self._studio.push(push.action, push.surface_m, push.speed_m_s, push.dwell_s, push.retract_speed_m_s)

    def place(self, place: Place) -> None:
        self._studio.place(place.x_m, place.y_m, place.volume_m3, surface_m=place.surface_m, press_m=place.press_m)

    def lift(self) -> None:
        """Nothing to do: a push of the studio ends with the tool above the slab."""

    def scan(self) -> Scan:
        return self._studio.scan()

    def smooth(self) -> None:
        self._studio.smooth()

    def ambient(self) -> dict[str, float]:
        air = self._studio.air()
        return {"temperature_c": air.temperature_c, "humidity": air.humidity}

    def wait(self, seconds: float) -> None:
        self._studio.wait(seconds)
