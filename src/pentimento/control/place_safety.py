"""The safety envelope of pellets: where they may be set, how large they may be, and how high the material may grow.

As in push_safety.py, the envelope is a value, its check is pure, and it rejects and never clamps.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np

from pentimento.contracts.errors import ConfigError, EnvelopeViolation
from pentimento.control.safety import ROUNDING_M
from pentimento.robots.driver import Place
from pentimento.robots.tools import Feeder, ball_diameter_m

_RELATIVE = 1e-6
"""Relative rounding of volumes and heights that were stored in single precision."""


@dataclass(frozen=True)
class PlaceEnvelope:
    """What a feeder may be commanded to do on one slab (canvas frame, SI units).

    A pellet, as a ball before it is pressed, lies within x_min..x_max, y_min..y_max; pressed, its top is at most
    `max_height_m` above the table.
    """

    x_min_m: float
    y_min_m: float
    x_max_m: float
    y_max_m: float
    min_volume_m3: float
    max_volume_m3: float
    max_height_m: float

    def __post_init__(self) -> None:
        for field in fields(self):
            if not math.isfinite(getattr(self, field.name)):
                raise ConfigError(
                    f"The place envelope's {field.name} is {getattr(self, field.name)}; every limit must be finite."
                )
        if not (self.x_min_m < self.x_max_m and self.y_min_m < self.y_max_m):
            raise ConfigError(
                "The place envelope's workspace is empty: its x_min and y_min must lie below its x_max and y_max."
            )
        if not (0 < self.min_volume_m3 <= self.max_volume_m3 and self.max_height_m > 0):
            raise ConfigError(
                f"The place envelope allows volumes from {self.min_volume_m3:g} to {self.max_volume_m3:g} m³ and a "
                f"height of {self.max_height_m:g} m; they must be above 0, the smaller volume first."
            )

    def check(self, place: Place) -> None:
        """Raise EnvelopeViolation unless the pellet lies inside."""
        for field in fields(place):
            value = getattr(place, field.name)
            real = isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)
            if not real or not math.isfinite(value):
                raise EnvelopeViolation(f"The pellet's {field.name} is {value!r}; it must be a finite number.")
        volume, limits = place.volume_m3, (self.min_volume_m3, self.max_volume_m3)
        if not limits[0] * (1 - _RELATIVE) <= volume <= limits[1] * (1 + _RELATIVE):
            hint = " Volumes are in cubic metres; this looks like cubic millimetres." if volume > 1 else ""
            raise EnvelopeViolation(
                f"The pellet's volume is {volume:.6g} m³; the place envelope allows {limits[0]:.3g} to {limits[1]:.3g} "
                f"m³.{hint} The command was refused."
            )
        radius_m = 0.5 * ball_diameter_m(volume)
        margin = radius_m - ROUNDING_M
        inside_x = self.x_min_m + margin <= place.x_m <= self.x_max_m - margin
        inside_y = self.y_min_m + margin <= place.y_m <= self.y_max_m - margin
        if not (inside_x and inside_y):
            hint = " Lengths are in metres; these look like millimetres." if max(place.x_m, place.y_m) > 1 else ""
            raise EnvelopeViolation(
                f"A pellet of {2e3 * radius_m:.3g} mm at ({place.x_m:.6g}, {place.y_m:.6g}) m is off the slab; the "
                f"place envelope allows x from {self.x_min_m:g} to {self.x_max_m:g} m and y from {self.y_min_m:g} to "
                f"{self.y_max_m:g} m for all of it.{hint} The command was refused."
            )
        if place.surface_m <= 0 or place.press_m < 0:
            raise EnvelopeViolation(
                f"The pellet is commanded on a surface {place.surface_m:.6g} m above the table, pressed to "
                f"{place.press_m:.6g} m; the first is above 0, the second 0 or more. The command was refused."
            )
        top_m = place.surface_m + place.press_m
        if not top_m <= self.max_height_m * (1 + _RELATIVE):
            raise EnvelopeViolation(
                f"A pellet pressed to {1e3 * top_m:.4g} mm above the table is higher than the place envelope allows, "
                f"{1e3 * self.max_height_m:.4g} mm. The command was refused."
            )


def place_envelope_for(feeder: Feeder, area_m: tuple[float, float], max_height_m: float = 0.06) -> PlaceEnvelope:
    """The envelope of one feeder over a whole slab, on which material is nowhere higher than `max_height_m`."""
    return PlaceEnvelope(0.0, 0.0, area_m[0], area_m[1], *feeder.volume_m3, max_height_m)
