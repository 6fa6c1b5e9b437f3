"""Five synthetic writers, which give the pipeline demonstrations where there are no recordings.

Each draws by the sigma-lognormal model of handwriting (Plamondon 1995; O'Reilly & Plamondon 2009): a stroke is a sum of
ballistic movements, each with a lognormal speed profile along an arc. Movements that overlap in time give smooth
corners. A session has its own size, slant and tempo. A stroke has its own number of movements and their random
variation. All strokes of a writer are of one kind.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import erf

from pentimento.contracts.ranges import above_zero, at_least
from pentimento.handwriting.recording import Recording, recording, turned

FloatArray = NDArray[np.float64]
Rng = np.random.Generator

_RATE_HZ: Final = 200.0
_JITTER_M: Final = 2e-5
"""Standard deviation of the tracker's noise in each coordinate."""
_PRESSED_M: Final = 6e-4
"""Depth of the tip below the paper at full pressure: a fibre tip is soft."""
_RAMP_S: Final = 0.04
"""Duration of touch-down and of lift-off."""
_SHEET_M: Final = (0.24, 0.18)


@dataclass(frozen=True)
class SyntheticConfig:
    """How much the synthetic writers draw."""

    sessions: int
    """Sessions of each writer."""
    strokes: int
    """Strokes in each session."""
    seed: int

    def __post_init__(self) -> None:
        at_least(self, 2, "sessions")
        above_zero(self, "strokes")
        at_least(self, 0, "seed")


def synthetic_sessions(config: SyntheticConfig) -> list[Recording]:
    """All sessions of all writers. Each stroke depends only on the seed, its writer, session and number."""
    return [
        _stroke(hand, number, session, index, config.seed)
        for number, hand in enumerate(HANDS)
        for session in range(config.sessions)
        for index in range(config.strokes)
    ]


def _stroke(hand: str, number: int, session: int, index: int, seed: int) -> Recording:
    of_session = np.random.default_rng([seed, 11, number, session])
    size, slant = math.exp(of_session.normal(0, 0.08)), of_session.normal(0, 0.12)
    tempo = math.exp(of_session.normal(0, 0.1))
    rng = np.random.default_rng([seed, 12, number, session, index])
    way = trajectory([_at_tempo(m, tempo) for m in HANDS[hand](rng)], _RATE_HZ)
    speed = np.linalg.norm(np.gradient(way[:, 1:], axis=0), axis=1)
    drawn = slice(
        int(np.argmax(speed > 0.02 * speed.max())), len(speed) - int(np.argmax(speed[::-1] > 0.02 * speed.max()))
    )
    t, speed = way[drawn, 0] - way[drawn, 0][0], speed[drawn]
    pressure = _pressure(t, speed, rng)
    xy = size * turned(way[drawn, 1:], slant + rng.normal(0, 0.05)) + rng.uniform((0.02, 0.02), _SHEET_M)
    xy = xy + rng.normal(0, _JITTER_M, xy.shape)
    return recording(f"{hand}_{session}", hand, xy, t_s=t, z_m=-_PRESSED_M * pressure, pressure=pressure)


def _pressure(t: FloatArray, speed: FloatArray, rng: Rng) -> FloatArray:
    """[K] higher where the pen is slow, with a ramp at touch-down and lift-off."""
    firm = rng.uniform(0.55, 0.75) + 0.25 * (0.5 - speed / max(float(speed.max()), 1e-12))
    ramp = np.minimum(np.minimum(t, t[-1] - t) / _RAMP_S, 1.0)
    return np.clip(firm * (0.3 + 0.7 * ramp), 0.0, 1.0)


def _at_tempo(movement: Movement, tempo: float) -> Movement:
    return movement._replace(begins_s=movement.begins_s / tempo, mu=movement.mu - math.log(tempo))


def _loops(rng: Rng) -> list[Movement]:
    """Two or three loops like a row of `e`: half turns, the lower ones longer than the upper ones."""
    wide, high, heading = rng.uniform(0.011, 0.014), rng.uniform(0.007, 0.009), rng.normal(-0.3, 0.15)
    movements = []
    for half in range(2 * int(rng.integers(2, 4)) + 1):
        length = (wide if half % 2 == 0 else high) * math.exp(rng.normal(0, 0.06))
        movements.append(_movement(rng, half, 0.13, length_m=length, from_rad=heading, to_rad=heading + math.pi))
        heading += math.pi + rng.normal(0, 0.06)
    return movements


