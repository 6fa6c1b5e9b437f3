"""A session of a world as a table of the strokes contract: random strokes, paint, paper, photographs, covariates."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pentimento.contracts.images import encode_png
from pentimento.contracts.schema import arrow_schema
from pentimento.contracts.strokes import CONTRACT
from studies.another_simulator.arm import Arm, Command, drawn_command
from studies.another_simulator.marks import Tool, drawn_tool, mark, widths_m
from studies.another_simulator.world import Effects, World

Array = NDArray[Any]

_WINDOW_M = 0.072
_PAPER, _OLD_PAINT = (0.94, 0.93, 0.90), (0.55, 0.60, 0.80)
_CROSSES = 0.4
_NOISE, _FLICKER, _GRAIN = 0.008, 0.006, 0.06
_WIDTH_SCATTER, _PAINT_SCATTER = 0.04, 0.03
_MEAN_HUMIDITY, _HUMIDITY_SD = 0.45, 0.08
_AGAIN, _TIMES = 24, 3


def recorded(world: World) -> pa.Table:
    """The world's table: order, place, heading, speed, press and dips are independent of one another."""
    rng = np.random.default_rng([world.seed, 0])
    tool, opacity = drawn_tool(rng, world.tool), rng.uniform(0.75, 0.95)
    arm, effects = Arm(world.effects, rng), world.effects
    singles = np.arange(world.rows - _AGAIN * _TIMES if world.repeats else world.rows)
    again = np.repeat(np.arange(len(singles), len(singles) + _AGAIN), _TIMES) if world.repeats else singles[:0]
    actions = rng.permutation(np.concatenate([singles, again]))
    rows: list[dict[str, Any]] = []
    clock_s, drawn_m, since_dip_m, strokes, temperature_c = 0.0, 0.0, 0.0, 0, 21.0
    for order, action in enumerate(actions):
        session = order * world.sessions // len(actions)
        if rows and rows[-1]["session"] != f"session_{session}":
            clock_s, strokes, since_dip_m = 0.0, 0, 0.0
        if strokes >= rng.integers(1, 9):
            strokes, since_dip_m = 0, 0.0
        humidity = _MEAN_HUMIDITY + _HUMIDITY_SD * rng.standard_normal()
        temperature_c += 0.1 * rng.standard_normal()
        command = drawn_command(np.random.default_rng([world.seed, 1, int(action)]), world.tool)
        xy_m, press_m = arm.contact(command)
        damp = float(np.tanh((humidity - _MEAN_HUMIDITY) / _HUMIDITY_SD))
        width_m = widths_m(tool, effects, command, xy_m=xy_m, press_m=press_m, worn=order / len(actions), damp=damp)
        width_m = width_m * (1 + rng.normal(0, _WIDTH_SCATTER))
        window_m = _window_about(command, world.pixels_per_m, rng)
        cover = mark(
            tool, xy_m, press_m, width_m=width_m, yaw_rad=command.yaw_rad, window_m=window_m,
            pixels_per_m=world.pixels_per_m,
        )  # fmt: skip
        paint = (
            opacity * (1 + rng.normal(0, _PAINT_SCATTER)) * _paint(effects, command, since_dip_m, order / len(actions))
        )
        paint *= world.mixes[session % len(world.mixes)]
        below = _paper(world, tool, window_m, cover.shape, rng)
        grain = 1 - _GRAIN * cv2.GaussianBlur(rng.standard_normal(cover.shape).astype(np.float32), (0, 0), 1.2)
        covered = np.clip(cover * paint * grain, 0, 1)[..., None]
        after = _over(world, below, covered)
        times_s = command.t_s if world.timed else np.full_like(command.t_s, np.nan)
        rows.append(
            {
                "session": f"session_{session}",
                "order": order,
                "action_id": int(action),
                "tool": "unknown",
                "path": np.column_stack(
                    [times_s, command.xy_m, command.z_m, np.full(len(times_s), command.yaw_rad)]
                ).tolist(),
                "window_m": window_m.tolist(),
                "before": _photograph(below, rng),
                "after": _photograph(after, rng),
                "color_srgb": list(world.color_srgb),
                "t_before_s": clock_s,
                "t_start_s": clock_s + 1.0,
                "t_after_s": clock_s + float(command.t_s[-1]) + 2.0,
                "since_reload": strokes,
                "ink_since_reload_m": since_dip_m,
                "tool_age_m": drawn_m,
                "humidity": humidity,
                "temperature_c": temperature_c,
                "decoy": float(rng.standard_normal()),
                "drifting_decoy": order + rng.normal(0, 20),
            }
        )
        since_dip_m, drawn_m, strokes = since_dip_m + command.length_m, drawn_m + command.length_m, strokes + 1
        clock_s += float(command.t_s[-1]) + 3.0 + rng.uniform(0, 20)
    schema = arrow_schema(CONTRACT)
    columns = [schema.field(name) if name in schema.names else pa.field(name, pa.float64()) for name in rows[0]]
    return pa.Table.from_pylist(rows, schema=pa.schema(columns))


