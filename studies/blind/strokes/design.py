"""The designs of strokes of a simulated world: 96 single actions and 24 repeated three times, 168 strokes.

`randomised` draws place, heading, length, bend, press, speed, yaw, paint, dips and waits independently; some of the
single strokes cross paint that is still wet. A repeated action always follows a dip and lies on blank paper, so that
its repeats differ only by noise and by the session's slow drifts.

`raster` aliases causes with each other: rows of strokes with one heading from the lower left to the upper right, a dip
at the start of each row. Its 24 repeated actions have the same places on three sheets.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.frames import window_around
from pentimento.robots.motion import timed_path
from pentimento.robots.strokes import stroke_points
from pentimento.robots.tools import Tool

SHEETS, SINGLES, REPEATED, TIMES = 6, 96, 24, 3
CROSSING = 0.4  # share of the single strokes that are placed over paint of their sheet
RECENT = 8  # strokes: how far back that paint may be
DIP_SHARE = 0.12  # share of the single strokes with an extra dip
LONG_WAIT = 0.4  # share of the strokes that are photographed late
WAITS_S = (1.0, 200.0)  # log-uniform
EDGE_M = 0.008  # blank border of the canvas
TRIES = 400  # paths drawn to find one without overlap
RASTER_ROWS, RASTER_COLUMNS = 7, 8
POINTS = 24

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class View:
    """A photographed window: `long_px` × `short_px`, its longer side along the stroke's longer extent."""

    long_px: int
    short_px: int
    pixels_per_m: float
    margin_m: float
    """Paper between the path and the window's border."""


@dataclass(frozen=True, eq=False)
class Command:
    """One stroke to execute. `path` [24, 5] in the canvas frame, `window_px` (column, row, width, height) of the
    canvas's image, `wait_s` before it is photographed."""

    action_id: int
    sheet: int
    path: FloatArray
    window_px: tuple[int, int, int, int]
    color_srgb: tuple[float, float, float]
    dip: bool
    wait_s: float


def view_of(tool: Tool, fine: bool) -> View:
    """Windows of 64 × 48 px, or of 128 × 96 px of the same size in metres (`fine`)."""
    scale = 2 if fine else 1
    coarse_px_m, margin_m = (1500.0, 0.006) if tool.kind == "marker" else (1000.0, 0.011)
    return View(64 * scale, 48 * scale, coarse_px_m * scale, margin_m)


