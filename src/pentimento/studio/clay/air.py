"""Time, temperature and humidity, and what they do to the material's hardness."""

import math
from dataclasses import dataclass

import numpy as np

from pentimento.studio.clay.world import ClayEffects, Material, Room

NEUTRAL_C, NEUTRAL_HUMIDITY = 21.0, 0.45


@dataclass(frozen=True)
class Air:
    """The room's air at one time."""

    temperature_c: float
    humidity: float


def air_at(room: Room, t_s: float, rng: np.random.Generator) -> Air:
    """The air at a time; `rng` is the room's own and fresh at each call, so that its wandering is one curve."""
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
