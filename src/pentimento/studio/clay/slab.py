"""The slab before a push: its surface after smoothing, random texture fields, and its hardness by age and air."""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pentimento.studio.clay.world import ClayEffects, Material, Room, Slab

Array = NDArray[np.float64]

UNDULATION_M = 0.022  # size of the waves that smoothing leaves


def cells_shape(slab: Slab, scan_pixels: int) -> tuple[int, int]:
    """Rows and columns of the height field: at least two cells for each pixel of the scanner."""
    longer = max(slab.cells, 2 * scan_pixels)
    cells_per_m = longer / max(slab.size_m)
    return round(slab.size_m[1] * cells_per_m), round(slab.size_m[0] * cells_per_m)


def smooth_field(shape: tuple[int, int], cells: float, rng: np.random.Generator) -> Array:
    """Random field float64[H,W] of mean 0, standard deviation 1 and a grain of about `cells` cells.

    Drawn on a coarse lattice of a third of the grain, so that the field is the same at every resolution.
    """
    lattice = [max(4, math.ceil(3 * n / cells)) for n in shape]
    coarse = cv2.GaussianBlur(rng.standard_normal(lattice), (0, 0), 1.2, borderType=cv2.BORDER_REFLECT)
    field = cv2.resize(coarse, (shape[1], shape[0]), interpolation=cv2.INTER_CUBIC)
    return np.asarray((field - field.mean()) / field.std())


def fresh_surface(slab: Slab, shape: tuple[int, int], rng: np.random.Generator) -> Array:
    """Height above the table float64[H,W] of the slab as smoothing leaves it."""
    cells_per_m = shape[1] / slab.size_m[0]
    level_m = slab.height_m + slab.height_spread_m * rng.standard_normal()
    waves = smooth_field(shape, UNDULATION_M * cells_per_m, rng)
    grain = smooth_field(shape, 0.0025 * cells_per_m, rng)
    return np.asarray(level_m + slab.undulation_m * waves + slab.roughness_m * grain)


NEUTRAL_C = 21.0  # at which the material has its own hardness
NEUTRAL_HUMIDITY = 0.45


@dataclass(frozen=True)
class Air:
    """The room's air at one time."""

    temperature_c: float
    humidity: float


def air_at(room: Room, t_s: float, rng: np.random.Generator) -> Air:
    """The air at a time. `rng` is the room's, in its initial state at each call, so that the drift is one curve."""
    phase = rng.uniform(0.0, 2 * math.pi, 4)
    day = 2 * math.pi * t_s / room.period_s
    warm = 0.75 * math.sin(day + phase[0]) + 0.25 * math.sin(3.7 * day + phase[1])
    damp = 0.7 * math.sin(1.6 * day + phase[2]) + 0.3 * math.sin(4.9 * day + phase[3])
    return Air(room.temperature_c + room.temperature_swing_k * warm, room.humidity + room.humidity_swing * damp)


def hardness_factor(material: Material, effects: ClayEffects, air: Air, age_s: float) -> float:
    """Hardness over that of fresh material at 21 degrees and 45 % humidity."""
    dried = 1.0 - (1.0 + (age_s / material.drying_s) ** 1.3) ** -0.8
    drift = (1.0 + effects.stiffness_drift * material.drying * dried) * math.exp(
        -effects.stiffness_drift * material.softening_per_k * (air.temperature_c - NEUTRAL_C)
    )
    damp = math.tanh((air.humidity - NEUTRAL_HUMIDITY) / 0.1)
    return drift * math.exp(-effects.humidity_softening * material.swelling * damp)
