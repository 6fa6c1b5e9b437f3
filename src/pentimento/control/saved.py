"""What a person saves of a painting: a photograph, the drawing as SVG and as G-code, the recording, and the replay."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.atomic import atomic_write
from pentimento.contracts.errors import ConfigError, PentimentoError
from pentimento.contracts.strokes import CONTRACT
from pentimento.contracts.tables import read_table
from pentimento.control.open_robot import JOURNAL
from pentimento.control.pictures import PHOTOGRAPH
from pentimento.control.recording import RECORD
from pentimento.control.replay import REPLAY, replay_page
from pentimento.robots.gcode import GcodeFile
from pentimento.robots.gcode import connect as gcode_file
from pentimento.robots.hardware import HardwareRobot
from pentimento.robots.rig import Palette, Rig, load_rig
from pentimento.robots.svg import SvgPlotter
from pentimento.robots.tools import Tool, same_colour

FloatArray = NDArray[np.float64]

DRAWING: Final = "painting.svg"
GCODE: Final = "painting.gcode"
RECORDING: Final = "recording.zip"
_PLOTTER: Final = "plotter_on_file"
"""The rig that G-code is written for, where the painting's own robot reads none."""
_OWN_DRIVERS: Final = ("gcode", "grbl")
"""Drivers of rigs that read G-code, and whose pens are named alike."""


@dataclass(frozen=True, eq=False)
class MadeStroke:
    """A stroke of the robot's, or a line that a person drew on the page."""

    path: FloatArray
    """[N, 5]: t_s, x_m, y_m, z_m, yaw_rad, canvas frame."""
    color_srgb: FloatArray
    """[3]"""
    dip: bool = False
    """Whether the tool was dipped before it."""
    wash: bool = False
    """Whether the tool was washed and wiped before that dip."""


def saved_files(
    folder: Path, tool: Tool, canvas_size_m: tuple[float, float], rig: Rig | None = None
) -> Mapping[str, Callable[[], bytes]]:
    """Functions that give the content of each file that can be saved, by its name; `rig`: see `gcode_of`.

    They may be called at any time, also while the robot paints, and raise PentimentoError where there is nothing to
    save.
    """
    return {
        PHOTOGRAPH: partial(_read, folder / PHOTOGRAPH),
        DRAWING: lambda: drawing_of(made_strokes(folder, tool), tool, canvas_size_m, rig),
        GCODE: lambda: gcode_of(made_strokes(folder, tool), tool, rig),
        RECORDING: lambda: recording_of(folder),
        REPLAY: lambda: replay_page(folder).encode(),
    }


def write_drawings(folder: Path, tool: Tool, canvas_size_m: tuple[float, float], rig: Rig | None = None) -> list[str]:
    """Write the drawing into the painting's folder, as SVG and as G-code; nothing where no stroke was made.

    Args:
        rig: see `gcode_of`.

    Returns:
        Sentences for the person, such as that the sheet is too large for the plotter.
    """
    strokes = made_strokes(folder, tool)
    if not strokes:
        return []
    atomic_write(folder / DRAWING, drawing_of(strokes, tool, canvas_size_m, rig))
    try:
        atomic_write(folder / GCODE, gcode_of(strokes, tool, rig))
    except PentimentoError as error:
        return [f"There is no {GCODE}: {error}"]
    return []


def made_strokes(folder: Path, tool: Tool) -> list[MadeStroke]:
    """All strokes on the sheet, in their order: from the robot's journal, or else from the recording."""
    journal = folder / JOURNAL
    if journal.is_file():
        return _journaled(journal, tool)
    if not any((folder / RECORD).glob("*.parquet")):
        return []
    table = read_table(folder / RECORD, CONTRACT).table
    paths, colors = ([np.array(row) for row in table[name].to_pylist()] for name in ("path", "color_srgb"))
    since = table["since_reload"].to_pylist() if tool.dips else [1] * len(paths)
    before = [np.full(3, np.nan), *colors]
    return [
        MadeStroke(path, color, number == 0, number == 0 and not same_colour(color, last))
        for path, color, number, last in zip(paths, colors, since, before[: len(paths)], strict=True)
    ]


def drawing_of(
    strokes: list[MadeStroke], tool: Tool, canvas_size_m: tuple[float, float], rig: Rig | None = None
) -> bytes:
    """An SVG drawing, in millimetres. With a tool that dips, each dip begins a layer with the visit to the well, at the
    places of the rig of `gcode_of`; without visits where these lie on the sheet or are too few.

    Raises:
        ConfigError: there is no stroke.
    """
    _check_any(strokes)
    places = _places(strokes, tool, canvas_size_m, _plotter(rig))
    plotter = SvgPlotter(Path(DRAWING), canvas_size_m, places)
    plotter.change_tool(replace(tool, color_srgb=None, strokes_per_dip=1))  # the strokes have their colours
    paints = _paints(strokes)
    plotter.load_palette(paints)
    for stroke in strokes:
        if stroke.wash:
            plotter.wipe()
        if stroke.dip or places is None:
            plotter.dip(_paint_of(stroke, paints))
        plotter.move(stroke.path)
    return plotter.document().encode()


