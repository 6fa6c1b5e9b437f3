"""Strokes of the comparison, made by the studio's robot: dataset A by the designed collection, B in other hands."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pentimento.collection.design import CollectionConfig, design_collection
from pentimento.contracts.frames import canvas_to_pixel, window_around
from pentimento.robots.motion import timed_path
from pentimento.robots.tools import Tool, load_tool
from pentimento.studio.strokes.world import load_world
from studies.blind.strokes.collect import as_table, record_world
from studies.blind.strokes.design import Command, View
from studies.stroke_models.hands import HANDS, hand_stroke

FloatArray = NDArray[np.float64]

TOOLS = ("marker", "round_brush")
PAINT_SRGB = (0.08, 0.08, 0.10)
POINTS, PIXELS_PER_M, MARGIN_M = 32, 1000.0, 0.012
_FIRST_OF_B = 100_000
_COLUMNS, _ROWS, _CELL_M = 4, 3, 0.064
_SIZE_M = (0.015, 0.042)


@dataclass(frozen=True)
class Datasets:
    """Tables in the strokes contract."""

    a: pa.Table
    b: pa.Table


def record_datasets(tool_name: str, seed: int, of_a: int, of_b: int) -> Datasets:
    """``of_a`` designed strokes on blank paper, then ``of_b`` in other hands, in one session of one tool."""
    tool, world = load_tool(tool_name), load_world(tool_name)
    palette = np.array([tool.color_srgb or PAINT_SRGB])
    view = View(0, 0, PIXELS_PER_M, MARGIN_M)
    canvas = world.paper.size_m
    commands = [
        *_designed(tool, canvas, palette, seed, of_a),
        *_in_hands(tool, canvas, palette, seed=seed, strokes=of_b, before=of_a),
    ]
    table = as_table(record_world(world, seed, tool, palette_srgb=palette, commands=commands, view=view), {})
    is_b = np.array(table["action_id"].to_pylist()) >= _FIRST_OF_B
    return Datasets(table.filter(pa.array(~is_b)), table.filter(pa.array(is_b)))


def _designed(tool: Tool, canvas_m: tuple[float, float], palette: FloatArray, seed: int, strokes: int) -> list[Command]:
    config = CollectionConfig(
        strokes, 0, 1, 0.0, POINTS, MARGIN_M, 0.008, PIXELS_PER_M, (1.0, 10.0), tuple(map(tuple, palette)), 0.0, seed
    )
    return [
        _command(
            c.action_id, c.sheet, c.stroke.path, palette=palette, dip=c.stroke.dip, wait_s=c.wait_s, canvas_m=canvas_m
        )
        for c in design_collection(tool, canvas_m, palette, config)
    ]


def _in_hands(
    tool: Tool, canvas_m: tuple[float, float], palette: FloatArray, *, seed: int, strokes: int, before: int
) -> list[Command]:
    """Each in a cell of its own, on sheets after those of dataset A; hand by turns."""
    commands = []
    for number in range(strokes):
        rng = np.random.default_rng([seed, number, _FIRST_OF_B])
        sheet, cell = divmod(number, _COLUMNS * _ROWS)
        middle = np.array(canvas_m) / 2 + _CELL_M * (
            np.array([cell % _COLUMNS, cell // _COLUMNS]) - np.array([_COLUMNS - 1, _ROWS - 1]) / 2
        )
        shape = hand_stroke(HANDS[number % len(HANDS)], rng, rng.uniform(*_SIZE_M), tool.press_range_m, POINTS)
        shape[:, :2] += middle + rng.uniform(-0.004, 0.004, 2)
        path = timed_path(shape, float(np.exp(rng.uniform(*np.log(tool.speed_range_m_s)))))
        commands.append(
            _command(
                _FIRST_OF_B + number,
                before + sheet,
                path,
                palette=palette,
                dip=False,
                wait_s=rng.uniform(1, 10),
                canvas_m=canvas_m,
            )
        )
    return commands


def _command(
    action: int, sheet: int, path: FloatArray, *, palette: FloatArray, dip: bool, wait_s: float,
    canvas_m: tuple[float, float],
) -> Command:  # fmt: skip
    rows, columns = round(canvas_m[1] * PIXELS_PER_M), round(canvas_m[0] * PIXELS_PER_M)
    window = window_around(path, MARGIN_M)
    whole = np.array([0.0, 0.0, *canvas_m])
    corners = canvas_to_pixel(window.reshape(2, 2), whole, PIXELS_PER_M) + 0.5
    left, right = max(int(corners[0, 0]), 0), min(int(np.ceil(corners[1, 0])), columns)
    top, bottom = max(int(corners[1, 1]), 0), min(int(np.ceil(corners[0, 1])), rows)
    red, green, blue = (float(c) for c in palette[0])
    return Command(action, sheet, path, (left, top, right - left, bottom - top), (red, green, blue), dip, float(wait_s))
