"""The safety envelope: one gate that every command passes before it reaches a robot.

The envelope is a value and its check is pure. It rejects and never clamps: a command that is clamped is
another command than the one that was planned, and hides the mistake that made it wrong.
"""

from __future__ import annotations

import hashlib
import json
import math
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, fields, replace
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.errors import ConfigError, EnvelopeViolation, PentimentoError
from pentimento.contracts.photo import Photo
from pentimento.robots.driver import Robot
from pentimento.robots.motion import (
    ACCELERATION_M_S2,
    MIN_STEP_S,
    acceleration_spans,
    tip_accelerations,
    tip_speeds,
)
from pentimento.robots.tools import Tool

FloatArray = NDArray[np.float64]

_NAMES = ("t", "x", "y", "z", "yaw")
_FLOAT32 = 2.0**-24  # largest relative rounding error: paths rest in float32 tables
_EXECUTION_NOISE_M = 1e-7  # of a coordinate that was rounded to float32 at the edge of the box
_MAX_WAIT_S = 3600.0
_LIFTS_AGAIN, _LIFT_AGAIN_S = 10, 0.02


class StoppedError(PentimentoError):
    """A command was refused, or broke off, because the robot is stopped and nobody has released it."""


class LiftError(PentimentoError):
    """The tool could not be raised: it may rest on the canvas. Only the robot's own emergency stop helps now."""


@dataclass(frozen=True)
class SafetyEnvelope:
    """What one tool may be commanded to do over one canvas (canvas frame, SI units).

    A path must lie within x_min..x_max, y_min..y_max and −max_press_depth..max_travel_height; its speed,
    acceleration (from rest to rest), yaw, yaw rate and duration stay under their limits, and its points
    are at least a control period (motion.MIN_STEP_S) apart in time.
    """

    x_min_m: float
    y_min_m: float
    x_max_m: float
    y_max_m: float
    max_press_depth_m: float
    max_travel_height_m: float
    max_speed_m_s: float
    max_acceleration_m_s2: float
    max_yaw_rad: float
    max_yaw_rate_rad_s: float
    max_duration_s: float

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not math.isfinite(value):
                raise ConfigError(f"The safety envelope's {field.name} is {value}; every limit must be finite.")
            if field.name.startswith("max_") and value < 0:
                raise ConfigError(f"The safety envelope's {field.name} is {value}; it cannot be below zero.")
        if not (self.x_min_m < self.x_max_m and self.y_min_m < self.y_max_m):
            raise ConfigError(
                "The safety envelope's workspace is empty: its x_min and y_min must lie below its x_max and y_max."
            )

    @property
    def id(self) -> str:
        """Digest of all limits; a plan names the envelope that it was made for."""
        text = json.dumps({name: float(value) for name, value in asdict(self).items()}, sort_keys=True)
        return hashlib.sha256(text.encode("ascii")).hexdigest()[:16]

    def tightened(self, by: SafetyEnvelope) -> SafetyEnvelope:
        """What both envelopes allow: no limit is wider than in either.

        Limits travel with what was planned under them; a robot's own can only narrow them. Raises ConfigError
        if the two have no place in common.
        """
        limits = {
            field.name: (max if field.name in ("x_min_m", "y_min_m") else min)(
                getattr(self, field.name), getattr(by, field.name)
            )
            for field in fields(self)
        }
        return SafetyEnvelope(**limits)

    def narrowed(self, limits: Mapping[str, float]) -> SafetyEnvelope:
        """As `tightened`, by the limits named alone, such as a rig's own (`Rig.limits`)."""
        unknown = sorted(limits.keys() - {field.name for field in fields(self)})
        if unknown:
            raise ConfigError(f"The safety envelope has no limit named {unknown}; it has {sorted(asdict(self))}.")
        return self.tightened(replace(self, **limits))

    def wider_than(self, other: SafetyEnvelope) -> tuple[str, ...]:
        """Names of the limits that let through what the other envelope refuses; empty if there is none."""
        joint = self.tightened(other)
        return tuple(field.name for field in fields(self) if getattr(joint, field.name) != getattr(self, field.name))

    def check_path(self, path: FloatArray) -> None:
        """Return if path[N, 5] (t_s, x_m, y_m, z_m, yaw_rad) lies inside; else raise EnvelopeViolation."""
        self.checked_copy(path)

    def checked_copy(self, path: FloatArray) -> FloatArray:
        """As check_path, and return the very float64[N, 5] that was checked, shared with nobody."""
        points = _as_points(path)
        _check_times(points, self.max_duration_s)
        _check_places(points, self)
        _check_rates(points, self)
        return points


