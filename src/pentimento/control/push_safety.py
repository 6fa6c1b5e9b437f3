"""The safety envelope of pushes, and the guard that checks every push and pellet before it reaches the driver.

As in safety.py, the envelope is a value, its check is pure, and it rejects and never clamps.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.errors import ConfigError, EnvelopeViolation
from pentimento.contracts.observations import Scan
from pentimento.control.guard import MAX_WAIT_S, StopLatch
from pentimento.control.place_safety import PlaceEnvelope
from pentimento.control.safety import ROUNDING_M
from pentimento.robots.driver import Place, Push, SculptingRobot, span_m
from pentimento.robots.tools import EndEffector, PushKind

FloatArray = NDArray[np.float64]

MIN_CLEARANCE_M = 0.005
"""Minimum height of a tool's tip above the table."""
_FLOAT32 = 2.0**-24  # largest relative rounding error: actions are stored in float32 tables
_NAMES = ("x", "y", "theta", "length", "depth")
_ENDS = {"push": ("start", "end"), "pinch": ("one finger", "other finger")}


@dataclass(frozen=True)
class PushEnvelope:
    """What one end-effector may be commanded to do to one slab (canvas frame, SI units).

    Both ends of a push, or both open fingers of a pinch, lie within x_min..x_max, y_min..y_max; the tip stays
    `min_clearance_m` above the table and never goes deeper below the surface than `max_depth_m`.
    """

    kind: PushKind
    opening_m: float
    x_min_m: float
    y_min_m: float
    x_max_m: float
    y_max_m: float
    max_surface_m: float
    min_clearance_m: float
    max_length_m: float
    max_depth_m: float
    max_speed_m_s: float
    max_retract_speed_m_s: float
    max_dwell_s: float

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if field.name != "kind" and not math.isfinite(value):
                raise ConfigError(f"The push envelope's {field.name} is {value}; every limit must be finite.")
            if field.name[:4] in ("max_", "min_") and value < 0:
                raise ConfigError(f"The push envelope's {field.name} is {value}; it cannot be below zero.")
        if not (self.x_min_m < self.x_max_m and self.y_min_m < self.y_max_m):
            raise ConfigError(
                "The push envelope's workspace is empty: its x_min and y_min must lie below its x_max and y_max."
            )

    def check(self, push: Push) -> None:
        """Raise EnvelopeViolation unless the push lies inside."""
        self.checked_copy(push)

    def checked_copy(self, push: Push) -> Push:
        """As check; returns the checked push, a copy that nothing else refers to."""
        if push.kind != self.kind:
            raise EnvelopeViolation(f"A {push.kind} is commanded, and this end-effector makes a {self.kind}.")
        action = _as_action(push.action)
        numbers = {name: _as_number(push, name) for name in ("surface_m", "speed_m_s", "dwell_s", "retract_speed_m_s")}
        self._check_places(action, numbers["surface_m"])
        self._check_rates(numbers)
        return Push(push.kind, action, **numbers)

    def _check_places(self, action: FloatArray, surface_m: float) -> None:
        theta, length_m, depth_m = (float(v) for v in action[2:])
        shrunk = action / (1000, 1000, 1, 1000, 1000)
        slip = bool(self._off_slab(action).any() and not self._off_slab(shrunk).any())
        hint = " Lengths are in metres; these look like millimetres." if slip else ""
        if not abs(theta) <= 2 * math.pi * (1 + _FLOAT32):
            turns = " Angles are in radians; this looks like degrees." if abs(theta) <= 360 else ""
            _refuse("theta", theta, "2 pi rad either way", "rad", turns)
        _within("length", length_m, self.max_length_m, "m", hint)
        _within("depth", depth_m, self.max_depth_m, "m", hint)
        places = span_m(self.kind, action, self.opening_m)
        for place, off, where in zip(places, self._off_slab(action), _ENDS[self.kind], strict=True):
            if off.any():
                raise EnvelopeViolation(
                    f"The push's {where} ({place[0]:.6g}, {place[1]:.6g}) m is off the slab; the push envelope allows "
                    f"x from {self.x_min_m:g} to {self.x_max_m:g} m and y from {self.y_min_m:g} to {self.y_max_m:g} m."
                    f"{hint} The command was refused."
                )
        _within("surface", surface_m, self.max_surface_m, "m", " The surface's height is in metres above the table.")
        if not surface_m - depth_m >= self.min_clearance_m - ROUNDING_M:
            raise EnvelopeViolation(
                f"A push {depth_m:.6g} m deep from a surface {surface_m:.6g} m above the table would come within "
                f"{self.min_clearance_m:g} m of the table; there is not enough material. The command was refused."
            )

    def _check_rates(self, numbers: dict[str, float]) -> None:
        _within("speed", numbers["speed_m_s"], self.max_speed_m_s, "m/s", _speed_hint(numbers["speed_m_s"]))
        _within(
            "retract speed", numbers["retract_speed_m_s"], self.max_retract_speed_m_s, "m/s",
            _speed_hint(numbers["retract_speed_m_s"]),
        )  # fmt: skip
        for name in ("speed_m_s", "retract_speed_m_s"):
            if not numbers[name] > 0:
                _refuse(name.removesuffix("_m_s").replace("_", " "), numbers[name], "speeds above 0", "m/s", "")
        _within("dwell", numbers["dwell_s"], self.max_dwell_s, "s", " Times are in seconds.")

    def _off_slab(self, action: FloatArray) -> NDArray[np.bool_]:
        """bool[2, 2]: which coordinates of the push's two ends lie outside."""
        places = span_m(self.kind, action, self.opening_m)
        low, high = (self.x_min_m, self.y_min_m), (self.x_max_m, self.y_max_m)
        off: NDArray[np.bool_] = (places < np.array(low) - ROUNDING_M) | (places > np.array(high) + ROUNDING_M)
        return off


