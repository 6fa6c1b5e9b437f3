"""A tip that a machine carries over a rig's canvas: the journeys that painting and sculpting have in common."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from pentimento.robots.journey import check_reach, path_of, poses_of, way_up, ways_to
from pentimento.robots.machine import HaltedError, Machine, MachineError, PlanningMachine, UnsureMachine
from pentimento.robots.rig import Rig

FloatArray = NDArray[np.float64]

LIFT_WITHIN_S = 2.0
"""Max time for a halted move to come to rest; after it, lifting counts as failed."""


class TipCarrier:
    """A machine, its rig and the person beside it.

    The tip goes up, across at travel height and down again. All motions of a command are checked against the rig's
    reach, and by the machine where it can, before the first is sent.
    """

    def __init__(self, machine: Machine, rig: Rig, ask: Callable[[str], None]) -> None:
        """`ask` puts a request to the person and returns when it is done, or raises."""
        self._machine, self._rig, self._ask = machine, rig, ask
        self._moving, self._lifting = threading.Lock(), threading.Lock()
        self._halts = 0
        self._settled = False  # the last motion ended normally, so that nothing can be moving
        self._started_s = time.monotonic()

    @property
    def rig(self) -> Rig:
        """The rig that it was made with."""
        return self._rig

    @property
    def clock_s(self) -> float:
        """Seconds since the robot was opened."""
        return time.monotonic() - self._started_s

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

    def wait(self, seconds: float) -> None:
        """Let time pass."""
        time.sleep(seconds)

    def close(self) -> None:
        """Lift the tool and let go of the machine."""
        try:
            self.lift()
        finally:
            self._machine.close()

    def _fit(self, request: str) -> None:
        """Ask the person to fit a tool, with the tip up and the machine's place settled."""
        if isinstance(self._machine, UnsureMachine) and (doubt := self._machine.doubt()) is not None:
            self._ask(doubt)
            self._machine.settle()
        self.lift()
        self._ask(request)

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

    def _park(self, place_m: tuple[float, float]) -> None:
        """Move the tip out of the camera's view at travel height; nothing happens where it is there already."""
        with self._moving:
            halts, here = self._halts, self._here()
            park = np.array([*place_m, max(self._rig.travel_height_m, float(here[2])), here[3]])
            self._follow(ways_to(here, park, self._rig), "motion out of the picture", halts)

    def _travel(self, path: FloatArray, what: str, rising_m_s: float | None = None) -> FloatArray:
        """To the path's start through the air, along it, and up; returns the measured path [N, 5].

        rising_m_s: speed away from the path's end, if not that of all journeys.
        """
        with self._moving:
            halts = self._halts
            before = ways_to(self._here(), path[0, 1:], self._rig)
            after = way_up(path[-1, 1:], self._rig, rising_m_s)
            done = self._follow([*before, path, *([] if after is None else [after])], what, halts)
            measured = path_of(path[:, 0], done[len(before)], self._rig)
            measured[np.isnan(measured[:, 1]), 0] = np.nan
            return measured

    def _follow(self, ways: Sequence[FloatArray], what: str, halts: int) -> list[FloatArray]:
        """Check all motions, then execute them in order; returns the measured poses of each."""
        poses = [poses_of(way, self._rig) for way in ways]
        for pose in poses:
            check_reach(pose, self._rig, f"motion to, along or from the {what}")
        if isinstance(self._machine, PlanningMachine):
            self._machine.check_reach(poses)
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
