"""A session of a world as a table of the pushes contract: random pushes, a few into each smoothed slab, and scans."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from pentimento.contracts.height_maps import encode_height_png
from pentimento.contracts.pushes import CONTRACT
from pentimento.contracts.schema import arrow_schema
from studies.another_clay.ploughing import PIXELS, SIZE_MM
from studies.another_clay.push import Command, Conditions, pushed
from studies.another_clay.world import Clay, World

Array = NDArray[Any]

_SCANNED = PIXELS // 2
_UNIT_M = 1e-6
_SURFACE_MM, _UNEVEN_MM, _UNEVEN_PIXELS = 40.0, 0.15, 18.0
_BORDER_MM, _LONGEST_MM = 30.0, 40.0
_LOST_PIXELS = 0.002
_SINGLES, _AGAIN, _TIMES = 96, 24, 3


class Push(NamedTuple):
    """One row before it is made."""

    action: int
    command: Command
    again: int
    """Pushes since the clay was smoothed."""
    slab: int
    times_s: tuple[float, float, float]
    """Before, at the start, after."""
    measured: dict[str, float]


def recorded(world: World) -> pa.Table:
    """The world's table."""
    pushes = _plan(np.random.default_rng([world.seed, 0]), world)
    ended_s = pushes[-1].times_s[2]
    stiffened = np.array([1 - math.exp(-push.times_s[1] * 2.5 / ended_s) for push in pushes])
    rows = []
    height, worked = np.zeros((PIXELS, PIXELS)), np.zeros((PIXELS, PIXELS))
    for order, push in enumerate(pushes):
        rng = np.random.default_rng([world.seed, 1, order])
        if push.again == 0:
            height, worked = _smoothed(rng), np.zeros_like(worked)
        rough = gaussian_filter(rng.standard_normal(height.shape), 1.3)
        measured = push.measured
        conditions = Conditions(
            measured["temperature_c"], measured["humidity_pct"], measured["supply_v"],
            float(stiffened[order] - stiffened.mean()),
        )  # fmt: skip
        after = pushed(
            height,
            worked,
            push.command,
            conditions=conditions,
            clay=world.clay,
            effects=world.effects,
            rough=rough / rough.std(),
        )
        rows.append(_row(order, push, _scan(height, world.clay, rng), _scan(after, world.clay, rng)))
        worked += np.clip(height - after, 0, None)
        height = after
    schema = arrow_schema(CONTRACT)
    columns = [schema.field(name) if name in schema.names else pa.field(name, pa.float32()) for name in rows[0]]
    return pa.Table.from_pylist(rows, schema=pa.schema(columns))


def _plan(rng: np.random.Generator, world: World) -> list[Push]:
    """Slabs in random order, each with some pushes, half of them over older ones; repeats on slabs of their own."""
    slabs: list[list[list[tuple[int, Command]]]] = []
    while (action := sum(len(pushes) for unit in slabs for pushes in unit)) < _SINGLES:
        pushes: list[tuple[int, Command]] = []
        for k in range(min(int(rng.integers(2, 7)), _SINGLES - action)):
            over = pushes[rng.integers(len(pushes))][1] if pushes and rng.random() < 0.5 else None
            pushes.append((action + k, _command(rng, world.clay, over)))
        slabs.append([pushes])
    for k in range(_AGAIN):
        alone = [(_SINGLES + k, _command(rng, world.clay, None))]
        slabs += [[alone] * _TIMES] if world.repeats_together else [[alone]] * _TIMES
    planned, clock_s, slab = [], 30.0, 0
    for unit in rng.permutation(len(slabs)):
        for pushes in slabs[unit]:
            clock_s += rng.uniform(40, 80)
            for again, (action, command) in enumerate(pushes):
                start_s = clock_s + rng.uniform(3, 5)
                lasts_s = command.length_mm / 1000 / command.speed_m_s + command.dwell_s + 3
                times_s = clock_s, start_s, start_s + lasts_s + rng.uniform(3, 5)
                planned.append(Push(action, command, again, slab, times_s, _measured(rng)))
                clock_s = times_s[2] + rng.uniform(4, 10)
            slab += 1
    return planned


