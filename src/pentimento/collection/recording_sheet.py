"""Sheets of paper on which strokes are recorded by hand or with any rig: printed, painted on, and photographed.

A sheet is A4, landscape. Its canvas is divided into cells with a guide line for one stroke each: a cross where the
stroke starts, an arrow head where it ends. Round the canvas lie the eight markers of `contracts/markers.py` under other
ids, a colour chart, a bar of 100 mm, and a code: a marker of another dictionary, which tells the sheets of one
recording from each other and from those of other recordings.
"""

from __future__ import annotations

import csv
import io
import itertools
import json
import zlib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from pentimento.calibration.colour_chart import COLUMNS, PATCHES_SRGB, ROWS
from pentimento.calibration.observe import marker_detector
from pentimento.collection.design import CollectionConfig, Command, design_in_cells
from pentimento.contracts.atomic import command_folder
from pentimento.contracts.codec import from_plain, to_plain
from pentimento.contracts.colour import to_uint8
from pentimento.contracts.covariates import StrokeEvent, covariates_and_advance, fresh_memory, without_canvas
from pentimento.contracts.errors import ContractError
from pentimento.contracts.frames import canvas_to_pixel
from pentimento.contracts.images import encode_png
from pentimento.contracts.markers import DICTIONARY, MarkerLayout, markers_around
from pentimento.robots.tools import Tool

FloatArray = NDArray[np.float64]
Picture = NDArray[np.uint8]

PAPER_M: Final = (0.297, 0.210)
CANVAS_M: Final = (0.249, 0.162)
"""In the middle of the paper: the markers' black ends 7 mm from its edges, where every printer reaches."""
PRINT_PX_PER_M: Final = 12_000
CODES: Final = "DICT_6X6_1000"
CHART_WINDOW_M: Final = (0.030, 0.16525, 0.072, 0.179)
"""Of the colour chart, canvas frame."""
RECORDING: Final = "recording.json"
COMMANDS: Final = "commands.csv"

_COMMAND: Final = "pentimento record sheet"
_FIRST_ID: Final = 8  # the markers round a rig's canvas are 0 to 7, and a sheet may lie among them
_N_CODES: Final = 1000
_CODE_CENTRE_M: Final = (0.062, -0.010)
_CODE_PX: Final = 80  # of a code that is tried, and how it is blurred
_BLURS: Final = (0.5, 1.2, 2.0)
_CELL_M: Final = 0.048
"""Cells are at least as large."""
_CLEAR_M: Final = 0.004
"""Between a stroke of nominal width and the edge of its cell."""
_PATH_POINTS: Final = 32
_REPEATED: Final = 0.1  # share of the strokes that are actions to be repeated
_TIMES: Final = 3
_YAW_SPREAD_RAD: Final = np.pi / 4
_GUIDE_SRGB: Final = (166, 196, 222)  # light blue: far from paper and from dark paints
_BLACK: Final = (0, 0, 0)
_THIN_PX: Final = 3  # 0.25 mm
_SHIFT: Final = 4  # fractional bits of OpenCV's coordinates
_PRESSES: Final = ("light", "medium", "firm")


@dataclass(frozen=True)
class Recording:
    """What the reader of photographed sheets has to know, beside the commands."""

    tool: str
    medium: str
    nominal_width_m: float
    canvas_size_m: tuple[float, float]
    grid: tuple[int, int]
    """Columns and rows of cells."""
    sheets: int
    code: int
    """Of the first sheet; the next ones follow, modulo 1000."""

    def code_of(self, sheet: int) -> int:
        """The code on a sheet, from 0."""
        return (self.code + sheet) % _N_CODES

    def sheet_of(self, code: int) -> int | None:
        """The sheet with a code; None: it is none of this recording."""
        sheet = (code - self.code) % _N_CODES
        return sheet if sheet < self.sheets else None

    def cell_around(self, path: FloatArray) -> FloatArray:
        """Window [4] of the cell in which the middle of a path [N, 5] lies."""
        middle = (path[:, 1:3].min(axis=0) + path[:, 1:3].max(axis=0)) / 2
        size = np.array(self.canvas_size_m) / self.grid
        low = np.clip(np.floor(middle / size), 0, np.array(self.grid) - 1) * size
        return np.concatenate([low, low + size])


