"""Guarding a robot: every command is checked before it reaches the driver, and a late loop is stopped."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.errors import EnvelopeViolation, PentimentoError
from pentimento.contracts.observations import Photo
from pentimento.control.safety import ROUNDING_M, SafetyEnvelope
from pentimento.robots.driver import Robot, SculptingRobot
from pentimento.robots.tools import Tool

FloatArray = NDArray[np.float64]

MAX_WAIT_S = 3600.0
_RELIFTS = 10
"""Lifts that follow a stop, for a command that reached the driver just after the first."""
_RELIFT_S = 0.02
"""Time between two of them."""
_POLL_S = 0.02
"""Time between two checks of the watchdog: a stop may come late by this much."""


class StoppedError(PentimentoError):
    """A command was refused or interrupted because the robot is stopped and nobody has released it."""


class LiftError(PentimentoError):
    """The tool could not be raised: it may rest on the canvas. Only the robot's emergency stop helps."""


class StopLatch:
    """What guards of robots have in common: a stop lifts the tool and is latched until a person releases it."""

    def __init__(self, robot: Robot | SculptingRobot, work: str) -> None:
        """`work` is where the tool may rest, for messages."""
        self._lifted, self._work = robot, work
        self._stopped: str | None = None
        self._latch = threading.Lock()
        self._idle = threading.Event()  # no command is being executed
        self._idle.set()

    @property
    def stopped(self) -> str | None:
        """Why the robot is stopped; None while it may move."""
        return self._stopped

    def stop(self, reason: str) -> None:
        """Stop at once, lift the tool, and refuse every command until `release`. Any thread may call it.

        The first reason is kept. Raises LiftError if the tool could not be lifted; the robot is latched then, too.
        """
        with self._latch:
            if self._stopped is None:
                self._stopped = reason
        self.lift()
        # A command checked just before the latch may have reached the driver just after the lift.
        for _ in range(_RELIFTS):
            if self._idle.wait(_RELIFT_S):
                return
            self.lift()

    def release(self) -> None:
        """Allow commands again. For a person who has inspected the robot, never for a program that retries."""
        with self._latch:
            self._stopped = None

    def lift(self) -> None:
        """Stop where the tool is and raise it; allowed at any time. Raises LiftError if that fails."""
        try:
            self._lifted.lift()
        except Exception as error:
            with self._latch:
                self._stopped = self._stopped or "the tool could not be lifted"
            raise LiftError(
                f"The tool may still rest {self._work}, because lifting it failed: {error} "
                "Use the robot's own emergency stop and lift the tool by hand."
            ) from error

    @contextmanager
    def _passing(self, command: str) -> Iterator[None]:
        """Context of each driver call: refuses it while stopped; on any error it lifts the tool and latches."""
        self._idle.clear()
        try:
            self._refuse_if_stopped(command)
            yield
        except StoppedError:
            raise
        except BaseException as error:
            self._idle.set()
            self.stop(f"a {command} failed: {error or type(error).__name__}")
            raise
        finally:
            self._idle.set()
        # Stopped from another thread meanwhile: how much of the command the driver has executed is unknown.
        self._refuse_if_stopped(command)

    def _refuse_if_stopped(self, command: str) -> None:
        if self._stopped is not None:
            raise StoppedError(
                f"The robot is stopped ({self._stopped}) and the {command} is refused; look at the robot, then "
                "release it by hand."
            )


