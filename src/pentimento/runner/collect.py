"""Self-generated strokes: the robot marks its own paper at random and photographs every mark (thesis 4.3.2)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.covariates import fresh_memory, new_sheet
from pentimento.contracts.errors import ContractError
from pentimento.contracts.frames import image_shape, snap_window, window_around
from pentimento.contracts.markers import markers_around
from pentimento.contracts.plan import PlannedStroke
from pentimento.contracts.ranges import above_zero, at_least
from pentimento.robots.driver import Robot
from pentimento.robots.motion import timed_path
from pentimento.robots.strokes import stroke_points
from pentimento.robots.tools import Tool
from pentimento.runner.act import Session, execute_stroke
from pentimento.runner.observe import calibrate_camera, rectify
from pentimento.runner.record import record_stroke

FloatArray = NDArray[np.float64]

_TRIES = 200


@dataclass(frozen=True)
class CollectionConfig:
    """What the robot draws to learn a tool."""

    strokes: int
    path_points: int
    margin_m: float
    """Paper around each stroke's path that its photographs show."""
    edge_m: float
    """Strokes keep this far from the canvas's edge."""
    pixels_per_m: float
    """Resolution of the photographs."""
    settle_s: float
    """Pause between a stroke and its photograph."""
    palette_srgb: tuple[tuple[float, float, float], ...]
    """Paints for a tool that dips; changed at random, every ``Tool.strokes_per_dip`` strokes."""
    yaw_spread_rad: float
    """A flat tool's broad edge is held across the stroke, give or take this."""
    seed: int

    def __post_init__(self) -> None:
        at_least(self, 1, "strokes")
        at_least(self, 2, "path_points")
        at_least(self, 0, "edge_m", "settle_s", "yaw_spread_rad", "seed")
        above_zero(self, "margin_m", "pixels_per_m")
        if not self.palette_srgb or not all(0 <= channel <= 1 for paint in self.palette_srgb for channel in paint):
            raise ValueError("palette_srgb needs at least one paint [red, green, blue] with channels from 0 to 1.")


def collect_strokes(
    robot: Robot, tool: Tool, config: CollectionConfig, log: Callable[[str, float, int], None]
) -> list[dict[str, Any]]:
    """Draw ``config.strokes`` random strokes on fresh paper; rows of the ``strokes`` contract in their order.

    Place, heading, shape, press and speed are drawn together at random, stroke i from (seed, i) alone. A sheet that has
    no free place left is replaced. ``log("ink_length_m", total, i)`` is called after every stroke.
    """
    robot.change_tool(tool)
    palette = np.array(config.palette_srgb if tool.color_srgb is None else [tool.color_srgb])
    robot.load_palette(palette)
    calibration = calibrate_camera(robot.photo(), markers_around(robot.canvas_size_m))
    session = Session(f"{tool.name}-{config.seed}", robot.clock_s)
    memory = fresh_memory(robot.canvas_size_m, tool.nominal_width_m)
    canvas = np.array([0.0, 0.0, *robot.canvas_size_m])
    shape = image_shape(canvas, config.pixels_per_m)
    taken: list[FloatArray] = []
    rows: list[dict[str, Any]] = []
    for order in range(config.strokes):
        rng = np.random.default_rng([config.seed, order])
        stroke = _free_stroke(rng, robot.canvas_size_m, tool, config, _paint(order, tool, palette, config.seed), taken)
        if stroke is None:
            robot.new_sheet()
            memory, taken = new_sheet(memory), []
            stroke = _free_stroke(
                rng, robot.canvas_size_m, tool, config, _paint(order, tool, palette, config.seed), taken
            )
        if stroke is None:
            raise ContractError(
                f"The {tool.name} finds no room for a stroke on {robot.canvas_size_m} m of canvas: "
                "shorten stroke_length in its tool file or lower collect_strokes.edge_m."
            )
        taken.append(window_around(stroke.path, tool.nominal_width_m))
        window = snap_window(window_around(stroke.path, config.margin_m), canvas, shape)
        before = robot.photo()
        memory, executed = execute_stroke(robot, tool, stroke, palette, memory, session)
        robot.wait(config.settle_s)
        after = robot.photo()
        shown_before, shown_after = (
            rectify(photo, calibration, window, config.pixels_per_m) for photo in (before, after)
        )
        rows.append(
            record_stroke(
                session, order, order, tool, executed, window, shown_before, shown_after, before, after, calibration
            )
        )
        log("ink_length_m", memory.tool_age_m, order)
    return rows


def _paint(order: int, tool: Tool, palette: FloatArray, seed: int) -> FloatArray:
    """The colour of stroke ``order``: one for each dip."""
    dip = order // max(tool.strokes_per_dip, 1)
    chosen: FloatArray = palette[np.random.default_rng([seed, dip, 1]).integers(len(palette))]
    return chosen


def _free_stroke(
    rng: np.random.Generator,
    canvas_size_m: tuple[float, float],
    tool: Tool,
    config: CollectionConfig,
    color_srgb: FloatArray,
    taken: list[FloatArray],
) -> PlannedStroke | None:
    """A random stroke inside the canvas that keeps clear of the boxes ``taken``; None if none was found."""
    low, high = np.full(2, config.edge_m), np.array(canvas_size_m) - config.edge_m
    if np.any(low >= high):
        return None
    for _ in range(_TRIES):
        path = _random_path(rng, low, high, tool, config)
        box = window_around(path, tool.nominal_width_m)
        inside = np.all(path[:, 1:3] >= low) and np.all(path[:, 1:3] <= high)
        if inside and not any(_overlap(box, other) for other in taken):
            return PlannedStroke(path, color_srgb, dip=False)
    return None


def _random_path(
    rng: np.random.Generator, low: FloatArray, high: FloatArray, tool: Tool, config: CollectionConfig
) -> FloatArray:
    theta = rng.uniform(-np.pi, np.pi)
    length = rng.uniform(*tool.stroke_length_m)
    # Across the stroke, as a painter holds a flat brush; brushes look the same turned by half a turn.
    yaw = theta + np.pi / 2 + rng.uniform(-1, 1) * config.yaw_spread_rad if tool.kind == "flat" else 0.0
    points = stroke_points(
        rng.uniform(low, high),
        theta,
        length,
        length * rng.uniform(*tool.bend_range),
        rng.uniform(*tool.press_range_m, size=3),
        (yaw + np.pi / 2) % np.pi - np.pi / 2,
        config.path_points,
    )
    return timed_path(points, rng.uniform(*tool.speed_range_m_s))


def _overlap(a: FloatArray, b: FloatArray) -> bool:
    return bool(np.all(a[:2] < b[2:]) and np.all(b[:2] < a[2:]))
