"""`pentimento import` of a CSV file: paths of strokes, with one photograph before and one after each stroke.

The file has one line for each point, with units in the header:

    stroke, t_s, x_mm, y_mm, z_mm, yaw_deg, session, color
    7,      0.0, 41.5, 20.0, -1.2, 0,       monday,  #1a1a40

`x`, `y` and `z` (or `press`, the depth: z = -press) are required, each with a unit after an underscore. `t` may be
missing or empty (the speed is unknown then), and so may `yaw` (0). Every other column has one value for each stroke:
columns of the strokes contract (`session`, `order`, `action_id`, `t_start_s`, `since_reload`, ...), `color` as #rrggbb,
and any other number, which becomes a covariate.
"""

from __future__ import annotations

import csv
import itertools
import math
import re
import unicodedata
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pentimento.contracts.atomic import check_replaceable
from pentimento.contracts.errors import ContractError, ImageError, UnitError
from pentimento.contracts.images import read_image
from pentimento.contracts.picture_files import PictureError
from pentimento.contracts.strokes import CONTRACT
from pentimento.contracts.tables import is_index
from pentimento.contracts.units import parse_quantity
from pentimento.io.contact_sheet import shown_strokes, write_with_sheet
from pentimento.io.ink_along_path import has_ink
from pentimento.io.stroke_rows import (
    COMMAND,
    Imported,
    Placement,
    RecordedPath,
    Refused,
    card,
    counted,
    path_fault,
    stroke_row,
    table_of,
)

FloatArray = NDArray[np.float64]

_SI: Final = {"t": "s", "x": "m", "y": "m", "z": "m", "press": "m", "yaw": "rad"}
_COLOUR = re.compile(r"#[0-9a-fA-F]{6}")


class _Column(NamedTuple):
    at: int
    factor: float
    """By which its values are multiplied to be in SI units."""


