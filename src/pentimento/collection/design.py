"""Design of the strokes from which a tool is learned, such that the causes of the residual are not aliased.

Place, heading, length, bend, press, speed, yaw, paint, dips, pauses and order are drawn jointly at random. In raster
order with a dip for each row, causes would be almost perfectly aliased (docs/diagnosis.md). Some actions are repeated
on other sheets, at the same place, on blank paper and freshly dipped, so that repeats differ by noise and slow drifts
only. A share of the others is laid over paint of their sheet.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.errors import ContractError
from pentimento.contracts.frames import window_around
from pentimento.contracts.plan import PlannedStroke
from pentimento.contracts.ranges import above_zero, at_least
from pentimento.planning.strokes.shapes import Shapes
from pentimento.robots.motion import timed_path
from pentimento.robots.strokes import press_basis, stroke_points
from pentimento.robots.tools import Tool

FloatArray = NDArray[np.float64]

_TRIES = 300
_STROKES_A_SHEET = 27
_RECENT = 6
"""Number of last strokes among which the one to cross is chosen, so that the paint's age is up to minutes."""
_BESIDE_M = 0.002
_DIP_EARLY = 0.12
"""Share of the single strokes with a dip before the load is used up, so that loads of all lengths occur."""
_DIPPED = 1  # random stream that strokes share: the paint of a dip
_ORDERED = 2  # random stream that strokes share: their order


@dataclass(frozen=True)
class CollectionConfig:
    """Size and ranges of a stroke collection."""

    strokes: int
    """Rows, repeats included."""
    repeated: int
    """Number of actions that are executed ``times`` times; the noise floor is estimated from them."""
    times: int
    crossing_share: float
    """Share of the other strokes that are laid over paint."""
    path_points: int
    margin_m: float
    """Paper around each stroke's path that its photographs show."""
    edge_m: float
    """Strokes keep this far from the canvas's edge."""
    pixels_per_m: float
    """Resolution of the photographs."""
    settle_s: tuple[float, float]
    """Min and max pause between a stroke and its photograph; log-uniform in between."""
    palette_srgb: tuple[tuple[float, float, float], ...]
    """Paints for a tool that dips; one is drawn for each dip."""
    yaw_spread_rad: float
    """Maximum angle between a flat tool's broad edge and the direction across the stroke."""
    seed: int

    def __post_init__(self) -> None:
        at_least(self, 1, "strokes", "times")
        at_least(self, 2, "path_points")
        at_least(self, 0, "repeated", "crossing_share", "edge_m", "yaw_spread_rad", "seed")
        above_zero(self, "margin_m", "pixels_per_m")
        if self.repeated * self.times > self.strokes:
            raise ValueError(
                f"repeated is {self.repeated}; with times {self.times}, strokes must be at least "
                f"{self.repeated * self.times} and is {self.strokes}: raise strokes, or lower repeated."
            )
        if self.crossing_share > 1:
            raise ValueError(f"crossing_share is {self.crossing_share}; it is a share of the strokes, at most 1.")
        if not 0 < self.settle_s[0] <= self.settle_s[1]:
            raise ValueError(f"settle_s is {list(self.settle_s)}; give the shortest pause, above 0, and the longest.")
        if not self.palette_srgb or not all(0 <= channel <= 1 for paint in self.palette_srgb for channel in paint):
            raise ValueError("palette_srgb needs at least one paint [red, green, blue] with channels from 0 to 1.")


@dataclass(frozen=True, eq=False)
class Command:
    """One stroke to execute."""

    action_id: int
    """Commands of one value repeat the same path and paint."""
    sheet: int
    stroke: PlannedStroke
    wait_s: float
    """Before it is photographed."""


