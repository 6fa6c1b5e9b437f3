"""Commands, and where the arm really goes: a polyline, followed point by point."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from studies.another_simulator.world import CANVAS_M, MIDDLE_M, Effects, ToolKind

Array = NDArray[Any]

_POINTS, _FINE = 24, 160


@dataclass(frozen=True)
class Command:
    """What is asked for."""

    t_s: Array
    """[N] from the start."""
    xy_m: Array
    """[N, 2] on the canvas."""
    z_m: Array
    """[N] below 0 where the tool is pressed."""
    yaw_rad: float
    speed_m_s: float
    length_m: float


def drawn_command(rng: np.random.Generator, tool: ToolKind) -> Command:
    """An S-shaped stroke at any place, heading, speed and press."""
    s = np.linspace(0, 1, _POINTS)
    reach_m, heading = rng.uniform(0.015, 0.05), rng.uniform(-np.pi, np.pi)
    x = reach_m * s
    bow = rng.uniform(-0.3, 0.3) * np.sin(np.pi * s) + rng.uniform(-0.08, 0.08) * np.sin(2 * np.pi * s)
    cos, sin = np.cos(heading), np.sin(heading)
    local = np.stack([cos * x - sin * reach_m * bow, sin * x + cos * reach_m * bow], axis=1)
    press_m = rng.uniform(0.0006, 0.003) * np.minimum(1, np.minimum(s, 1 - s) * rng.uniform(5, 9))
    speed = float(np.exp(rng.uniform(np.log(0.015), np.log(0.12))))
    along = arc_m(local)
    start = rng.uniform([0.05, 0.05], [CANVAS_M[0] - 0.05, CANVAS_M[1] - 0.05])
    yaw = float(rng.uniform(-0.5, 0.5)) if tool == "chisel" else 0.0
    return Command(along / speed, local + start, -press_m, yaw, speed, float(along[-1]))


def arc_m(xy_m: Array) -> Array:
    """Length up to each point, [N]."""
    return np.concatenate([[0.0], np.linalg.norm(np.diff(xy_m, axis=0), axis=1).cumsum()])


class Arm:
    """An arm with play in its axes, which remembers where they rest."""

    def __init__(self, effects: Effects, rng: np.random.Generator) -> None:
        self._effects, self._rng = effects, rng
        self._play_offset_m, self._last_m = np.zeros(2), np.array(MIDDLE_M)

    def contact(self, command: Command) -> tuple[Array, Array]:
        """Where the tool touches, [M, 2], and how deep it is pressed there, [M], metres."""
        effects, along = self._effects, arc_m(command.xy_m)
        place = np.linspace(0, along[-1], _FINE)
        xy = np.stack([np.interp(place, along, command.xy_m[:, k]) for k in (0, 1)], axis=1)
        press_m = np.interp(place, along, -command.z_m)
        xy = xy + self._rng.normal(0, 0.00018, 2)
        xy = xy[0] + (xy - xy[0]) * (1 + effects.path_scale * np.array([1.0, 0.8]))
        xy = xy + effects.path_offset * np.array([1.0, -0.6])
        xy = self._with_play(xy)
        if effects.latency:
            t = place / command.speed_m_s
            late = np.maximum(t - effects.latency, 0)
            xy = np.stack([np.interp(late, t, xy[:, k]) for k in (0, 1)], axis=1)
        if effects.bristle_lag:
            xy = _dragged(xy, effects.bristle_lag)
        away = (xy - np.array(MIDDLE_M)) / 0.1
        press_m = press_m + effects.canvas_tilt * away.sum(1)
        xy = xy + 0.1 * effects.lens_distortion * away * (away**2).sum(1, keepdims=True)
        return xy, np.maximum(press_m, 0)

    def _with_play(self, xy: Array) -> Array:
        """The load of each axis moves only where its motor has crossed the play."""
        half, moved = self._effects.backlash / 2, xy.copy()
        for k, point in enumerate(xy):
            self._play_offset_m = np.clip(self._play_offset_m + point - self._last_m, -half, half)
            self._last_m = point
            moved[k] = point - self._play_offset_m
        return moved


def _dragged(xy: Array, leash_m: float) -> Array:
    """What follows on an inextensible leash: a tractrix."""
    follower, path = xy[0].copy(), []
    for point in xy:
        taut = point - follower
        distance = float(np.hypot(*taut))
        if distance > leash_m:
            follower = follower + taut * (1 - leash_m / distance)
        path.append(follower)
    return np.array(path)
