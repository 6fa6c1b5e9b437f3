"""`pentimento import` of pen strokes (InkML, UNIPEN, SVG): with photographs, rows of strokes; else demonstrations."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pentimento.contracts.atomic import check_replaceable
from pentimento.contracts.demonstrations import CONTRACT
from pentimento.contracts.errors import ConfigError, ContractError
from pentimento.contracts.schema import arrow_schema
from pentimento.handwriting.recording import XY, Recording, plausible, standardise, turned
from pentimento.handwriting.svg_recordings import read_svg
from pentimento.io.contact_sheet import shown_paths, write_with_sheet
from pentimento.io.inkml import read_inkml
from pentimento.io.pen_strokes import PenFile, PenStroke
from pentimento.io.stroke_rows import COMMAND, Imported, RecordedPath, counted, path_fault
from pentimento.io.unipen import read_unipen
from pentimento.svg.drawing import NoSizeError

FloatArray = NDArray[np.float64]

SUFFIXES: Final = (".inkml", ".svg", ".unipen", ".unp", ".upn", ".dat")
"""Of files of pen strokes, in lower case."""
_FARTHEST_M: Final = 100.0
"""Coordinate above which the unit must be wrong."""


def read_pen(path: Path, unit_m: float | None, y_down: bool | None) -> PenFile:
    """Read the strokes of a file by its suffix.

    Args:
        unit_m: length of its unit, where the file does not say it (in SVG: of a user unit).
        y_down: whether y grows downwards; None: as the format has it.

    Raises:
        ContractError: the file does not follow its format, or its times or lengths cannot be those of a pen.
        ConfigError: its unit is unknown, or known twice.
    """
    why, read = {
        ".svg": ("as SVG defines it", _read_svg),
        ".inkml": ("as InkML defines it where a channel's orientation is +ve", read_inkml),
    }.get(path.suffix.lower(), ("as UNIPEN's own tools draw it", read_unipen))
    found = read(path, unit_m)
    if any((np.abs(stroke.points[:, XY]) > _FARTHEST_M).any() for stroke in found.strokes):
        raise ContractError(f"{path} has points more than {_FARTHEST_M:g} m from its origin; check its unit of length.")
    plausible(path, [Recording("", "", stroke.points) for stroke in found.strokes])
    if y_down is not None:
        return found._replace(y_down=y_down)
    way, other = ("down: flipped", "--y-up") if found.y_down else ("up", "--y-down")
    return found._replace(assumed=[*found.assumed, f"y points {way}, {why}; else give {other}."])


def _read_svg(path: Path, unit_m: float | None) -> PenFile:
    assumed = []
    try:
        drawn = read_svg(path, "", "", unit_m)
    except NoSizeError:
        drawn = read_svg(path, "", "", unit_m, css_pixels=True)
        assumed = ["The drawing has no size in mm: 1 px = 1/96 inch; else give --units, such as '0.1 mm'."]
    own_axes = [stroke.points * [1.0, 1.0, -1.0, 1.0, 1.0] for stroke in drawn]  # read_svg turns y up
    return PenFile([PenStroke(points, {}) for points in own_axes], True, assumed)


def commanded(pen: PenFile, press_m: float | None, path: Path) -> list[RecordedPath]:
    """Return the strokes as commanded paths, along the file's own axes, named by their number from 0.

    Args:
        press_m: how deep the pen presses: at full pressure, where pressures are known. None: the file has heights.

    Raises:
        ConfigError: neither the file nor ``press_m`` gives heights, or both do.
    """
    has_height = any(np.isfinite(stroke.points[:, 3]).any() for stroke in pen.strokes)
    if has_height == (press_m is not None):
        raise ConfigError(
            f"{path} has heights of the tip; leave --press out."
            if has_height
            else f"{path} has no height of the tip; give --press, how deep it presses (at full pressure, where the "
            "file has pressures), such as '0.5 mm'."
        )
    paths = []
    for number, stroke in enumerate(pen.strokes):
        points = stroke.points
        pressure = np.where(np.isfinite(points[:, 4]), points[:, 4], 1.0)
        z = points[:, 3] if press_m is None else -press_m * pressure
        column = np.column_stack([points[:, 0] - points[:1, 0].sum(), points[:, XY], z, np.zeros(len(points))])
        paths.append(RecordedPath(str(number), column, stroke.about, path_fault(column)))
    return paths


def import_demonstrations(path: Path, pen: PenFile, hand: str, out: Path) -> Imported:
    """Write the folder ``out`` as shards of the demonstrations contract; points stay where they were recorded.

    Raises:
        ContractError: no stroke can be used; nothing is written.
        ConfigError: ``out`` holds what this command did not write.
    """
    check_replaceable(out, COMMAND)
    up = [1.0, 1.0, -1.0 if pen.y_down else 1.0, 1.0, 1.0]
    strokes = [Recording(path.stem, hand, stroke.points * up) for stroke in pen.strokes]
    rows: list[dict[str, Any]] = []
    shown: list[FloatArray] = []
    refused: dict[str, list[str]] = {}
    for number, stroke in enumerate(strokes):
        points = stroke.points.copy()
        points[:, 0] -= points[:1, 0].sum()
        if (fault := _fault(points)) is not None:
            refused.setdefault(fault, []).append(str(number))
            continue
        _, pose = standardise(points, 2)
        shown.append(points[:, XY].copy())
        points[:, XY] = turned(points[:, XY] - pose[:2], -float(pose[2]))
        rows.append({
            "session": stroke.session, "hand": hand, "index": len(rows),
            "points": points.tolist(), "standard_to_source": pose.tolist(),
        })  # fmt: skip
    if not rows:
        raise ContractError(f"None of the {len(strokes)} strokes of {path} can be used: {counted(refused)}.")
    left = f"{counted(refused)}." if refused else "none."
    card = f"# Strokes of {hand}\n\nImported from `{path.name}`: {len(rows)} rows. Refused: {left}\n"
    table = pa.Table.from_pylist(rows, schema=arrow_schema(CONTRACT))
    write_with_sheet(out, table, CONTRACT, card, lambda _: shown_paths(shown))
    return Imported(len(rows), refused)


def _fault(points: FloatArray) -> str | None:
    if not np.isfinite(points[:, XY]).all():
        return "a point is NaN or infinite"
    if len(np.unique(points[:, XY], axis=0)) < 2:
        return "it stays at one place"
    return "its times run backwards" if (np.diff(points[:, 0]) < 0).any() else None
