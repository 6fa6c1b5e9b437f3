"""Dataset B of the comparison: strokes in hands that no robot's calibration draws (thesis 5.4.3, "very unique styles").

The calibration (dataset A) draws Bézier strokes, each bent one way. These loop, turn sharply, wind in and wave, are
pressed in pulses, and end wherever they like against their start.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

HANDS = ("loops", "zigzag", "spiral", "wave", "star", "hook")
_DENSE = 400


def hand_stroke(
    hand: str, rng: np.random.Generator, size_m: float, press_range_m: tuple[float, float], points: int
) -> FloatArray:
    """A stroke about the origin, float64[points, 4]: x_m, y_m, z_m, yaw_rad; equal steps of arc length.

    Its box is no larger than ``size_m``.
    """
    t = np.linspace(0.0, 1.0, _DENSE)
    shape = _SHAPES[hand](t, rng)
    shape = np.stack(shape, axis=1) @ _turned(rng.uniform(-np.pi, np.pi)).T
    low, high = shape.min(0), shape.max(0)
    shape = (shape - (low + high) / 2) * (size_m / (high - low).max())
    steps = np.hypot(*np.diff(shape, axis=0).T)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    at = np.linspace(0.0, along[-1], points)
    xy = np.stack([np.interp(at, along, column) for column in shape.T], axis=1)
    light, deep = press_range_m
    pulses, phase = rng.uniform(0.5, 2.5), rng.uniform(0, 2 * np.pi)
    share = 0.5 + 0.45 * np.sin(2 * np.pi * pulses * at / along[-1] + phase)
    return np.column_stack([xy, -(light + (deep - light) * share), np.zeros(points)])


def _turned(angle: float) -> FloatArray:
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def _loops(t: FloatArray, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    turn = 2 * np.pi * rng.uniform(1.5, 3.0) * t
    lean = rng.uniform(-0.5, 0.5)
    y = 0.35 * np.sin(turn)
    return t * rng.uniform(1.0, 1.8) - 0.3 * np.cos(turn) + lean * y, y


def _zigzag(t: FloatArray, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    corners = int(rng.integers(4, 7))
    x = np.linspace(0, 1, corners) + 0.05 * rng.standard_normal(corners)
    y = np.resize([0.0, 1.0], corners) * rng.uniform(0.3, 0.7) + 0.05 * rng.standard_normal(corners)
    at = np.linspace(0, 1, corners)
    return np.interp(t, at, x), np.interp(t, at, y)


def _spiral(t: FloatArray, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    turn = 2 * np.pi * rng.uniform(1.2, 2.2) * t * rng.choice([-1, 1])
    radius = 1 - rng.uniform(0.6, 0.8) * t
    return radius * np.cos(turn), radius * np.sin(turn)


def _wave(t: FloatArray, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    return t, rng.uniform(0.12, 0.3) * np.sin(2 * np.pi * rng.uniform(1.0, 2.5) * t + rng.uniform(0, 2 * np.pi))


def _star(t: FloatArray, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    corner = 2 * np.pi * 2 * np.arange(6) / 5 + rng.uniform(0, 2 * np.pi)
    at = np.linspace(0, 1, 6)
    return np.interp(t, at, np.cos(corner)), np.interp(t, at, np.sin(corner))


def _hook(t: FloatArray, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    turn = rng.uniform(3.0, 5.0) * np.clip((t - 0.55) / 0.45, 0, 1) ** 1.5 * rng.choice([-1, 1])
    return np.cumsum(np.cos(turn)) / len(t), np.cumsum(np.sin(turn)) / len(t)


_SHAPES = {"loops": _loops, "zigzag": _zigzag, "spiral": _spiral, "wave": _wave, "star": _star, "hook": _hook}
