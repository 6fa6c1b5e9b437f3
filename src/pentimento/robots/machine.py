"""The interface of a hardware driver: move the tool's tip through timed poses, stop, and report its pose.

Everything else that a robot does (frames, travel between strokes, dips, reach) is the same for all drivers: see
hardware.py. See docs/writing_a_driver.md.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.errors import PentimentoError

FloatArray = NDArray[np.float64]


class MachineError(PentimentoError):
    """The machine, or the link to it, refused or failed; where the tool is may be unknown."""


class HaltedError(MachineError):
    """A motion broke off because `halt` was called."""


class Machine(Protocol):
    """A machine that holds a tool. Poses are [4, 4], tip -> robot's frame, metres.

    The tip's frame has its z axis out of the tool, into the canvas; its x axis is the canvas's x axis turned by
    the yaw about the canvas's normal.
    """

    def where(self) -> FloatArray:
        """The tip's pose [4, 4] now. A machine that does not turn its tool answers with any rotation."""
        ...

    def follow(self, times_s: FloatArray, poses: FloatArray) -> FloatArray:
        """Take the tip through poses[N, 4, 4] at times_s[N] (from 0, rising), from rest to rest, and wait for the end.

        The first pose is where the tip stands. Returns the measured poses [N, 4, 4], NaN where nothing was
        measured. Raises HaltedError after `halt`, MachineError when anything else went wrong.
        """
        ...

    def halt(self) -> None:
        """Come to rest at once, wherever the tip is; any thread may call it, and it may be called at rest.

        A `follow` in progress raises HaltedError. Afterwards the machine accepts a new `follow`, so that the tool can
        be raised; raises MachineError where it cannot.
        """
        ...

    def close(self) -> None:
        """Close the link, with the machine at rest."""
        ...


@runtime_checkable
class UnsureMachine(Protocol):
    """A machine that may not know its place when it is opened. It then refuses every `follow` until it is settled."""

    def doubt(self) -> str | None:
        """What the person must see to before the machine may move; None if the place is known."""
        ...

    def settle(self) -> None:
        """The person has seen to it."""
        ...


@runtime_checkable
class PlanningMachine(Protocol):
    """A machine that can tell whether its joints reach a motion, before it moves."""

    def check_reach(self, motions: Sequence[FloatArray]) -> None:
        """Return if it can make these motions, poses [N, 4, 4] each, in order from where its tip stands.

        Raises MachineError otherwise. Nothing moves.
        """
        ...


def positions_only(places_m: FloatArray) -> FloatArray:
    """Poses [..., 4, 4] of places [..., 3] for a machine that does not turn its tool."""
    poses = np.zeros((*places_m.shape[:-1], 4, 4))
    poses[...] = np.eye(4)
    poses[..., :3, 3] = places_m
    return poses