def push_envelope_for(
    end_effector: EndEffector,
    area_m: tuple[float, float],
    max_surface_m: float = 0.06,
    min_clearance_m: float = MIN_CLEARANCE_M,
) -> PushEnvelope:
    """The envelope of one end-effector over a whole slab that is nowhere higher than `max_surface_m`."""
    return PushEnvelope(
        kind=end_effector.kind,
        opening_m=end_effector.opening_m,
        x_min_m=0.0,
        y_min_m=0.0,
        x_max_m=area_m[0],
        y_max_m=area_m[1],
        max_surface_m=max_surface_m,
        min_clearance_m=min_clearance_m,
        max_length_m=end_effector.travel_m[1],
        max_depth_m=end_effector.depth_m[1],
        max_speed_m_s=end_effector.speed_range_m_s[1],
        max_retract_speed_m_s=end_effector.retract_speed_range_m_s[1],
        max_dwell_s=end_effector.dwell_range_s[1],
    )


def _as_action(action: FloatArray) -> FloatArray:
    try:
        numbers = np.array(action)
    except ValueError as error:
        raise EnvelopeViolation(f"The push's action is not five numbers: {error}.") from error
    if numbers.dtype.kind not in "fiu" or numbers.shape != (5,):
        raise EnvelopeViolation(
            f"The push's action is {numbers.dtype}{list(numbers.shape)}; it must be five real numbers {_NAMES}."
        )
    numbers = numbers.astype(np.float64)
    if not np.isfinite(numbers).all():
        bad = int(np.argmin(np.isfinite(numbers)))
        raise EnvelopeViolation(f"The push's {_NAMES[bad]} is {numbers[bad]}; every number must be finite.")
    return numbers


def _as_number(push: Push, name: str) -> float:
    value = getattr(push, name)
    real = isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)
    if not real or not math.isfinite(value):
        raise EnvelopeViolation(f"The push's {name} is {value!r}; it must be a finite number.")
    return float(value)


def _within(what: str, value: float, limit: float, unit: str, hint: str) -> None:
    if not 0 <= value <= limit * (1 + 2 * _FLOAT32):
        _refuse(what, value, f"0 to {limit:g} {unit}", unit, hint)


def _speed_hint(value: float) -> str:
    return " Speeds are in metres a second; this looks like millimetres." if value > 1 else ""


def _refuse(what: str, value: float, limit: str, unit: str, hint: str) -> None:
    raise EnvelopeViolation(
        f"The push's {what} is {value:.6g} {unit}; the push envelope allows {limit}.{hint} The command was refused."
    )