def read_paths(path: Path) -> list[RecordedPath]:
    """Read the strokes of a CSV file, in the order of their first points.

    Raises:
        ContractError: the file is not such a table: no header, a required column missing, an unknown unit.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            lines = list(csv.reader(file, skipinitialspace=True))
    except OSError as error:
        raise ContractError(f"{path} cannot be opened ({error.strerror}); check the path.") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise ContractError(f"{path} is not readable as CSV ({error}); save it as UTF-8 text with commas.") from error
    if not lines:
        raise ContractError(f"{path} is empty; its first line names the columns, such as stroke,t_s,x_mm,y_mm,z_mm.")
    header = [name.strip() for name in lines[0]]
    if len(set(header) - {""}) < len(header) - header.count(""):
        raise ContractError(f"{path} has two columns of one name among {', '.join(header)}; rename one.")
    numbers, stroke = _number_columns(header, path), _stroke_column(header, path)
    named = {stroke, *(column.at for column in numbers.values())}
    others = [at for at in range(len(header)) if at not in named and not _is_index(header[at], at, lines[1:])]
    strokes = {
        name: _recorded(name, rows, header, numbers, others) for name, rows in _by_stroke(lines[1:], stroke).items()
    }
    for name in _torn(lines[1:], stroke):
        strokes[name] = strokes[name]._replace(fault="its points stand at several places of the file")
    if not strokes:
        raise ContractError(f"{path} has a header and no points; record some strokes.")
    return list(strokes.values())


def _is_index(name: str, at: int, lines: list[list[str]]) -> bool:
    """Whether a column only numbers the points, or is an empty one without a name."""
    values = [line[at].strip() if at < len(line) else "" for line in lines if line]
    return is_index(name, values) or not (name or any(values))


def _number_columns(header: list[str], path: Path) -> dict[str, _Column]:
    columns: dict[str, _Column] = {}
    bare = [name for name in header if name in _SI]
    if bare:
        unit = {"s": "s", "m": "mm", "rad": "deg"}[_SI[bare[0]]]
        raise ContractError(f"{path}: column {bare[0]!r} has no unit; name it with one, such as {bare[0]}_{unit}.")
    for at, name in enumerate(header):
        quantity, _, unit = name.partition("_")
        if quantity not in _SI or not unit or "_" in unit:
            continue
        try:
            factor = parse_quantity(f"1 {unit}", _SI[quantity])
        except UnitError as error:
            raise ContractError(f"{path}: column {name!r} has an unusable unit: {error}") from error
        if quantity in columns:
            raise ContractError(f"{path} has {quantity} twice; keep one of the columns.")
        columns[quantity] = _Column(at, factor)
    if "press" in columns and "z" in columns:
        raise ContractError(f"{path} has z and press; keep one: press is -z.")
    missing = [name for name in ("x", "y") if name not in columns]
    missing += [] if {"z", "press"} & set(columns) else ["z (or press)"]
    if missing:
        raise ContractError(
            f"{path} has no column {', '.join(missing)} with a unit, such as {missing[0][0]}_mm, among "
            f"{', '.join(header)}."
        )
    return columns


def _stroke_column(header: list[str], path: Path) -> int:
    if "stroke" not in header:
        raise ContractError(f"{path} has no column stroke, which names each point's stroke and its photographs.")
    return header.index("stroke")


def _by_stroke(lines: list[list[str]], stroke: int) -> dict[str, list[list[str]]]:
    found: dict[str, list[list[str]]] = {}
    for line in lines:
        if line:
            found.setdefault(line[stroke].strip() if stroke < len(line) else "", []).append(line)
    return found


def _torn(lines: list[list[str]], stroke: int) -> set[str]:
    """Names of strokes that begin again after others: of another recording that was put behind this one."""
    names = [line[stroke].strip() for line in lines if stroke < len(line)]
    begun = [name for name, _ in itertools.groupby(names)]
    return {name for name, count in Counter(begun).items() if count > 1}


def _recorded(
    name: str, rows: list[list[str]], header: list[str], numbers: dict[str, _Column], others: list[int]
) -> RecordedPath:
    empty = np.zeros((0, 5))
    if not name or any(character in name for character in "/\\\0") or name.startswith("."):
        return RecordedPath(name, empty, {}, "its name cannot be that of a file")
    if any(len(row) != len(header) for row in rows):
        return RecordedPath(name, empty, {}, "a line has another number of fields than the header")
    try:
        path = _path(rows, numbers)
    except ValueError:
        return RecordedPath(name, empty, {}, "a point is not all numbers")
    about: dict[str, Any] = {}
    for at in others:
        if not header[at]:
            return RecordedPath(name, path, {}, "a column has no name")
        values = {row[at].strip() for row in rows}
        if len(values) > 1:
            return RecordedPath(name, path, {}, f"{header[at]} changes within the stroke")
        try:
            about |= _about(header[at], values.pop())
        except ValueError as error:
            return RecordedPath(name, path, {}, str(error))
    return RecordedPath(name, path, about, path_fault(path))


def _path(rows: list[list[str]], numbers: dict[str, _Column]) -> FloatArray:
    path = np.zeros((len(rows), 5))
    path[:, 0] = np.nan
    for at, names in enumerate((("t",), ("x",), ("y",), ("z", "press"), ("yaw",))):
        for name in names:
            if name in numbers:
                place, factor = numbers[name]
                unknown = {"t": "nan", "yaw": "0"}.get(name, "")
                sign = -1.0 if name == "press" else 1.0
                path[:, at] = [sign * factor * float(row[place].strip() or unknown) for row in rows]
    path[:, 0] -= path[0, 0]
    return path


def _about(name: str, text: str) -> dict[str, Any]:
    """Return one value of another column under the name of the contract.

    Raises ValueError with a reason where the value does not fit.
    """
    if not text:
        return {}
    if name == "color":
        if _COLOUR.fullmatch(text) is None:
            raise ValueError("color is not written as #rrggbb")
        return {"color_srgb": [int(text[at : at + 2], 16) / 255 for at in (1, 3, 5)]}
    column = CONTRACT.column(name)
    if name == "frame":
        raise ValueError("frame cannot be given: paths are in the photographs' frame")
    if column is not None and pa.types.is_string(column.type):
        if column.choices and text not in column.choices:
            raise ValueError(f"{name} is none of {', '.join(column.choices)}")
        return {name: text}
    if column is not None and not (pa.types.is_integer(column.type) or pa.types.is_floating(column.type)):
        raise ValueError(f"{name} cannot be given in a CSV file")
    try:
        value = float(text)
    except ValueError:
        raise ValueError(f"{name} is not a number") from None
    if not math.isfinite(value):
        return {}
    if column is not None and pa.types.is_integer(column.type):
        if value != round(value) or not -(2**31) <= value < 2**31:
            raise ValueError(f"{name} is not a whole number")
        return {name: int(value)}
    return {name: value}


def each_about(strokes: list[RecordedPath]) -> Iterator[str]:
    """Yield the names of all other columns, each once, in their order."""
    return iter(dict.fromkeys(name for stroke in strokes for name in stroke.about))


def import_photo_pairs(
    paths: Path,
    photos: Path,
    placement: Placement,
    tool: str,
    out: Path,
    *,
    strokes: list[RecordedPath] | None = None,
) -> Imported:
    """Write the folder ``out`` as shards of the strokes contract, with a README that counts refused strokes.

    Where a stroke has no ``session``, ``order`` or ``action_id``, these are the name of the file ``paths``, the place
    of the stroke in it, and a new action: repeats of one command are known by ``action_id`` only. The photographs
    ``<stroke>_before`` and ``<stroke>_after`` (PNG, JPEG, …) are already rectified to ``placement``; each row keeps
    the part around its path.

    Args:
        strokes: of the file ``paths``; None: it is a CSV.

    Raises:
        ContractError: the file of paths cannot be read, or no stroke of it can be used; nothing is written.
        ConfigError: ``out`` holds what this command did not write.
    """
    check_replaceable(out, COMMAND)
    photographs = _by_stem(photos)

    def row(_: int, stroke: RecordedPath, given: Mapping[str, Any]) -> dict[str, Any]:
        before, after = (_photo(photographs, f"{stroke.name}_{when}") for when in ("before", "after"))
        return stroke_row(stroke, before, after, placement, given)

    return import_strokes(paths, read_paths(paths) if strokes is None else strokes, row, tool, out)


def import_strokes(
    paths: Path,
    strokes: list[RecordedPath],
    row_of_stroke: Callable[[int, RecordedPath, Mapping[str, Any]], dict[str, Any]],
    tool: str,
    out: Path,
) -> Imported:
    """Write the rows of a file's strokes as ``import_photo_pairs`` does.

    Args:
        row_of_stroke: makes a row of a stroke's place in the file, the stroke, and values of columns for which it has
            none, or raises ``Refused``.

    Raises:
        ContractError: no stroke can be used; nothing is written.
    """
    rows: list[dict[str, Any]] = []
    refused: dict[str, list[str]] = {}
    first: dict[int, int] = {}
    for number, stroke in enumerate(strokes):
        given = {"session": paths.stem, "order": number, "action_id": number, "tool": tool}
        try:
            if stroke.fault is not None:
                raise Refused(stroke.fault)
            row = row_of_stroke(number, stroke, given)
            if row["action_id"] in first and len(strokes[first[row["action_id"]]].path) != len(stroke.path):
                raise Refused("its action_id is that of a stroke with another number of points")
        except Refused as reason:
            refused.setdefault(str(reason), []).append(stroke.name)
            continue
        first.setdefault(row["action_id"], number)
        rows.append(row)
    if not rows:
        raise ContractError(f"None of the {len(strokes)} strokes of {paths} can be used: {counted(refused)}.")
    table = table_of(rows, list(each_about(strokes)))
    write_with_sheet(out, table, CONTRACT, card(paths.name, tool, len(rows), refused), shown_strokes)
    return Imported(len(rows), refused, sum(not has_ink(row) for row in rows))


_ENDINGS: Final = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".webp", ".bmp")
_NOT_READ: Final = (".heic", ".heif", ".dng", ".cr2", ".cr3", ".nef", ".arw")
"""Endings of photographs as phones and cameras write them, for which there is no reader."""


def _by_stem(folder: Path) -> dict[str, list[Path]]:
    """The pictures of a folder by their names without endings.

    Endings may be upper-case, as cameras write them. Letters with accents are composed (NFC), since some systems store
    names decomposed.
    """
    found: dict[str, list[Path]] = {}
    for file in sorted(folder.iterdir()) if folder.is_dir() else []:
        if file.suffix.lower() in (*_ENDINGS, *_NOT_READ) and file.is_file():
            found.setdefault(unicodedata.normalize("NFC", file.stem), []).append(file)
    return found


def _photo(photographs: dict[str, list[Path]], stem: str) -> NDArray[np.uint8]:
    found = photographs.get(unicodedata.normalize("NFC", stem), [])
    when = "before" if stem.endswith("_before") else "after"
    readable = [file for file in found if file.suffix.lower() in _ENDINGS]
    if found and not readable:
        kind = found[0].suffix[1:].upper()
        raise Refused(f"the photograph {when} it is {kind}, which is not read: save it as JPEG or PNG")
    found = readable
    if not found:
        raise Refused(f"there is no photograph {when} it")
    if len(found) > 1:
        raise Refused(f"there are several photographs {when} it")
    try:
        return read_image(found[0])
    except PictureError as error:
        raise Refused(f"a photograph is unreadable ({error.reason})") from error
    except ImageError as error:
        raise Refused("a photograph is unreadable") from error