def design_collection(
    tool: Tool,
    canvas_size_m: tuple[float, float],
    palette_srgb: FloatArray,
    config: CollectionConfig,
    shapes: Shapes | None = None,
) -> list[Command]:
    """``config.strokes`` commands in their order, sheet by sheet; each action is drawn from (seed, action) alone.

    Args:
        shapes: paths are random ones of these, such as a writer's (thesis 5.3.4), at their own number of points. None:
            Bézier strokes of the tool's lengths and bends.

    Raises:
        ContractError: no stroke of the tool fits on the canvas.
    """
    singles = config.strokes - config.repeated * config.times
    sheets = max(math.ceil(config.strokes / _STROKES_A_SHEET), config.times if config.repeated else 1)
    room = _Room(tool, canvas_size_m, config, shapes)
    again = _repeated_actions(range(singles, singles + config.repeated), palette_srgb, room)
    chooser = np.random.default_rng([config.seed, 0, _ORDERED])
    sheets_of = [chooser.permutation(sheets)[: config.times] for _ in again]
    shares = np.array_split(np.arange(singles), sheets)
    commands: list[Command] = []
    load = _Load(tool, palette_srgb, config.seed)
    for sheet, share in enumerate(shares):
        here = [stroke for stroke, of in zip(again, sheets_of, strict=True) if sheet in of]
        slots: list[PlannedStroke | int] = [*here, *map(int, share)]
        order = np.random.default_rng([config.seed, sheet, _ORDERED]).permutation(len(slots))
        drawn: list[FloatArray] = []
        to_come = [stroke.path for stroke in here]
        for slot in (slots[i] for i in order):
            if isinstance(slot, int):
                action, rng = slot, np.random.default_rng([config.seed, slot])
                color, dip = load.for_single(rng)
                target = drawn[-1 - int(rng.integers(min(_RECENT, len(drawn))))] if drawn else None
                if target is not None and rng.random() < config.crossing_share:
                    path = room.clear_path(rng, taken=to_come, about=target)
                else:
                    path = room.clear_path(rng, taken=to_come + drawn, about=None)
                stroke = PlannedStroke(path, color, dip)
            else:
                stroke, action = slot, singles + [s is slot for s in again].index(True)
                rng = np.random.default_rng([config.seed, action, sheet])
                to_come = [path for path in to_come if path is not slot.path]
                load.refilled(slot.color_srgb)
            drawn.append(stroke.path)
            low, high = np.log(config.settle_s)
            commands.append(Command(action, sheet, stroke, float(np.exp(rng.uniform(low, high)))))
    return commands


def design_in_cells(
    tool: Tool, cells_m: FloatArray, palette_srgb: FloatArray, config: CollectionConfig
) -> list[Command]:
    """``config.strokes`` commands in their order, sheet by sheet, each alone in a cell of its sheet.

    Repeats of an action lie in the same cell of different sheets, freshly dipped. In a sheet the order of the cells is
    random, so that wear and the paint that is left do not go with the place.

    Args:
        cells_m: [C, 4] windows of a sheet's cells, all of one size; paths are in their frame, ``config.edge_m`` inside.

    Raises:
        ContractError: no stroke of the tool fits in a cell, or the repeated actions need more cells than there are.
    """
    if config.repeated > len(cells_m):
        raise ContractError(f"{config.repeated} repeated actions need a cell each, and a sheet has {len(cells_m)}.")
    singles = config.strokes - config.repeated * config.times
    sheets = max(math.ceil(config.strokes / len(cells_m)), config.times if config.repeated else 1)
    width, height = cells_m[0, 2:] - cells_m[0, :2]
    room, middle = _Room(tool, (float(width), float(height)), config, None), np.array([[0.0, width / 2, height / 2]])
    chooser = np.random.default_rng([config.seed, 0, _ORDERED])
    repeated_in = chooser.permutation(len(cells_m))[: config.repeated]
    again = {
        (int(sheet), int(cell)): singles + number
        for number, cell in enumerate(repeated_in)
        for sheet in chooser.permutation(sheets)[: config.times]
    }
    places = ((sheet, int(cell)) for sheet in range(sheets) for cell in chooser.permutation(len(cells_m)))
    free = (place for place in places if place not in again)
    action_at = again | {next(free): action for action in range(singles)}
    commands: list[Command] = []
    load = _Load(tool, palette_srgb, config.seed)
    for sheet in range(sheets):
        for cell in chooser.permutation(sorted(cell for where, cell in action_at if where == sheet)):
            action = action_at[sheet, int(cell)]
            rng = np.random.default_rng([config.seed, action])
            # About the middle: anywhere in the cell, long strokes would hardly ever fit.
            path = room.clear_path(rng, taken=(), about=middle) + np.array([0.0, *cells_m[cell, :2], 0.0, 0.0])
            if action < singles:
                color, dip = load.for_single(rng)
            else:
                color, dip = palette_srgb[rng.integers(len(palette_srgb))], tool.dips
                load.refilled(color)
            commands.append(Command(action, sheet, PlannedStroke(path, color, dip), 0.0))
    return commands