def envelope_for(tool: Tool, canvas_size_m: tuple[float, float]) -> SafetyEnvelope:
    """The envelope of one tool over a whole canvas: the tool's own press and speed, gentle motion."""
    width_m, height_m = canvas_size_m
    return SafetyEnvelope(
        x_min_m=0.0,
        y_min_m=0.0,
        x_max_m=width_m,
        y_max_m=height_m,
        max_press_depth_m=tool.press_range_m[1],
        max_travel_height_m=0.05,
        max_speed_m_s=tool.speed_range_m_s[1],
        # A quarter above what timed_path commands: another sampling of a path measures other bends.
        max_acceleration_m_s2=1.25 * ACCELERATION_M_S2,
        max_yaw_rad=2 * math.pi,
        max_yaw_rate_rad_s=math.pi,
        max_duration_s=30.0,
    )


def _as_points(path: FloatArray) -> FloatArray:
    try:
        points = np.asarray(path)
    except ValueError as error:
        raise EnvelopeViolation(f"The path is not an array [N, 5] (t, x, y, z, yaw): {error}.") from error
    if points.dtype.kind not in "fiu":
        raise EnvelopeViolation(f"The path holds {points.dtype} values; it must hold real numbers.")
    if points.ndim != 2 or points.shape[1] != 5 or len(points) < 2:
        raise EnvelopeViolation(
            f"The path has shape {points.shape}; it must be [N, 5] (t, x, y, z, yaw), N of 2 or more."
        )
    points = points.astype(np.float64)
    bad = np.argwhere(~np.isfinite(points))
    if bad.size:
        row, column = bad[0]
        raise EnvelopeViolation(
            f"The path's {_NAMES[column]} at point {row} is {points[row, column]}; every value must be finite."
        )
    return points


def _check_times(points: FloatArray, max_duration_s: float) -> None:
    t_s = points[:, 0]
    latest = int(np.argmax(np.abs(t_s)))
    if not abs(t_s[latest]) <= max_duration_s * (1 + _FLOAT32):
        slip = abs(t_s[latest]) / 1000 <= max_duration_s
        hint = " Times are in seconds; these look like milliseconds." if slip else ""
        _refuse("time", latest, t_s[latest], f"0 to {max_duration_s:g} s", "s", hint)
    if not abs(t_s[0]) <= MIN_STEP_S:
        _refuse("time", 0, t_s[0], "0 s, the stroke's start", "s")
    step_s = np.diff(t_s)
    # Rounding may take this much from a step that was just long enough.
    worst = int(np.argmin(step_s))
    if not step_s[worst] >= MIN_STEP_S - 2 * _FLOAT32 * np.abs(t_s).max():
        _refuse(
            "time since the point before",
            worst + 1,
            step_s[worst],
            f"a step of at least {MIN_STEP_S:g} s",
            "s",
        )


def _check_places(points: FloatArray, envelope: SafetyEnvelope) -> None:
    limits = (
        (1, envelope.x_min_m, envelope.x_max_m),
        (2, envelope.y_min_m, envelope.y_max_m),
        (3, -envelope.max_press_depth_m, envelope.max_travel_height_m),
    )
    hint = _millimetre_hint(points, limits)
    for column, low, high in limits:
        values = points[:, column]
        excess = np.maximum(low - values, values - high)
        worst = int(np.argmax(excess))
        if not excess[worst] <= _EXECUTION_NOISE_M:
            _refuse(_place_name(column, values[worst]), worst, values[worst], f"{low:g} to {high:g} m", "m", hint)
    worst = int(np.argmax(np.abs(points[:, 4])))
    if not abs(points[worst, 4]) <= envelope.max_yaw_rad * (1 + _FLOAT32):
        slip = abs(math.radians(points[worst, 4])) <= envelope.max_yaw_rad
        hint = " Angles are in radians; these look like degrees." if slip else ""
        _refuse("yaw", worst, points[worst, 4], f"{envelope.max_yaw_rad:g} rad either way", "rad", hint)


def _place_name(column: int, value: float) -> str:
    if column < 3:
        return _NAMES[column]
    return "press depth (z)" if value < 0 else "travel height (z)"


def _millimetre_hint(points: FloatArray, limits: tuple[tuple[int, float, float], ...]) -> str:
    shrunk = points / 1000
    fits = all(np.all((shrunk[:, c] >= low) & (shrunk[:, c] <= high)) for c, low, high in limits)
    return " Lengths are in metres; these look like millimetres." if fits else ""


def _check_rates(points: FloatArray, envelope: SafetyEnvelope) -> None:
    """Speeds and accelerations, each allowed the error that float32 rounding of the points can make."""
    step_s = np.diff(points[:, 0])
    speed = tip_speeds(points)
    place_error_m = 2 * math.sqrt(3) * _FLOAT32 * np.abs(points[:, 1:4]).max()
    time_error_s = 2 * _FLOAT32 * np.abs(points[:, 0]).max()
    speed_error = (place_error_m + speed * time_error_s) / step_s
    _check_limit("speed", speed, speed_error, envelope.max_speed_m_s, "m/s")

    yaw_rate = np.abs(np.diff(points[:, 4])) / step_s
    yaw_error = (2 * _FLOAT32 * np.abs(points[:, 4]).max() + yaw_rate * time_error_s) / step_s
    _check_limit("yaw rate", yaw_rate, yaw_error, envelope.max_yaw_rate_rad_s, "rad/s")

    span_s = acceleration_spans(points)
    acceleration = tip_accelerations(points)
    padded = np.concatenate(([0.0], speed_error, [0.0]))
    acceleration_error = (padded[:-1] + padded[1:] + acceleration * time_error_s) / span_s
    _check_limit("acceleration", acceleration, acceleration_error, envelope.max_acceleration_m_s2, "m/s²")


