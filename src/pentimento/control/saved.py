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
from pentimento.robots.rig import load_rig
from pentimento.robots.svg import SvgPlotter
from pentimento.robots.tools import Tool, same_colour

FloatArray = NDArray[np.float64]

DRAWING: Final = "painting.svg"
GCODE: Final = "painting.gcode"
RECORDING: Final = "recording.zip"
_PLOTTER: Final = "plotter_on_file"
"""The rig that G-code is written for."""


@dataclass(frozen=True, eq=False)
class MadeStroke:
    """A stroke of the robot's, or a line that a person drew on the page."""

    path: FloatArray
    """[N, 5]: t_s, x_m, y_m, z_m, yaw_rad, canvas frame."""
    color_srgb: FloatArray
    """[3]"""


def saved_files(folder: Path, tool: Tool, canvas_size_m: tuple[float, float]) -> Mapping[str, Callable[[], bytes]]:
    """Functions that give the content of each file that can be saved, by its name.

    They may be called at any time, also while the robot paints, and raise PentimentoError where there is nothing to
    save.
    """
    return {
        PHOTOGRAPH: partial(_read, folder / PHOTOGRAPH),
        DRAWING: lambda: drawing_of(made_strokes(folder, tool), tool, canvas_size_m),
        GCODE: lambda: gcode_of(made_strokes(folder, tool)),
        RECORDING: lambda: recording_of(folder),
        REPLAY: lambda: replay_page(folder).encode(),
    }


def write_drawings(folder: Path, tool: Tool, canvas_size_m: tuple[float, float]) -> list[str]:
    """Write the drawing into the painting's folder, as SVG and as G-code; nothing where no stroke was made.

    Returns:
        Sentences for the person, such as that the sheet is too large for the plotter.
    """
    strokes = made_strokes(folder, tool)
    if not strokes:
        return []
    atomic_write(folder / DRAWING, drawing_of(strokes, tool, canvas_size_m))
    try:
        atomic_write(folder / GCODE, gcode_of(strokes))
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
    paths, colors = (table[name].to_pylist() for name in ("path", "color_srgb"))
    return [MadeStroke(np.array(path), np.array(color)) for path, color in zip(paths, colors, strict=True)]


def drawing_of(strokes: list[MadeStroke], tool: Tool, canvas_size_m: tuple[float, float]) -> bytes:
    """An SVG drawing, in millimetres. Raises ConfigError where there is no stroke."""
    _check_any(strokes)
    plotter = SvgPlotter(Path(DRAWING), canvas_size_m)
    plotter.change_tool(replace(tool, color_srgb=None, strokes_per_dip=1))  # the strokes have their colours
    for stroke in strokes:
        plotter.load_palette(stroke.color_srgb[None])
        plotter.dip(0)
        plotter.move(stroke.path)
    return plotter.document().encode()


def gcode_of(strokes: list[MadeStroke]) -> bytes:
    """G-code for the rig `plotter_on_file`, with a pause (M0) before each stroke of another colour.

    Raises:
        ConfigError: there is no stroke.
        MachineError: a stroke lies outside the plotter's reach.
    """
    _check_any(strokes)
    rig = load_rig(_PLOTTER)
    file: GcodeFile = gcode_file(rig)
    robot, color = HardwareRobot(file, rig, lambda _: None), strokes[0].color_srgb
    for stroke in strokes:
        if not same_colour(stroke.color_srgb, color):
            color = stroke.color_srgb
            file.pause("colour " + "".join(f"{round(255 * float(value)):02x}" for value in color))
        robot.move(stroke.path)
    return file.text().encode()


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
    palette, color = np.zeros((0, 3)), own
    strokes = []
    text = journal.read_bytes()
    for line in text[: text.rfind(b"\n") + 1].splitlines():
        name, arguments = json.loads(line)
        match name:
            case "load_palette":
                palette = np.array(arguments[0], dtype=np.float64)
            case "dip":
                color = palette[arguments[0]] if own is None else own
            case "move":
                strokes.append(MadeStroke(np.array(arguments[0]), np.zeros(3) if color is None else color))
    return strokes


def _read(path: Path) -> bytes:
    if not path.is_file():
        raise ConfigError("The sheet was not photographed yet; save when the robot has begun.")
    return path.read_bytes()


def _check_any(strokes: list[Any]) -> None:
    if not strokes:
        raise ConfigError("Nothing is drawn yet, so there is no drawing to save.")