def sheet_markers(canvas_size_m: tuple[float, float]) -> MarkerLayout:
    """The markers round a sheet's canvas."""
    around = markers_around(canvas_size_m)
    return replace(around, ids=tuple(_FIRST_ID + marker for marker in around.ids))


def sheet_name(sheet: int) -> str:
    """File name of the picture of a sheet, counted from 0."""
    return f"sheet_{sheet + 1}.png"


def paper_window(canvas_size_m: tuple[float, float]) -> FloatArray:
    """Window [4] of the paper in the canvas frame."""
    margin = (np.array(PAPER_M) - canvas_size_m) / 2
    return np.concatenate([-margin, np.array(canvas_size_m) + margin])


def read_recording(folder: Path) -> Recording:
    """Read what `write_recording` wrote.

    Raises:
        ContractError: the folder holds no recording.
    """
    path = folder / RECORDING
    try:
        plain = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ContractError(
            f"{path} cannot be read ({error}); name the folder that `{_COMMAND}` wrote, with all its files."
        ) from error
    return from_plain(Recording, plain, str(path))


def write_recording(folder: Path, tool: Tool, strokes: int, seed: int) -> Recording:
    """Design strokes for a tool and write ``sheets.pdf``, a PNG of each sheet, ``commands.csv`` and ``recording.json``.

    Raises:
        ContractError: no stroke of the tool fits in a cell.
        ConfigError: the folder holds what this command did not write.
    """
    columns, rows = (int(side // _CELL_M) for side in CANVAS_M)
    size = np.array(CANVAS_M) / (columns, rows)
    low = np.array([(column, row) for row in range(rows) for column in range(columns)]) * size
    commands = design_in_cells(
        tool, np.hstack([low, low + size]), _palette(tool), _config(tool, strokes, len(low), seed)
    )
    table = commands_csv(commands, tool, f"{tool.name}-{seed}")
    sheets = 1 + max(command.sheet for command in commands)
    code = _free_code(zlib.crc32(table.encode()), sheets)
    recording = Recording(
        tool.name, tool.medium, tool.nominal_width_m, CANVAS_M, (columns, rows), sheets=sheets, code=code
    )
    pictures = [draw_sheet(recording, tool, commands, sheet) for sheet in range(sheets)]
    with command_folder(folder, _COMMAND) as out:
        for sheet, picture in enumerate(pictures):
            (out / sheet_name(sheet)).write_bytes(encode_png(picture))
        first, *others = (Image.fromarray(picture) for picture in pictures)
        dots_per_inch = PRINT_PX_PER_M * 0.0254
        first.save(out / "sheets.pdf", save_all=True, append_images=others, resolution=dots_per_inch, quality=95)
        (out / COMMANDS).write_text(table, encoding="utf-8")
        (out / RECORDING).write_text(json.dumps(to_plain(recording), indent=1) + "\n", encoding="utf-8")
    return recording


def commands_csv(commands: list[Command], tool: Tool, session: str) -> str:
    """The commands as `pentimento import` reads them: a line for each point, canvas frame."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    remembered = ("since_reload", "reload_id", "ink_since_reload_m", "tool_age_m")
    writer.writerow(
        ["stroke", "t_s", "x_mm", "y_mm", "z_mm", "yaw_deg", "session", "order", "action_id", "surface_id", *remembered]
    )
    memory = without_canvas(fresh_memory(CANVAS_M, tool.nominal_width_m))
    for order, command in enumerate(commands):
        stroke = command.stroke
        event = StrokeEvent(stroke.path, 0.0, stroke.dip, stroke.color_srgb)
        values, memory = covariates_and_advance(memory, event)
        about = [session, order, command.action_id, f"sheet_{command.sheet}", *(values[name] for name in remembered)]
        for t, x, y, z, yaw in stroke.path:
            numbers = [f"{t:.4f}", *(f"{1e3 * v:.4f}" for v in (x, y, z)), f"{np.degrees(yaw):.3f}"]
            writer.writerow([order + 1, *numbers, *about])
    return text.getvalue()


def draw_sheet(recording: Recording, tool: Tool, commands: list[Command], sheet: int) -> Picture:
    """One sheet to print, sRGB [H, W, 3] at PRINT_PX_PER_M, row 0 at the top."""
    window = paper_window(recording.canvas_size_m)
    width, height = (round(side * PRINT_PX_PER_M) for side in PAPER_M)
    page = _Page(np.full((height, width, 3), 255, np.uint8), window)
    markers = sheet_markers(recording.canvas_size_m)
    for marker, centre in zip(markers.ids, markers.centres_m, strict=True):
        page.marker(DICTIONARY, marker, centre, markers.side_m)
    page.marker(CODES, recording.code_of(sheet), np.array(_CODE_CENTRE_M), markers.side_m)
    page.chart()
    canvas_width, canvas_height = recording.canvas_size_m
    page.text(f"{recording.tool}, sheet {sheet + 1} of {recording.sheets}", (0.139, canvas_height + 0.008), _BLACK)
    bar = np.array([[0.139, -0.014], [0.239, -0.014]])
    for line in (bar, bar[0] + [[0, 0], [0, 0.003]], bar[1] + [[0, 0], [0, 0.003]]):
        page.line(line, _BLACK)
    page.text("100 mm: measure this bar", (0.142, -0.011), _BLACK)
    columns, rows = recording.grid
    for x in np.linspace(0, canvas_width, columns + 1):
        for y in np.linspace(0, canvas_height, rows + 1):
            page.cross(np.array([x, y]), 0.001, 0.0)
    for order, command in enumerate(commands):
        if command.sheet == sheet:
            _draw_stroke(page, recording, tool, command, order)
    return page.pixels


def _draw_stroke(page: _Page, recording: Recording, tool: Tool, command: Command, order: int) -> None:
    path = command.stroke.path
    page.line(path[:, 1:3], _GUIDE_SRGB)
    page.cross(path[0, 1:3], max(0.0015, tool.nominal_width_m / 2 if tool.kind == "flat" else 0.0), path[0, 4])
    end, back = path[-1, 1:3], path[-1, 1:3] - path[-4, 1:3]
    back *= -0.003 / np.linalg.norm(back)
    for side in (0.5, -0.5):
        turned = np.array([back[0] - side * back[1], back[1] + side * back[0]])
        page.line(np.stack([end, end + turned]), _GUIDE_SRGB)
    low, high = tool.press_range_m
    share = (-path[:, 3].mean() - low) / (high - low)
    press = _PRESSES[int(np.clip(share * len(_PRESSES), 0, len(_PRESSES) - 1))]
    cell = recording.cell_around(path)
    text = f"{order + 1} {press} {path[-1, 0]:.1f} s{' DIP' if command.stroke.dip else ''}"
    page.text(text, (cell[0] + 0.0015, cell[3] - 0.0035), _GUIDE_SRGB)


@dataclass(frozen=True, eq=False)
class _Page:
    """Drawing in the canvas frame."""

    pixels: Picture
    window_m: FloatArray

    def px(self, xy_m: FloatArray) -> FloatArray:
        return canvas_to_pixel(xy_m, self.window_m, PRINT_PX_PER_M)

    def line(self, xy_m: FloatArray, color: tuple[int, int, int]) -> None:
        points = np.round(self.px(xy_m) * 2**_SHIFT).astype(np.int32)
        cv2.polylines(self.pixels, [points], False, color, _THIN_PX, cv2.LINE_AA, _SHIFT)

    def cross(self, centre_m: FloatArray, half_m: float, yaw_rad: float) -> None:
        """A cross whose longer arm, if any, lies along ``yaw_rad``."""
        along = np.array([np.cos(yaw_rad), np.sin(yaw_rad)])
        across = np.array([-along[1], along[0]]) * min(half_m, 0.0015)
        for arm in (along * half_m, across):
            self.line(np.stack([centre_m - arm, centre_m + arm]), _GUIDE_SRGB)

    def text(self, text: str, left_low_m: tuple[float, float], color: tuple[int, int, int]) -> None:
        at = np.round(self.px(np.array(left_low_m))).astype(int)
        cv2.putText(self.pixels, text, (int(at[0]), int(at[1])), cv2.FONT_HERSHEY_SIMPLEX, 1.0, color, 2, cv2.LINE_AA)

    def marker(self, dictionary: str, marker: int, centre_m: FloatArray, side_m: float) -> None:
        side = round(side_m * PRINT_PX_PER_M)
        found = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, dictionary))
        square = cv2.aruco.generateImageMarker(found, marker, side)
        self._place(centre_m + np.array([-side_m / 2, side_m / 2]), np.repeat(square[..., None], 3, axis=2))

    def chart(self) -> None:
        """Patches that are wider than high, so that the chart fits beside the canvas."""
        left, low, right, high = CHART_WINDOW_M
        columns, rows = round((right - left) * PRINT_PX_PER_M / COLUMNS), round((high - low) * PRINT_PX_PER_M / ROWS)
        patches = to_uint8(PATCHES_SRGB.reshape(ROWS, COLUMNS, 3))
        self._place(np.array([left, high]), np.repeat(np.repeat(patches, rows, axis=0), columns, axis=1))

    def _place(self, left_top_m: FloatArray, picture: Picture) -> None:
        column, row = np.round(self.px(left_top_m) + 0.5).astype(int)
        self.pixels[row : row + picture.shape[0], column : column + picture.shape[1]] = picture


def _free_code(first: int, sheets: int) -> int:
    """The first code from ``first`` on, modulo 1000, such that those of all sheets are not read as markers."""
    numbers = itertools.count(first)
    return next(n for n in numbers if not any(_misread((n + s) % _N_CODES) for s in range(sheets))) % _N_CODES


def _misread(code: int) -> bool:
    """Whether a blurred code is taken for one of the markers round a canvas; two or three of a thousand are."""
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, CODES))
    square = cv2.aruco.generateImageMarker(dictionary, code, _CODE_PX)
    quiet = cv2.copyMakeBorder(square, 20, 20, 20, 20, cv2.BORDER_CONSTANT, value=(255,))
    blurred = (cv2.GaussianBlur(quiet, (0, 0), blur) for blur in _BLURS)
    return any(marker_detector(DICTIONARY).detectMarkers(each)[1] is not None for each in blurred)


def _palette(tool: Tool) -> FloatArray:
    """One paint; which one is for the photographs to tell."""
    return np.array([tool.color_srgb or (0.0, 0.0, 0.0)])


def _config(tool: Tool, strokes: int, cells: int, seed: int) -> CollectionConfig:
    times = min(_TIMES, -(-strokes // cells))
    return CollectionConfig(
        strokes=strokes,
        repeated=min(round(_REPEATED * strokes), cells) if times > 1 else 0,
        times=times,
        crossing_share=0.0,
        path_points=_PATH_POINTS,
        margin_m=_CLEAR_M,
        edge_m=tool.nominal_width_m / 2 + _CLEAR_M,
        pixels_per_m=PRINT_PX_PER_M,
        settle_s=(1.0, 1.0),
        palette_srgb=((0.0, 0.0, 0.0),),
        yaw_spread_rad=_YAW_SPREAD_RAD,
        seed=seed,
    )