def randomised(
    tool: Tool, canvas_size_m: tuple[float, float], palette_srgb: FloatArray, view: View, seed: int
) -> list[Command]:
    """168 commands in their order."""
    rng = np.random.default_rng([seed, 21])
    canvas = np.array(canvas_size_m)
    # Half of the repeated actions on the even sheets, half on the odd ones: one repeat a sheet.
    repeated: list[list[Command]] = []
    for half in range(2):
        group: list[Command] = []
        for k in range(REPEATED // 2):
            taken = [c.path for c in group]
            path = _search(rng, canvas[None] / 2, None, canvas=canvas, taken=taken, tool=tool, view=view)
            action = SINGLES + half * REPEATED // 2 + k
            group.append(
                _command(
                    rng, action, half, path=path, palette_srgb=palette_srgb, view=view, canvas=canvas, dip=tool.dips
                )
            )
        repeated.append(group)
    commands: list[Command] = []
    for sheet in range(SHEETS):
        count = SINGLES // SHEETS
        colour = np.array(commands[-1].color_srgb) if commands else palette_srgb[0]
        again = repeated[sheet % 2]
        commands += _sheet(
            rng,
            sheet,
            sheet * count,
            singles=count,
            repeated=again,
            colour=colour,
            tool=tool,
            palette_srgb=palette_srgb,
            view=view,
            canvas=canvas,
        )
    return commands


def raster(
    tool: Tool, canvas_size_m: tuple[float, float], palette_srgb: FloatArray, view: View, seed: int
) -> list[Command]:
    """168 commands in their order: three sheets of 7 rows of 8 strokes."""
    rng = np.random.default_rng([seed, 22])
    canvas = np.array(canvas_size_m)
    cells = RASTER_ROWS * RASTER_COLUMNS
    pitch = (canvas - 2 * EDGE_M) / (RASTER_COLUMNS, RASTER_ROWS)
    again = set(rng.choice(cells, REPEATED, replace=False).tolist())
    colour = palette_srgb[rng.integers(len(palette_srgb))][None]
    repeats: dict[int, Command] = {}
    commands: list[Command] = []
    for sheet in range(TIMES):
        for cell in range(cells):
            if cell in again and sheet:
                commands.append(replace(repeats[cell], sheet=sheet))
                continue
            row, column = divmod(cell, RASTER_COLUMNS)
            middle = EDGE_M + pitch * (column + 0.5, row + 0.5)
            action = len(commands) if cell not in again else SINGLES * 3 + cell
            path = _path(rng, tool, view, middle_m=middle, theta_rad=0.0, longest_m=0.8 * float(pitch[0]))
            dip = tool.dips and column == 0
            made = _command(
                rng, action, sheet, path=path, palette_srgb=colour, view=view, canvas=canvas, dip=dip, wait_s=WAITS_S[0]
            )
            repeats[cell] = made
            commands.append(made)
    return _renumbered(commands)


def _renumbered(commands: list[Command]) -> list[Command]:
    ids = {action: k for k, action in enumerate(dict.fromkeys(c.action_id for c in commands))}
    return [replace(c, action_id=ids[c.action_id]) for c in commands]


def _sheet(
    rng: np.random.Generator,
    sheet: int,
    first_action: int,
    *,
    singles: int,
    repeated: list[Command],
    colour: FloatArray,
    tool: Tool,
    palette_srgb: FloatArray,
    view: View,
    canvas: FloatArray,
) -> list[Command]:
    """The strokes of one sheet in random order. Single strokes keep clear of repeated ones still to come."""
    slots = np.array([*range(len(repeated)), *[-1] * singles])
    rng.shuffle(slots)
    made: list[Command] = []
    action, to_come = first_action, [c.path for c in repeated]
    for slot in slots:
        if slot >= 0:
            made.append(replace(repeated[slot], sheet=sheet))
            to_come = [path for path in to_come if path is not repeated[slot].path]
            colour = np.array(repeated[slot].color_srgb)
            continue
        dip = bool(tool.dips and rng.random() < DIP_SHARE)
        if dip:
            colour = palette_srgb[rng.integers(len(palette_srgb))]
        if made and rng.random() < CROSSING:
            target = made[-1 - int(rng.integers(min(RECENT, len(made))))].path
            path = _search(rng, target[:, 1:3], 0.002, canvas=canvas, taken=to_come, tool=tool, view=view)
        else:
            path = _search(
                rng, canvas[None] / 2, None, canvas=canvas, taken=to_come + [c.path for c in made], tool=tool, view=view
            )
        made.append(
            _command(rng, action, sheet, path=path, palette_srgb=colour[None], view=view, canvas=canvas, dip=dip)
        )
        action += 1
    return made


def _search(
    rng: np.random.Generator,
    about_m: FloatArray,
    spread_m: float | None,
    *,
    canvas: FloatArray,
    taken: list[FloatArray],
    tool: Tool,
    view: View,
) -> FloatArray:
    """A path near one of the points [N, 2], with standard deviation `spread_m` (None: uniform), that overlaps the min
    number of the paths `taken`."""
    boxes = np.array([window_around(path, 0.4 * tool.nominal_width_m) for path in taken]).reshape(-1, 4)
    best, fewest = None, np.inf
    for _ in range(TRIES):
        if spread_m is None:
            middle = rng.uniform(0, canvas)
        else:
            middle = about_m[rng.integers(len(about_m))] + spread_m * rng.standard_normal(2)
        path = _path(rng, tool, view, middle_m=middle)
        box = window_around(path, 0.4 * tool.nominal_width_m)
        if np.any(path[:, 1:3] < EDGE_M) or np.any(path[:, 1:3] > canvas - EDGE_M):
            continue
        overlaps = int(np.all((box[:2] < boxes[:, 2:]) & (boxes[:, :2] < box[2:]), axis=1).sum())
        if overlaps < fewest:
            best, fewest = path, overlaps
        if fewest == 0:
            break
    if best is None:
        raise RuntimeError("No stroke of this tool fits on the canvas; make its strokes shorter.")
    return best


def _path(
    rng: np.random.Generator,
    tool: Tool,
    view: View,
    *,
    middle_m: FloatArray,
    theta_rad: float | None = None,
    longest_m: float = np.inf,
) -> FloatArray:
    """A random timed path [24, 5] that fits into a window with its margin."""
    room = np.array([view.long_px, view.short_px]) / view.pixels_per_m - 2 * view.margin_m
    shortest = max(tool.stroke_length_m[0], 0.25 * room[0])
    longest = min(tool.stroke_length_m[1], room[0], longest_m)
    while True:
        theta = rng.uniform(-np.pi, np.pi) if theta_rad is None else theta_rad
        length = rng.uniform(shortest, longest)
        bend = length * rng.uniform(*tool.bend_range)
        press = rng.uniform(*tool.press_range_m, size=3)
        yaw = rng.uniform(-np.pi / 2, np.pi / 2) if tool.kind == "flat" else 0.0
        points = stroke_points(middle_m, theta, length, bend_m=bend, press_m=press, yaw_rad=yaw, points=POINTS)
        extent = np.sort(np.ptp(points[:, :2], axis=0))[::-1]
        speed = np.exp(rng.uniform(*np.log(tool.speed_range_m_s)))
        if np.all(extent <= room):
            return timed_path(points, speed)


def _command(
    rng: np.random.Generator,
    action: int,
    sheet: int,
    *,
    path: FloatArray,
    palette_srgb: FloatArray,
    view: View,
    canvas: FloatArray,
    dip: bool,
    wait_s: float | None = None,
) -> Command:
    if wait_s is None:
        wait_s = float(np.exp(rng.uniform(*np.log(WAITS_S)))) if rng.random() < LONG_WAIT else WAITS_S[0]
    red, green, blue = palette_srgb[rng.integers(len(palette_srgb))]
    colour = float(red), float(green), float(blue)
    return Command(action, sheet, path, _window_px(rng, path, view, canvas), colour, dip, wait_s)


def _window_px(rng: np.random.Generator, path: FloatArray, view: View, canvas: FloatArray) -> tuple[int, int, int, int]:
    """The window around the path with a random shift of up to 2 px: column, row, width, height in the canvas's
    image."""
    low, high = path[:, 1:3].min(axis=0), path[:, 1:3].max(axis=0)
    lying = high[0] - low[0] >= high[1] - low[1]
    size = np.array([view.long_px, view.short_px] if lying else [view.short_px, view.long_px])
    image = np.rint(canvas * view.pixels_per_m).astype(int)
    middle = (low + high) / 2 * view.pixels_per_m
    middle[1] = image[1] - middle[1]
    corner = np.rint(middle - size / 2 + rng.uniform(-2, 2, 2)).astype(int)
    column, row = np.clip(corner, 0, image - size)
    return int(column), int(row), int(size[0]), int(size[1])