def _check_limit(what: str, values: FloatArray, errors: FloatArray, limit: float, unit: str) -> None:
    worst = int(np.argmax(values - errors))
    if not values[worst] - errors[worst] <= limit * (1 + 1e-9):
        _refuse(what, worst, values[worst], f"{limit:g} {unit}", unit)


def _refuse(what: str, index: int, value: float, limit: str, unit: str, hint: str = "") -> NoReturn:
    raise EnvelopeViolation(
        f"The path's {what} at point {index} is {value:.6g} {unit}; "
        f"the safety envelope allows {limit}.{hint} The command was refused."
    )


class GuardedRobot:
    """A Robot whose every command is checked before it reaches the driver, and that can be stopped for good.

    The driver gets a checked copy, so that what was checked is what moves. Whatever goes wrong in the driver
    on the way of a command, KeyboardInterrupt included, lifts the tool and leaves the robot stopped. A stop is
    latched: until `release` every command is refused, photos included. A scan and the clock pass through.
    """

    def __init__(self, robot: Robot, envelope: SafetyEnvelope) -> None:
        """Raises EnvelopeViolation if the envelope reaches beyond the robot's canvas."""
        width_m, height_m = robot.canvas_size_m
        low, high = (envelope.x_min_m, envelope.y_min_m), (envelope.x_max_m, envelope.y_max_m)
        margins = (*low, width_m - high[0], height_m - high[1])
        if not all(margin >= -_EXECUTION_NOISE_M for margin in margins):
            raise EnvelopeViolation(
                f"The safety envelope from {low} to {high} m reaches beyond the robot's canvas of "
                f"{width_m:g} by {height_m:g} m; build it with envelope_for(tool, robot.canvas_size_m)."
            )
        self._robot = robot
        self._envelope = envelope
        self._tool_fits = False
        self._paints = 0
        self._stopped: str | None = None
        self._latch = threading.Lock()
        self._idle = threading.Event()  # no command is on its way
        self._idle.set()

    @property
    def envelope(self) -> SafetyEnvelope:
        """The envelope that guards this robot."""
        return self._envelope

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
        # A command that passed the check just before the latch may have reached the driver just after the lift.
        for _ in range(_LIFTS_AGAIN):
            if self._idle.wait(_LIFT_AGAIN_S):
                return
            self.lift()

    def release(self) -> None:
        """Let commands pass again. For a person who has looked at the robot, never for a program that retries."""
        with self._latch:
            self._stopped = None

    def lift(self) -> None:
        """Stop where the tool is and raise it; allowed at any time. Raises LiftError if that fails."""
        try:
            self._robot.lift()
        except Exception as error:
            with self._latch:
                self._stopped = self._stopped or "the tool could not be lifted"
            raise LiftError(
                f"The tool may still rest on the canvas, because lifting it failed: {error} "
                "Use the robot's own emergency stop and lift the tool by hand."
            ) from error

    @property
    def canvas_size_m(self) -> tuple[float, float]:
        return self._robot.canvas_size_m

    @property
    def clock_s(self) -> float:
        return self._robot.clock_s

    def change_tool(self, tool: Tool) -> None:
        """Refuses a tool that bears less press or speed than the envelope would let through."""
        bears = (
            ("a press", self._envelope.max_press_depth_m, tool.press_range_m[1], "m"),
            ("a speed", self._envelope.max_speed_m_s, tool.speed_range_m_s[1], "m/s"),
        )
        for what, allowed, borne, unit in bears:
            if allowed > borne * (1 + 1e-9):
                raise EnvelopeViolation(
                    f"The safety envelope allows {what} of {allowed:g} {unit} and the {tool.name} bears "
                    f"{borne:g} {unit}; build the envelope with envelope_for for this tool."
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
        if not 0 <= seconds <= _MAX_WAIT_S:
            raise EnvelopeViolation(f"A wait of {seconds} s is refused; it must last from 0 to {_MAX_WAIT_S:g} s.")
        with self._passing("wait"):
            self._robot.wait(seconds)

    @contextmanager
    def _passing(self, command: str) -> Iterator[None]:
        """Around each call of the driver: refuse while stopped, and lift and latch on whatever goes wrong."""
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
        # Stopped from another thread on its way: what the driver has done of the command is not known.
        self._refuse_if_stopped(command)

    def _refuse_if_stopped(self, command: str) -> None:
        if self._stopped is not None:
            raise StoppedError(
                f"The robot is stopped ({self._stopped}) and the {command} is refused; look at the robot, then "
                "release it by hand."
            )