class _Load:
    """The tool's paint, and the number of strokes since it was dipped."""

    def __init__(self, tool: Tool, palette_srgb: FloatArray, seed: int) -> None:
        self._tool, self._palette, self._seed = tool, palette_srgb, seed
        self._strokes, self._dips = tool.strokes_per_dip, 0
        self._color: FloatArray = palette_srgb[0]

    def for_single(self, rng: np.random.Generator) -> tuple[FloatArray, bool]:
        """The colour of the next single stroke, and whether the tool is dipped for it."""
        if not self._tool.dips:
            return self._color, False
        dip = bool(rng.random() < _DIP_EARLY) or self._strokes >= self._tool.strokes_per_dip
        if dip:
            chosen = np.random.default_rng([self._seed, self._dips, _DIPPED]).integers(len(self._palette))
            self.refilled(self._palette[chosen])
        else:
            self._strokes += 1
        return self._color, dip

    def refilled(self, color_srgb: FloatArray) -> None:
        """After a dip and the stroke for which it was."""
        self._strokes, self._color = 1, color_srgb
        self._dips += 1


def _repeated_actions(actions: range, palette_srgb: FloatArray, room: _Room) -> list[PlannedStroke]:
    """Strokes that do not cross each other, so that each is on blank paper wherever it comes in a sheet's order."""
    strokes: list[PlannedStroke] = []
    for action in actions:
        rng = np.random.default_rng([room.config.seed, action])
        path = room.clear_path(rng, taken=[stroke.path for stroke in strokes], about=None)
        color = palette_srgb[rng.integers(len(palette_srgb))]
        strokes.append(PlannedStroke(path, color, dip=room.tool.dips))
    return strokes


@dataclass(frozen=True, eq=False)
class _Room:
    """Where random paths are laid, and of what shape they are."""

    tool: Tool
    canvas_size_m: tuple[float, float]
    config: CollectionConfig
    shapes: Shapes | None

    def clear_path(
        self, rng: np.random.Generator, *, taken: Sequence[FloatArray], about: FloatArray | None
    ) -> FloatArray:
        """A random path inside the canvas that meets as few boxes of ``taken`` as possible.

        Its middle lies on the path ``about``, or anywhere.
        """
        low, high = np.full(2, self.config.edge_m), np.array(self.canvas_size_m) - self.config.edge_m
        boxes = np.array([window_around(path, self.tool.nominal_width_m / 2) for path in taken]).reshape(-1, 4)
        best, min_met = None, np.inf
        for _ in range(_TRIES if np.all(low < high) else 0):
            if about is None:
                middle = rng.uniform(low, high)
            else:
                middle = about[rng.integers(len(about)), 1:3] + _BESIDE_M * rng.standard_normal(2)
            path = self._random_path(rng, middle)
            if np.any(path[:, 1:3] < low) or np.any(path[:, 1:3] > high):
                continue
            box = window_around(path, self.tool.nominal_width_m / 2)
            met = int(np.all((box[:2] < boxes[:, 2:]) & (boxes[:, :2] < box[2:]), axis=1).sum())
            if met < min_met:
                best, min_met = path, met
            if min_met == 0:
                break
        if best is None:
            longest = (
                "shorten stroke_length in its tool file" if self.shapes is None else "take a hand of smaller strokes"
            )
            raise ContractError(
                f"The {self.tool.name} finds no room for a stroke on {self.canvas_size_m} m of canvas: "
                f"{longest} or lower collect_strokes.edge_m."
            )
        return best

    def _random_path(self, rng: np.random.Generator, middle_m: FloatArray) -> FloatArray:
        tool, theta = self.tool, rng.uniform(-np.pi, np.pi)
        length = rng.uniform(*tool.stroke_length_m)
        # Across the stroke, as a painter holds a flat brush; brushes look the same turned by half a turn.
        yaw = theta + np.pi / 2 + rng.uniform(-1, 1) * self.config.yaw_spread_rad if tool.kind == "flat" else 0.0
        yaw = (yaw + np.pi / 2) % np.pi - np.pi / 2
        if self.shapes is None:
            points = stroke_points(
                middle_m,
                theta,
                length,
                bend_m=length * rng.uniform(*tool.bend_range),
                press_m=rng.uniform(*tool.press_range_m, size=3),
                yaw_rad=yaw,
                points=self.config.path_points,
            )
        else:
            own = self.shapes.paths(self.shapes.sample(1, rng))[0][0].astype(np.float64)
            cos, sin = np.cos(theta), np.sin(theta)
            z = -press_basis(len(own)) @ rng.uniform(*tool.press_range_m, size=3)
            xy = middle_m + own @ np.array([[cos, sin], [-sin, cos]])
            points = np.column_stack([xy, z, np.full(len(own), yaw)])
        return timed_path(points, float(np.exp(rng.uniform(*np.log(tool.speed_range_m_s)))))