def gcode_of(strokes: list[MadeStroke], tool: Tool, rig: Rig | None = None) -> bytes:
    """G-code. With a tool that dips, it pauses (M0) until the wells are filled, and goes to the water, the cloth and
    the wells where the robot did.

    Args:
        rig: the painting's; G-code is for it, if its machine reads any, and otherwise for the rig `plotter_on_file`.

    Raises:
        ConfigError: there is no stroke.
        ContractError: the strokes have more colours than the rig has wells.
        EnvelopeViolation: a stroke lies outside the plotter's reach.
    """
    _check_any(strokes)
    rig = _plotter(rig)
    file: GcodeFile = gcode_file(rig)
    robot, paints = HardwareRobot(file, rig, file.pause), _paints(strokes)
    if tool.dips:
        robot.load_palette(paints)
    for stroke in strokes:
        if stroke.wash:
            file.note("wash and wipe")
            robot.wipe()
        if stroke.dip:
            paint = _paint_of(stroke, paints)
            file.note(f"dip: well {paint + 1}")
            robot.dip(paint)
        robot.move(stroke.path)
    return file.text().encode()


def _plotter(rig: Rig | None) -> Rig:
    """The rig that a painting's G-code is for, as a file."""
    if rig is None or rig.driver not in _OWN_DRIVERS:
        return load_rig(_PLOTTER)
    pen = {key: value for key, value in rig.machine.items() if key in ("pen", "servo_up", "servo_down")}
    return replace(rig, driver="gcode", machine={"file": GCODE, **pen})


def _paints(strokes: list[MadeStroke]) -> FloatArray:
    """[K, 3]: the colours of the strokes, in the order of first use."""
    paints = list[FloatArray]()
    for stroke in strokes:
        if not any(same_colour(stroke.color_srgb, paint) for paint in paints):
            paints.append(stroke.color_srgb)
    return np.array(paints)


def _paint_of(stroke: MadeStroke, paints: FloatArray) -> int:
    return next(number for number, paint in enumerate(paints) if same_colour(stroke.color_srgb, paint))


def _places(strokes: list[MadeStroke], tool: Tool, canvas_size_m: tuple[float, float], rig: Rig) -> Palette | None:
    """Where a plotter's paints stand; None for a tool that is not dipped, for a sheet that reaches there, and where
    there are more colours than wells."""
    places, (width_m, height_m) = rig.palette, canvas_size_m
    fits = width_m <= rig.canvas_size_m[0] and height_m <= rig.canvas_size_m[1]
    enough = places is not None and len(_paints(strokes)) <= len(places.wells_m)
    return places if tool.dips and fits and enough else None


def recording_of(folder: Path) -> bytes:
    """The recording as a ZIP archive. Raises ConfigError where there is none."""
    shards = sorted((folder / RECORD).glob("*.parquet"))
    if not shards:
        raise ConfigError("No stroke of the robot's was recorded yet, so there is no recording to save.")
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as archive:  # the pictures in it are compressed already
        for shard in shards:
            archive.writestr(f"{RECORD}/{shard.name}", shard.read_bytes())
    return content.getvalue()


def _journaled(journal: Path, tool: Tool) -> list[MadeStroke]:
    """The strokes of a journal, see `journal.Journal`; what a line is painted with is what was dipped in before."""
    own = None if tool.color_srgb is None else np.array(tool.color_srgb)
    palette, color, dip, wash = np.zeros((0, 3)), own, False, False
    strokes = []
    text = journal.read_bytes()
    for line in text[: text.rfind(b"\n") + 1].splitlines():
        name, arguments = json.loads(line)
        match name:
            case "load_palette":
                palette = np.array(arguments[0], dtype=np.float64)
            case "dip":
                color = palette[arguments[0]] if own is None else own
                dip = tool.dips
            case "wipe":
                wash = tool.dips
            case "move":
                strokes.append(MadeStroke(np.array(arguments[0]), np.zeros(3) if color is None else color, dip, wash))
                dip = wash = False
    return strokes


def _read(path: Path) -> bytes:
    if not path.is_file():
        raise ConfigError("The sheet was not photographed yet; save when the robot has begun.")
    return path.read_bytes()


def _check_any(strokes: list[Any]) -> None:
    if not strokes:
        raise ConfigError("Nothing is drawn yet, so there is no drawing to save.")