def _zigzags(rng: Rng) -> list[Movement]:
    """Three to five sharp turns to and fro."""
    step, sharp = rng.uniform(0.009, 0.013), rng.uniform(1.15, 1.3)
    movements = []
    for leg in range(int(rng.integers(3, 6))):
        heading = (sharp if leg % 2 == 0 else -sharp) + rng.normal(0, 0.07)
        movements.append(
            _movement(
                rng,
                leg,
                0.17,
                length_m=step * math.exp(rng.normal(0, 0.1)),
                from_rad=heading,
                to_rad=heading + rng.normal(0, 0.1),
            )
        )
    return movements


def _dots(rng: Rng) -> list[Movement]:
    """A curl of about 2 mm."""
    length, turn = rng.uniform(0.0035, 0.0055), rng.uniform(2.4, 3.2)
    first = _movement(rng, 0, 0.1, length_m=length, from_rad=0.0, to_rad=turn)
    return [first, _movement(rng, 1, 0.1, length_m=length * rng.uniform(0.8, 1.1), from_rad=turn, to_rad=2 * turn)]


def _arcs(rng: Rng) -> list[Movement]:
    """One long arc, to either side."""
    side, bend = (-1.0 if rng.random() < 0.5 else 1.0), rng.uniform(0.5, 0.9)
    half = rng.uniform(0.018, 0.028)
    first = _movement(rng, 0, 0.16, length_m=half, from_rad=side * bend, to_rad=0.0)
    return [
        first,
        _movement(rng, 1, 0.16, length_m=half * math.exp(rng.normal(0, 0.1)), from_rad=0.0, to_rad=-side * bend),
    ]


def _hatching(rng: Rng) -> list[Movement]:
    """A short straight line that ends in a small hook."""
    heading = rng.normal(0, 0.03)
    line = _movement(
        rng, 0, 0.1, length_m=rng.uniform(0.010, 0.015), from_rad=heading, to_rad=heading + rng.normal(0, 0.08)
    )
    return [
        line,
        _movement(rng, 1, 0.16, length_m=rng.uniform(0.0012, 0.002), from_rad=heading + 1.8, to_rad=heading + 3.4),
    ]


def _movement(rng: Rng, place: int, apart_s: float, *, length_m: float, from_rad: float, to_rad: float) -> Movement:
    """The movement at this place of a sequence, with random timing."""
    mu, sigma = math.log(0.16) + rng.normal(0, 0.04), 0.22 * math.exp(rng.normal(0, 0.08))
    return Movement(length_m, place * apart_s, mu, sigma, from_rad, to_rad)


HANDS: Final[dict[str, Callable[[Rng], list[Movement]]]] = {
    "loops": _loops, "zigzags": _zigzags, "dots": _dots, "arcs": _arcs, "hatching": _hatching,
}  # fmt: skip
"""Writers by name: a function that draws the movements of one stroke."""


_DURATION_SIGMAS = 3.0
"""Standard deviations of ln t after which a movement is cut off; a thousandth of its length is missing then."""


class Movement(NamedTuple):
    """One ballistic movement."""

    length_m: float
    begins_s: float
    mu: float
    """Mean of ln(seconds since its beginning)."""
    sigma: float
    """Standard deviation of the same."""
    from_rad: float
    to_rad: float
    """Heading at the end. The heading turns linearly with the travelled length."""


def trajectory(movements: Sequence[Movement], rate_hz: float) -> FloatArray:
    """[K, 3] t_s, x_m, y_m from the origin to the end of the last movement."""
    over = max(m.begins_s + math.exp(m.mu + _DURATION_SIGMAS * m.sigma) for m in movements)
    t = np.arange(math.ceil(over * rate_hz) + 1) / rate_hz
    place = np.zeros((len(t), 2))
    for movement in movements:
        place += _along(movement, t)
    return np.column_stack([t, place])


def _along(movement: Movement, t: FloatArray) -> FloatArray:
    """[K, 2] displacement of one movement. It is exact, since the heading is a linear function of the share."""
    since = np.maximum(t - movement.begins_s, 1e-12)
    share = 0.5 * (1 + erf((np.log(since) - movement.mu) / (movement.sigma * math.sqrt(2))))
    turn = movement.to_rad - movement.from_rad
    if abs(turn) < 1e-9:
        way = share[:, None] * np.array([math.cos(movement.from_rad), math.sin(movement.from_rad)])
    else:
        heading = movement.from_rad + turn * share
        way = np.column_stack([
            np.sin(heading) - math.sin(movement.from_rad), math.cos(movement.from_rad) - np.cos(heading),
        ]) / turn  # fmt: skip
    return np.asarray(movement.length_m * way)
