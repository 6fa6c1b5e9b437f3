"""A robot composed of a machine, a rig, a camera, and a person who fills paints and changes sheets."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.colour import to_uint8
from pentimento.contracts.errors import ContractError
from pentimento.contracts.observations import Photo
from pentimento.robots.carrier import TipCarrier
from pentimento.robots.driver import MissingAbilityError
from pentimento.robots.journey import off_surface, on_surface, to_and_fro
from pentimento.robots.machine import Machine
from pentimento.robots.rig import Palette, Rig
from pentimento.robots.tools import Tool

FloatArray = NDArray[np.float64]

STIR_M = 0.006
"""Length of a rub in a well of paint or water."""
WIPE_M = 0.03
"""Length of a rub on the cloth."""
WIPES = 3


class HardwareRobot(TipCarrier):
    """A Robot (see driver.py) on real hardware. Callers reach it through `control.guard.GuardedRobot`.

    Between strokes the tip goes up, across at travel height and down again. Every motion is checked against the rig's
    reach before it is sent to the machine.
    """

    def __init__(
        self, machine: Machine, rig: Rig, ask: Callable[[str], None], camera: Callable[[], Photo] | None = None
    ) -> None:
        """`ask` puts a request to the person and returns when it is done, or raises."""
        super().__init__(machine, rig, ask)
        self._camera = camera
        self._tool: Tool | None = None
        self._palette_srgb: FloatArray = np.zeros((0, 3))

    @property
    def canvas_size_m(self) -> tuple[float, float]:
        return self._rig.canvas_size_m

    def change_tool(self, tool: Tool) -> None:
        if self._tool == tool:
            return
        self._fit(f"Fit the {tool.name} so that its tip is where the rig file says, then confirm.")
        self._tool = tool

    def load_palette(self, colors_srgb: FloatArray) -> None:
        if np.array_equal(self._palette_srgb, colors_srgb):
            return
        places = self._places()
        if len(colors_srgb) > len(places.wells_m):
            raise ContractError(
                f"The palette has {len(colors_srgb)} paints and the rig {self._rig.name} has {len(places.wells_m)} "
                "wells; plan with fewer paints or add wells to the rig file."
            )
        names = ", ".join(f"well {i + 1}: {_hex(color)}" for i, color in enumerate(colors_srgb))
        self._ask(f"Fill the paints ({names}), then confirm.")
        self._palette_srgb = np.array(colors_srgb, dtype=np.float64)

    def dip(self, paint: int) -> None:
        if not 0 <= paint < len(self._palette_srgb):
            raise ContractError(
                f"Paint {paint} is not on the palette, which has {len(self._palette_srgb)} paints; "
                "load a palette that holds it."
            )
        self._rub(self._places().wells_m[paint], STIR_M, 1, "dip")

    def wipe(self) -> None:
        """Wash in the water, then wipe on the cloth."""
        places = self._places()
        self._rub(places.water_m, STIR_M, WIPES, "wash")
        self._rub(places.cloth_m, WIPE_M, WIPES, "wipe")

    def move(self, path: FloatArray) -> FloatArray:
        points = on_surface(np.asarray(path, dtype=np.float64), self._rig)
        measured = self._travel(points, "stroke")
        return off_surface(measured, self._rig)

    def force_n(self) -> FloatArray:
        return np.zeros(0)  # no driver measures it yet

    def photo(self) -> Photo:
        if self._camera is None:
            raise MissingAbilityError(
                f"The rig {self._rig.name} has no camera; paint in the open loop, or name a camera in the rig file."
            )
        if self._rig.park_m is not None:
            self._park(self._rig.park_m)
        return self._camera()

    def scan(self) -> FloatArray:
        raise MissingAbilityError(f"The rig {self._rig.name} has no scanner.")

    def new_sheet(self) -> None:
        self.lift()
        self._ask("Put a blank sheet in the canvas's place, then confirm.")

    def _places(self) -> Palette:
        if self._rig.palette is None:
            raise MissingAbilityError(
                f"The rig {self._rig.name} has no palette; use a tool with its own ink, or add [palette] to its file."
            )
        return self._rig.palette

    def _rub(self, place_m: tuple[float, float], length_m: float, times: int, what: str) -> None:
        """Go down at a place outside the canvas and move back and forth along y."""
        low = np.array([place_m[0], place_m[1] - length_m / 2, -self._places().depth_m, 0.0])
        high = low + np.array([0.0, length_m, 0.0, 0.0])
        self._travel(to_and_fro(low, high, times), what)


def _hex(color_srgb: FloatArray) -> str:
    return "#" + to_uint8(np.asarray(color_srgb, dtype=np.float64)).tobytes().hex()
