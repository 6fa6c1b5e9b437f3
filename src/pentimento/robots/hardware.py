"""A robot composed of a machine, a rig, a camera, and a person who fills paints and changes sheets."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.colour import to_uint8
from pentimento.contracts.errors import ContractError
from pentimento.contracts.observations import Photo
from pentimento.robots.driver import MissingAbilityError
from pentimento.robots.journey import (
    check_reach,
    off_surface,
    on_surface,
    path_of,
    poses_of,
    to_and_fro,
    way_up,
    ways_to,
)
from pentimento.robots.machine import HaltedError, Machine, MachineError, UnsureMachine
from pentimento.robots.rig import Palette, Rig
from pentimento.robots.tools import Tool

FloatArray = NDArray[np.float64]

LIFT_WITHIN_S = 2.0
"""Max time for a halted move to come to rest; after it, lifting counts as failed."""
STIR_M = 0.006
"""Length of a rub in a well of paint or water."""
WIPE_M = 0.03
"""Length of a rub on the cloth."""
WIPES = 3


class HardwareRobot:
    """A Robot (see driver.py) on real hardware. Callers reach it through `control.guard.GuardedRobot`.

    Between strokes the tip goes up, across at travel height and down again. Every motion is checked against the rig's
    reach before it is sent to the machine.
    """

    def __init__(
        self, machine: Machine, rig: Rig, ask: Callable[[str], None], camera: Callable[[], Photo] | None = None
    ) -> None:
        """`ask` puts a request to the person and returns when it is done, or raises."""
        self._machine, self._rig, self._ask, self._camera = machine, rig, ask, camera
        self._moving, self._lifting = threading.Lock(), threading.Lock()
        self._halts = 0
        self._settled = False  # the last motion ended normally, so that nothing can be moving
        self._started_s = time.monotonic()
        self._tool: Tool | None = None
        self._palette_srgb: FloatArray = np.zeros((0, 3))

    @property
    def rig(self) -> Rig:
        """The rig that it was made with."""
        return self._rig

    @property
    def canvas_size_m(self) -> tuple[float, float]:
        return self._rig.canvas_size_m

    @property
    def clock_s(self) -> float:
        """Seconds since the robot was opened."""
        return time.monotonic() - self._started_s

    def change_tool(self, tool: Tool) -> None:
        if self._tool == tool:
            return
        if isinstance(self._machine, UnsureMachine) and (request := self._machine.doubt()) is not None:
            self._ask(request)
            self._machine.settle()
        self.lift()
        self._ask(f"Fit the {tool.name} so that its tip is where the rig file says, then confirm.")
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

    def lift(self) -> None:
        """Halt, and raise the tip to travel height. MachineError if the present move does not end."""
        with self._lifting:  # a second call must not halt the lift of the first
            if self._rests_in_the_air():
                return
            self._halts += 1
            self._machine.halt()
            if not self._moving.acquire(timeout=LIFT_WITHIN_S):
                raise MachineError(f"A motion did not end within {LIFT_WITHIN_S:g} s of its halt.")
            try:
                way = way_up(self._here(), self._rig)
                if way is not None:
                    self._machine.follow(way[:, 0], poses_of(way, self._rig))
                self._settled = True
            finally:
                self._moving.release()

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

    def wait(self, seconds: float) -> None:
        time.sleep(seconds)

    def close(self) -> None:
        """Lift the tool and let go of the machine."""
        try:
            self.lift()
        finally:
            self._machine.close()

    def _places(self) -> Palette:
        if self._rig.palette is None:
            raise MissingAbilityError(
                f"The rig {self._rig.name} has no palette; use a tool with its own ink, or add [palette] to its file."
            )
        return self._rig.palette

    def _here(self) -> FloatArray:
        """The tip's place [4] (x, y, z, yaw) in the canvas frame."""
        here: FloatArray = path_of(np.zeros(1), self._machine.where()[None], self._rig)[0, 1:]
        return here

    def _rests_in_the_air(self) -> bool:
        """Whether it is certain that nothing moves and the tip is up, so that there is nothing to halt."""
        if not self._moving.acquire(blocking=False):
            return False
        try:
            return self._settled and way_up(self._here(), self._rig) is None
        finally:
            self._moving.release()

    def _rub(self, place_m: tuple[float, float], length_m: float, times: int, what: str) -> None:
        """Go down at a place outside the canvas and move back and forth along y."""
        low = np.array([place_m[0], place_m[1] - length_m / 2, -self._places().depth_m, 0.0])
        high = low + np.array([0.0, length_m, 0.0, 0.0])
        self._travel(to_and_fro(low, high, times), what)

    def _park(self, place_m: tuple[float, float]) -> None:
        """Move the tip out of the camera's view at travel height; nothing happens where it is there already."""
        with self._moving:
            halts, here = self._halts, self._here()
            park = np.array([*place_m, max(self._rig.travel_height_m, float(here[2])), here[3]])
            self._follow(ways_to(here, park, self._rig), "motion out of the picture", halts)

    def _travel(self, path: FloatArray, what: str) -> FloatArray:
        """To the path's start through the air, along it, and up; returns the measured path [N, 5]."""
        with self._moving:
            halts = self._halts
            before = ways_to(self._here(), path[0, 1:], self._rig)
            after = way_up(path[-1, 1:], self._rig)
            done = self._follow([*before, path, *([] if after is None else [after])], what, halts)
            measured = path_of(path[:, 0], done[len(before)], self._rig)
            measured[np.isnan(measured[:, 1]), 0] = np.nan
            return measured

    def _follow(self, ways: Sequence[FloatArray], what: str, halts: int) -> list[FloatArray]:
        """Check all motions, then execute them in order; returns the measured poses of each."""
        poses = [poses_of(way, self._rig) for way in ways]
        for pose in poses:
            check_reach(pose, self._rig, f"motion to, along or from the {what}")
        self._settled = False
        done = []
        for way, pose in zip(ways, poses, strict=True):
            if self._halts != halts:
                raise HaltedError(f"The {what} broke off, because the robot was lifted.")
            done.append(self._machine.follow(way[:, 0], pose))
        self._settled = True
        return done


def ask_at_terminal(request: str) -> None:
    """Put a request to the person at the terminal and wait for Enter."""
    input(f"{request} [Enter] ")


def _hex(color_srgb: FloatArray) -> str:
    return "#" + to_uint8(np.asarray(color_srgb, dtype=np.float64)).tobytes().hex()
