"""The robot of the virtual studio."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.errors import ContractError
from pentimento.contracts.photo import Photo
from pentimento.robots.driver import MissingAbilityError
from pentimento.robots.tools import Tool
from pentimento.studio.studio import Studio
from pentimento.studio.world import load_world

FloatArray = NDArray[np.float64]


def virtual_robot(world: str, canvas_size_m: tuple[float, float], seed: int) -> VirtualRobot:
    """The robot of a world, by its name or file, before a sheet of this size.

    Raises ConfigError if there is no such world.
    """
    known = load_world(world)
    return VirtualRobot(Studio(replace(known, paper=replace(known.paper, size_m=canvas_size_m)), seed))


class VirtualRobot:
    """A Robot (see robots/driver.py) whose hand, paper, paint and camera are a Studio.

    A studio is built for one tool, so that `change_tool` can only confirm it.
    """

    def __init__(self, studio: Studio) -> None:
        self._studio = studio
        self._palette_srgb: FloatArray = np.zeros((0, 3))

    @property
    def canvas_size_m(self) -> tuple[float, float]:
        return self._studio.canvas_size_m

    @property
    def clock_s(self) -> float:
        """The studio's own time, which passes only by what is done in it."""
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

    def lift(self) -> None:
        """Nothing to do: a studio's stroke is made in one step, and ends with the tool above the sheet."""

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