def _over(world: World, below: Array, covered: Array) -> Array:
    """Linear light [H, W, 3] of the paint over what is below; ``covered`` [H, W, 1]."""
    if world.mixed_in == "light":
        return np.asarray((1 - covered) * below + covered * _linear(world.color_srgb))
    return _linear((1 - covered) * _srgb(below) + covered * np.array(world.color_srgb))


def _paint(effects: Effects, command: Command, since_dip_m: float, passed: float) -> float:
    """Share of the paint that a stroke leaves; ``passed`` of the session."""
    left = 1 / (1 + (effects.ink_depletion * since_dip_m) ** 1.5)
    left /= 1 + effects.speed_density * command.speed_m_s / 0.045
    return float(left * (1 - effects.drying_shift * (1 - np.exp(-2 * passed)) / (1 - np.exp(-2))))


def _window_about(command: Command, pixels_per_m: float, rng: np.random.Generator) -> Array:
    """A square of whole pixels about a stroke's middle."""
    middle = (command.xy_m.min(0) + command.xy_m.max(0)) / 2 + rng.uniform(-0.001, 0.001, 2)
    half_m = round(_WINDOW_M * pixels_per_m) / pixels_per_m / 2
    return np.concatenate([middle - half_m, middle + half_m])


def _paper(world: World, tool: Tool, window_m: Array, shape: tuple[int, ...], rng: np.random.Generator) -> Array:
    """Linear light [H, W, 3] of what lies below a stroke."""
    blank = np.broadcast_to(_linear(_PAPER), (*shape, 3))
    if not world.painted_over or rng.random() > _CROSSES:
        return blank
    old = drawn_command(rng, world.tool)
    there = old.xy_m - old.xy_m.mean(0) + (window_m[:2] + window_m[2:]) / 2
    xy_m, press_m = Arm(Effects(), rng).contact(Command(old.t_s, there, old.z_m, 0.0, old.speed_m_s, old.length_m))
    width_m = widths_m(tool, Effects(), old, xy_m=xy_m, press_m=press_m, worn=0.0, damp=0.0)
    cover = (
        0.8
        * mark(tool, xy_m, press_m, width_m=width_m, yaw_rad=0.0, window_m=window_m, pixels_per_m=world.pixels_per_m)[
            ..., None
        ]
    )
    return np.asarray((1 - cover) * blank + cover * _linear(_OLD_PAINT))


def _photograph(linear: Array, rng: np.random.Generator) -> dict[str, Any]:
    """An 8-bit PNG under a light that flickers."""
    lit = np.clip(linear * (1 + rng.normal(0, _FLICKER)), 0, 1)
    noisy = _srgb(lit) + rng.normal(0, _NOISE, lit.shape)
    return {"bytes": encode_png(np.clip(np.rint(255 * noisy), 0, 255).astype(np.uint8)), "path": None}


def _linear(srgb: Array | tuple[float, float, float]) -> Array:
    s = np.asarray(srgb)
    return np.where(s <= 0.04045, s / 12.92, ((s + 0.055) / 1.055) ** 2.4)


def _srgb(linear: Array) -> Array:
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