class GuardedSculptingRobot(StopLatch):
    """A SculptingRobot whose every push is checked before it reaches the driver, and that can be stopped for good.

    The driver gets the checked copy. Any error of the driver during a command lifts the tool and leaves the robot
    stopped: every later command is refused until a person has inspected the robot and calls `release`. Pellets are
    guarded alike, by an envelope of their own; without one, none may be set.
    """

    def __init__(self, robot: SculptingRobot, envelope: PushEnvelope, places: PlaceEnvelope | None = None) -> None:
        """Raises EnvelopeViolation if an envelope reaches beyond the robot's slab."""
        width_m, height_m = robot.area_m
        for kind, limits in (("push", envelope), ("place", places)):
            if limits is None:
                continue
            margins = (limits.x_min_m, limits.y_min_m, width_m - limits.x_max_m, height_m - limits.y_max_m)
            if not all(margin >= -ROUNDING_M for margin in margins):
                builder = "push_envelope_for(end_effector" if kind == "push" else "place_envelope_for(feeder"
                raise EnvelopeViolation(
                    f"The {kind} envelope reaches beyond the robot's slab of {width_m:g} by {height_m:g} m; "
                    f"build it with {builder}, robot.area_m)."
                )
        self._robot, self._envelope, self._places = robot, envelope, places
        self._tool_fits = False
        super().__init__(robot, "in the material")

    @property
    def envelope(self) -> PushEnvelope:
        """The envelope that guards this robot."""
        return self._envelope

    @property
    def area_m(self) -> tuple[float, float]:
        return self._robot.area_m

    @property
    def clock_s(self) -> float:
        return self._robot.clock_s

    def change_tool(self, end_effector: EndEffector) -> None:
        """Refuses an end-effector that tolerates less than the envelope allows."""
        limits = push_envelope_for(end_effector, self._robot.area_m)
        for name in ("max_length_m", "max_depth_m", "max_speed_m_s", "max_retract_speed_m_s"):
            if getattr(self._envelope, name) > getattr(limits, name) * (1 + 1e-9):
                raise EnvelopeViolation(
                    f"The push envelope's {name} is {getattr(self._envelope, name):g} and the {end_effector.name} "
                    f"tolerates {getattr(limits, name):g}; build the envelope with push_envelope_for for it."
                )
        if (end_effector.kind, end_effector.opening_m) != (self._envelope.kind, self._envelope.opening_m):
            raise EnvelopeViolation(
                f"The push envelope is for a {self._envelope.kind} and the {end_effector.name} makes a "
                f"{end_effector.kind}; build the envelope for this end-effector."
            )
        with self._passing("change of tool"):
            self._robot.change_tool(end_effector)
        self._tool_fits = True

    def push(self, push: Push) -> FloatArray:
        """Refuses a push outside the envelope, and any push before `change_tool` has seen the end-effector."""
        if not self._tool_fits:
            raise EnvelopeViolation("The guard does not know the end-effector; call change_tool before the first push.")
        checked = self._envelope.checked_copy(push)
        with self._passing("push"):
            return self._robot.push(checked)

    def place(self, place: Place) -> None:
        """Refuses a pellet outside the envelope, and any pellet where there is no envelope of pellets."""
        if self._places is None:
            raise EnvelopeViolation(
                "A pellet is commanded and the robot has no place envelope; build one with place_envelope_for(feeder, "
                "robot.area_m) and give it to the guard."
            )
        self._places.check(place)
        with self._passing("pellet"):
            self._robot.place(place)

    def scan(self) -> Scan:
        """Refused while stopped: a robot may have to move out of the view."""
        with self._passing("scan"):
            return self._robot.scan()

    def smooth(self) -> None:
        with self._passing("smoothing"):
            self._robot.smooth()

    def ambient(self) -> dict[str, float]:
        return self._robot.ambient()

    def wait(self, seconds: float) -> None:
        if not 0 <= seconds <= MAX_WAIT_S:
            raise EnvelopeViolation(f"A wait of {seconds} s is refused; it must last from 0 to {MAX_WAIT_S:g} s.")
        with self._passing("wait"):
            self._robot.wait(seconds)