class GuardedRobot(StopLatch):
    """A Robot whose every command is checked before it reaches the driver, and that can be stopped for good.

    The driver gets the checked copy of a path. Any error of the driver during a command, KeyboardInterrupt included,
    lifts the tool and leaves the robot stopped. A stop is latched: until `release` every command is refused, photos
    included. A scan and the clock pass through.
    """

    def __init__(self, robot: Robot, envelope: SafetyEnvelope) -> None:
        """Raises EnvelopeViolation if the envelope reaches beyond the robot's canvas."""
        width_m, height_m = robot.canvas_size_m
        low, high = (envelope.x_min_m, envelope.y_min_m), (envelope.x_max_m, envelope.y_max_m)
        margins = (*low, width_m - high[0], height_m - high[1])
        if not all(margin >= -ROUNDING_M for margin in margins):
            raise EnvelopeViolation(
                f"The safety envelope from {low} to {high} m reaches beyond the robot's canvas of "
                f"{width_m:g} by {height_m:g} m; build it with envelope_for(tool, robot.canvas_size_m)."
            )
        self._robot = robot
        self._envelope = envelope
        self._tool_fits = False
        self._paints = 0
        super().__init__(robot, "on the canvas")

    @property
    def envelope(self) -> SafetyEnvelope:
        """The envelope that guards this robot."""
        return self._envelope

    @property
    def canvas_size_m(self) -> tuple[float, float]:
        return self._robot.canvas_size_m

    @property
    def clock_s(self) -> float:
        return self._robot.clock_s

    def change_tool(self, tool: Tool) -> None:
        """Refuses a tool that tolerates less press or speed than the envelope allows."""
        tolerated = (
            ("a press", self._envelope.max_press_depth_m, tool.press_range_m[1], "m"),
            ("a speed", self._envelope.max_speed_m_s, tool.speed_range_m_s[1], "m/s"),
        )
        for what, allowed, limit, unit in tolerated:
            if allowed > limit * (1 + 1e-9):
                raise EnvelopeViolation(
                    f"The safety envelope allows {what} of {allowed:g} {unit} and the {tool.name} tolerates "
                    f"{limit:g} {unit}; build the envelope with envelope_for for this tool."
                )
        with self._passing("change of tool"):
            self._robot.change_tool(tool)
        self._tool_fits = True

    def load_palette(self, colors_srgb: FloatArray) -> None:
        """Refuses anything but float[K, 3] of sRGB in [0, 1], K of 1 or more."""
        colors = np.array(colors_srgb)
        if colors.dtype.kind not in "fiu" or colors.ndim != 2 or colors.shape[1] != 3 or len(colors) == 0:
            raise EnvelopeViolation(
                f"The palette is {colors.dtype}{list(colors.shape)}; it must be real numbers [K, 3] with at "
                "least one paint."
            )
        bad = np.flatnonzero(~np.all((colors >= 0) & (colors <= 1), axis=1))
        if bad.size:
            color = colors[bad[0]]
            hint = " These look like 0 to 255." if np.any(color > 2) else ""
            raise EnvelopeViolation(
                f"Paint {bad[0]} of the palette is {color.tolist()}; each channel must lie from 0 to 1.{hint}"
            )
        with self._passing("change of palette"):
            self._robot.load_palette(colors.astype(np.float64))
        self._paints = len(colors)

    def dip(self, paint: int) -> None:
        if isinstance(paint, bool) or not isinstance(paint, int | np.integer):
            raise EnvelopeViolation(f"A dip names its paint by a whole number; got {paint!r}.")
        if not 0 <= paint < self._paints:
            raise EnvelopeViolation(
                f"There is no paint {paint}: the loaded palette has {self._paints} paints; load a palette "
                "before the dip and count its paints from 0."
            )
        with self._passing("dip"):
            self._robot.dip(int(paint))

    def wipe(self) -> None:
        with self._passing("wipe"):
            self._robot.wipe()

    def move(self, path: FloatArray) -> FloatArray:
        """Refuses a path outside the envelope, and any path before `change_tool` has seen the tool."""
        if not self._tool_fits:
            raise EnvelopeViolation(
                "The guard does not know the tool; call change_tool before the first move, also for a tool "
                "that is held already."
            )
        points = self._envelope.checked_copy(path)
        with self._passing("move"):
            return self._robot.move(points)

    def force_n(self) -> FloatArray:
        return self._robot.force_n()

    def photo(self) -> Photo:
        """Refused while stopped: a robot may have to move out of the picture."""
        self._refuse_if_stopped("photo")
        return self._robot.photo()

    def scan(self) -> FloatArray:
        return self._robot.scan()

    def new_sheet(self) -> None:
        with self._passing("change of sheet"):
            self._robot.new_sheet()

    def wait(self, seconds: float) -> None:
        if not 0 <= seconds <= MAX_WAIT_S:
            raise EnvelopeViolation(f"A wait of {seconds} s is refused; it must last from 0 to {MAX_WAIT_S:g} s.")
        with self._passing("wait"):
            self._robot.wait(seconds)


class Watchdog:
    """Stops a robot when the loop that commands it has not beaten in time.

    Before each step the loop calls ``beat`` with the time that the step may take. A thread checks the time; where the
    next beat is late, it calls ``stop`` with a message, once, from its own thread. The robot must allow that (see
    ``robots.driver.Robot.lift``) and stay stopped.
    """

    def __init__(
        self, stop: Callable[[str], None], clock: Callable[[], float] = time.monotonic, poll_s: float = _POLL_S
    ) -> None:
        self._stop, self._clock = stop, clock
        self._lock = threading.Lock()
        self._due: tuple[float, float, str] | None = None  # deadline, time given, step
        self._closed = threading.Event()
        self.failure: PentimentoError | None = None
        """Why the tool could not be lifted, if so."""
        self._thread = threading.Thread(target=self._watch, args=(poll_s,), name="watchdog", daemon=True)
        self._thread.start()

    def beat(self, within_s: float, what: str) -> None:
        """The loop is alive and beats again within ``within_s`` seconds, the time that ``what`` may take."""
        with self._lock:
            self._due = (self._clock() + within_s, within_s, what)

    def rest(self) -> None:
        """The tool is up and nothing moves until the next beat, which may take any time."""
        with self._lock:
            self._due = None

    def check(self) -> bool:
        """Whether the beat was late; the robot is stopped then. The thread calls it."""
        with self._lock:
            due = self._due
            if due is None or self._clock() <= due[0]:
                return False
            self._due = None
        _, given_s, what = due
        try:
            self._stop(f"{what} took longer than the {given_s:.3g} s that it may take")
        except PentimentoError as error:
            self.failure = error
        return True

    def close(self) -> None:
        """End the watchdog's thread."""
        self._closed.set()
        self._thread.join()

    def _watch(self, poll_s: float) -> None:
        while not self._closed.wait(poll_s):
            self.check()
