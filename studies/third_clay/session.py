"""A session of the third clay as a table of the pushes contract. Millimetres, seconds."""

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
from studies.third_clay.flow import PIXEL_MM, PIXELS, SIZE_MM, press

Array = NDArray[Any]

_UNIT_M = 1e-6
_SURFACE_MM = 40.0
_BORDER_MM, _LONGEST_MM, _DEEPEST_MM = 40.0, 35.0, 7.0
_STATION_MM, _MIN_STATIONS = 1.5, 8
_FELT_MM = 3.0
"""Radius about the start in which the surface is felt."""
_JITTER_MM = 0.15
"""Standard deviation of the tool's place about its command."""
_TORN_MM, _NOISE_MM = 0.04, 0.07
"""Roughness that a push leaves, and noise of a scan."""
_SLABS, _PUSHES_A_SLAB = 24, 4
_REPEATED, _TIMES = 24, 3
_BETWEEN_S = 20.0


class Command(NamedTuple):
    """A push, relative to the surface at its start."""

    x_mm: float
    y_mm: float
    theta_rad: float
    length_mm: float
    depth_mm: float


def recorded(seed: int, *, height_offset_mm: float = 0.0, work_hardening: float = 0.0) -> pa.Table:
    """Pushes into smoothed slabs, a few into each, and repeats on slabs of their own.

    Args:
        seed: of commands, slabs and noise.
        height_offset_mm: by which the tool goes lower than commanded.
        work_hardening: how much slower fully worked material flows, as a logarithm.
    """
    rng = np.random.default_rng([seed, 33])
    commands = [_command(rng) for _ in range(_SLABS * _PUSHES_A_SLAB + _REPEATED)]
    single = _SLABS * _PUSHES_A_SLAB
    slabs = [list(range(k, k + _PUSHES_A_SLAB)) for k in range(0, single, _PUSHES_A_SLAB)]
    slabs += [[action] for action in range(single, len(commands)) for _ in range(_TIMES)]
    rows: list[dict[str, Any]] = []
    for slab, number in enumerate(rng.permutation(len(slabs))):
        uneven = gaussian_filter(rng.standard_normal((PIXELS, PIXELS)), 20.0)
        height = _SURFACE_MM + 0.1 * uneven / uneven.std()
        worked = np.zeros_like(height)
        for again, action in enumerate(slabs[number]):
            after = pushed(height, worked, commands[action], height_offset_mm, work_hardening, rng)
            place = {"order": len(rows), "action_id": action, "reset_id": slab, "pushes_since_reset": again}
            rows.append(place | _row(commands[action], _scan(height, rng), _scan(after, rng), len(rows)))
            worked += np.clip(height - after, 0, None)
            height = after
    return pa.Table.from_pylist(rows, schema=pa.schema([arrow_schema(CONTRACT).field(name) for name in rows[0]]))


def pushed(
    before: Array,
    worked: Array,
    command: Command,
    height_offset_mm: float,
    work_hardening: float,
    rng: np.random.Generator,
) -> Array:
    """Heights [N, N] after a push; ``worked`` is the earlier lowering of each place."""
    x_mm, y_mm, theta, length, depth = command
    places = (np.arange(PIXELS) + 0.5) * PIXEL_MM
    near = np.hypot(places - x_mm, (SIZE_MM - places - y_mm)[:, None]) <= _FELT_MM
    surface = float(np.median(before[near])) - height_offset_mm
    part = np.linspace(0, 1, max(math.ceil(length / _STATION_MM), _MIN_STATIONS) + 1)
    x_mm, y_mm = np.array([x_mm, y_mm]) + _JITTER_MM * rng.standard_normal(2)
    way = np.stack(
        [x_mm + math.cos(theta) * length * part, y_mm + math.sin(theta) * length * part, surface - depth * part], axis=1
    )
    height = before.copy()
    press(height, worked, way, theta, work_hardening)
    torn = gaussian_filter(rng.standard_normal(before.shape), 1.5)
    return np.asarray(height + _TORN_MM * torn / torn.std() * (np.abs(height - before) > _TORN_MM))


def _command(rng: np.random.Generator) -> Command:
    """A push through the inner part of the slab, so that pushes of one slab meet."""
    while True:
        x, y = rng.uniform(_BORDER_MM, SIZE_MM - _BORDER_MM, 2)
        theta, length = rng.uniform(-math.pi, math.pi), rng.uniform(0, _LONGEST_MM)
        end = x + length * math.cos(theta), y + length * math.sin(theta)
        if min(end) >= _BORDER_MM and max(end) <= SIZE_MM - _BORDER_MM:
            return Command(float(x), float(y), theta, length, rng.uniform(2, _DEEPEST_MM))


def _scan(height: Array, rng: np.random.Generator) -> bytes:
    seen = height.reshape(PIXELS // 2, 2, PIXELS // 2, 2).mean((1, 3))
    return encode_height_png((seen + _NOISE_MM * rng.standard_normal(seen.shape)) / 1e3, _UNIT_M)


def _row(command: Command, before: bytes, after: bytes, order: int) -> dict[str, Any]:
    x, y, theta, length, depth = command
    return {
        "session": "third",
        "tool": "blunt",
        "material": "clay",
        "kind": "push",
        "action": [x / 1e3, y / 1e3, theta, length / 1e3, depth / 1e3],
        "window_m": [0.0, 0.0, SIZE_MM / 1e3, SIZE_MM / 1e3],
        "before": {"bytes": before, "path": None},
        "after": {"bytes": after, "path": None},
        "height_per_unit_m": _UNIT_M,
        "surface_height_m": _SURFACE_MM / 1e3,
        "t_before_s": _BETWEEN_S * order,
        "t_start_s": _BETWEEN_S * order + 5.0,
        "t_after_s": _BETWEEN_S * order + 15.0,
    }
