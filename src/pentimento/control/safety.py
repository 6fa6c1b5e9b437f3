"""The safety envelope: the limits that every path must satisfy before it reaches a robot.

The envelope is a value and its check is pure. It rejects and never clamps: a clamped command differs from the planned
one and hides the error that made it wrong.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.errors import ConfigError, EnvelopeViolation
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
_FLOAT32 = 2.0**-24  # largest relative rounding error: paths are stored in float32 tables
ROUNDING_M = 1e-7
"""Rounding error of a coordinate that was stored as float32 at the edge of the workspace."""


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
        """The intersection of two envelopes: no limit is wider than in either.

        Raises ConfigError if the two workspaces do not overlap.
        """
        limits = {
            field.name: (max if field.name in ("x_min_m", "y_min_m") else min)(
                getattr(self, field.name), getattr(by, field.name)
            )
            for field in fields(self)
        }
        return SafetyEnvelope(**limits)

    def narrowed(self, limits: Mapping[str, float]) -> SafetyEnvelope:
        """As `tightened`, by the named limits alone, such as those of a rig (`Rig.limits`)."""
        unknown = sorted(limits.keys() - {field.name for field in fields(self)})
        if unknown:
            raise ConfigError(f"The safety envelope has no limit named {unknown}; it has {sorted(asdict(self))}.")
        return self.tightened(replace(self, **limits))

    def wider_than(self, other: SafetyEnvelope) -> tuple[str, ...]:
        """Names of the limits that allow what the other envelope refuses."""
        joint = self.tightened(other)
        return tuple(field.name for field in fields(self) if getattr(joint, field.name) != getattr(self, field.name))

    def check_path(self, path: FloatArray) -> None:
        """Return if path[N, 5] (t_s, x_m, y_m, z_m, yaw_rad) lies inside; else raise EnvelopeViolation."""
        self.checked_copy(path)

    def checked_copy(self, path: FloatArray) -> FloatArray:
        """As check_path; returns the checked float64[N, 5], a copy that nothing else refers to."""
        points = _as_points(path)
        _check_times(points, self.max_duration_s)
        _check_places(points, self)
        _check_rates(points, self)
        return points


def envelope_for(tool: Tool, canvas_size_m: tuple[float, float]) -> SafetyEnvelope:
    """The envelope of one tool over a whole canvas, with the tool's limits of press and speed."""
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
        _refuse("time", latest, t_s[latest], limit=f"0 to {max_duration_s:g} s", unit="s", hint=hint)
    if not abs(t_s[0]) <= MIN_STEP_S:
        _refuse("time", 0, t_s[0], limit="0 s, the stroke's start", unit="s")
    step_s = np.diff(t_s)
    # Rounding may take this much from a step that was just long enough.
    worst = int(np.argmin(step_s))
    if not step_s[worst] >= MIN_STEP_S - 2 * _FLOAT32 * np.abs(t_s).max():
        _refuse(
            "time since the point before",
            worst + 1,
            step_s[worst],
            limit=f"a step of at least {MIN_STEP_S:g} s",
            unit="s",
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
        if not excess[worst] <= ROUNDING_M:
            _refuse(
                _place_name(column, values[worst]),
                worst,
                values[worst],
                limit=f"{low:g} to {high:g} m",
                unit="m",
                hint=hint,
            )
    worst = int(np.argmax(np.abs(points[:, 4])))
    if not abs(points[worst, 4]) <= envelope.max_yaw_rad * (1 + _FLOAT32):
        slip = abs(math.radians(points[worst, 4])) <= envelope.max_yaw_rad
        hint = " Angles are in radians; these look like degrees." if slip else ""
        _refuse("yaw", worst, points[worst, 4], limit=f"{envelope.max_yaw_rad:g} rad either way", unit="rad", hint=hint)


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
        _refuse(what, worst, values[worst], limit=f"{limit:g} {unit}", unit=unit)


def _refuse(what: str, index: int, value: float, *, limit: str, unit: str, hint: str = "") -> NoReturn:
    raise EnvelopeViolation(
        f"The path's {what} at point {index} is {value:.6g} {unit}; "
        f"the safety envelope allows {limit}.{hint} The command was refused."
    )