def _command(rng: np.random.Generator, clay: Clay, over: Command | None) -> Command:
    while True:
        theta = rng.uniform(-math.pi, math.pi)
        length = 0.0 if rng.random() < 0.08 else rng.uniform(0, _LONGEST_MM)
        if over is None:
            x, y = rng.uniform(_BORDER_MM, SIZE_MM - _BORDER_MM, 2)
        else:
            there = rng.random() * over.length_mm
            x = over.x_mm + math.cos(over.theta_rad) * there + rng.normal(0, 5)
            y = over.y_mm + math.sin(over.theta_rad) * there + rng.normal(0, 5)
        ends = x, y, x + math.cos(theta) * length, y + math.sin(theta) * length
        if min(ends) >= _BORDER_MM and max(ends) <= SIZE_MM - _BORDER_MM:
            break
    depth, dwell, speed = rng.uniform(2, clay.deepest_mm), rng.uniform(0, 4), rng.uniform(0.01, 0.06)
    return Command(x, y, theta, length, depth, dwell, speed, math.exp(rng.uniform(math.log(0.01), math.log(0.12))))


def _measured(rng: np.random.Generator) -> dict[str, float]:
    """Other columns of a push; the last two have no effect."""
    return {
        "temperature_c": rng.uniform(17, 27),
        "humidity_pct": rng.uniform(25, 65),
        "supply_v": rng.uniform(23, 25),
        "lamp_lux": rng.uniform(200, 900),
        "batch_ph": rng.normal(7, 0.4),
    }


def _smoothed(rng: np.random.Generator) -> Array:
    uneven = gaussian_filter(rng.standard_normal((PIXELS, PIXELS)), _UNEVEN_PIXELS, mode="reflect")
    return np.asarray(_SURFACE_MM + _UNEVEN_MM * uneven / uneven.std())


def _scan(height: Array, clay: Clay, rng: np.random.Generator) -> Array:
    """Heights [n, n] with noise and holes."""
    seen = height.reshape(_SCANNED, 2, _SCANNED, 2).mean((1, 3))
    seen += clay.noise_mm * rng.standard_normal(seen.shape)
    seen += clay.patches_mm * 3.5 * gaussian_filter(rng.standard_normal(seen.shape), 1.0)
    seen[rng.random(seen.shape) < _LOST_PIXELS] = np.nan
    if rng.random() < 0.5:
        row, column = rng.integers(2, _SCANNED - 4, 2)
        seen[row : row + rng.integers(1, 4), column : column + rng.integers(1, 4)] = np.nan
    return np.asarray(seen)


def _row(order: int, push: Push, before_mm: Array, after_mm: Array) -> dict[str, Any]:
    command = push.command
    place = [command.x_mm / 1e3, command.y_mm / 1e3, command.theta_rad]
    return {
        "session": "lab",
        "order": order,
        "action_id": push.action,
        "tool": "ball_cone",
        "material": "clay",
        "kind": "push",
        "action": [*place, command.length_mm / 1e3, command.depth_mm / 1e3],
        "window_m": [0.0, 0.0, SIZE_MM / 1e3, SIZE_MM / 1e3],
        "before": {"bytes": encode_height_png(before_mm / 1e3, _UNIT_M), "path": None},
        "after": {"bytes": encode_height_png(after_mm / 1e3, _UNIT_M), "path": None},
        "height_per_unit_m": _UNIT_M,
        "surface_height_m": _SURFACE_MM / 1e3,
        "speed_m_s": command.speed_m_s,
        "retract_speed_m_s": command.retract_speed_m_s,
        "dwell_s": command.dwell_s,
        "reset_id": push.slab,
        "pushes_since_reset": push.again,
        "t_before_s": push.times_s[0],
        "t_start_s": push.times_s[1],
        "t_after_s": push.times_s[2],
        "table_plane": [0.0, 0.0, 0.0],
    } | push.measured
