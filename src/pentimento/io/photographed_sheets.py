"""`pentimento record read`: photographs of sheets before and after they were painted on, as a table of strokes."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from pentimento.collection.recording_sheet import (
    COMMANDS,
    Recording,
    read_recording,
    sheet_name,
)
from pentimento.collection.sheet_photo import PIXELS_PER_M, SheetPicture, read_sheet
from pentimento.contracts.atomic import check_replaceable
from pentimento.contracts.errors import CalibrationError, ContractError
from pentimento.contracts.frames import canvas_to_pixel, crop, snap_window, window_around
from pentimento.contracts.images import read_image
from pentimento.io.photo_pairs import import_strokes, read_paths
from pentimento.io.stroke_rows import COMMAND, MARGIN_M, Imported, RecordedPath, Refused, row_of

FloatArray = NDArray[np.float64]
Picture = NDArray[np.uint8]

_MIN_CONTRAST: Final = 0.08
"""Change of sRGB along a path below which there is no paint."""
_PAINTED: Final = 75  # percentile of the change along a path
_FULL: Final = 0.8  # share of the largest change at which paint covers


class ReadSheets(NamedTuple):
    """What was read."""

    imported: Imported
    color_srgb: FloatArray
    """[3] of the paint."""
    coloured: bool
    """Whether the colours are corrected by the chart on all photographs."""


class _Pair(NamedTuple):
    before: SheetPicture
    after: SheetPicture


def read_sheets(folder: Path, before: Sequence[Path], after: Sequence[Path], out: Path) -> ReadSheets:
    """Write the folder ``out`` as shards of the strokes contract, from the recording in ``folder`` and photographs.

    The photographs may come in any order: the code on each sheet tells which it is. Strokes without paint and strokes
    of sheets that were not photographed are refused and counted.

    Raises:
        CalibrationError: a photograph cannot be used, two show one sheet, or before and after are exchanged.
        ContractError: the folder is no recording, or no stroke can be used; nothing is written.
        ConfigError: ``out`` holds what this command did not write.
    """
    check_replaceable(out, COMMAND)
    recording, strokes = read_recording(folder), read_paths(folder / COMMANDS)
    pairs = _pairs(folder, recording, before, after)
    changes = {stroke.name: _change(stroke, recording, pairs) for stroke in strokes}
    color = _paint(changes.values())

    def row(_: int, stroke: RecordedPath, given: Mapping[str, Any]) -> dict[str, Any]:
        pair, change = _pair_of(stroke, pairs), changes[stroke.name]
        if pair is None:
            raise Refused("its sheet was not photographed both before and after")
        canvas = np.array([0.0, 0.0, *recording.canvas_size_m])
        if not ((stroke.path[:, 1:3] >= canvas[:2]) & (stroke.path[:, 1:3] <= canvas[2:])).all():
            raise Refused("its path leaves the canvas")
        if change is None or not change.painted:
            raise Refused("no paint is along it")
        cell, wide = recording.cell_around(stroke.path), window_around(stroke.path, MARGIN_M)
        window = np.concatenate([np.maximum(cell[:2], wide[:2]), np.minimum(cell[2:], wide[2:])])
        window = snap_window(window, canvas, pair.before.canvas.shape)
        shown = [crop(each.canvas, canvas, window) for each in pair]
        about = {"medium": recording.medium, "surface": "paper", "camera_id": "camera_0", "color_srgb": color.tolist()}
        return row_of(stroke, stroke.path, window, before=shown[0], after=shown[1], given={**given, **about})

    imported = import_strokes(folder / COMMANDS, strokes, row, recording.tool, out)
    coloured = all(each.colour_residual is not None for pair in pairs.values() for each in pair)
    return ReadSheets(imported, color, coloured)


def _pairs(folder: Path, recording: Recording, before: Sequence[Path], after: Sequence[Path]) -> dict[str, _Pair]:
    names = [sheet_name(sheet) for sheet in range(recording.sheets)]
    printed = {name: read_image(folder / name) for name in names}
    found: list[dict[int, SheetPicture]] = []
    for when, photographs in (("before", before), ("after", after)):
        seen: dict[int, SheetPicture] = {}
        for path in photographs:
            shown = read_sheet(read_image(path), recording, printed, str(path))
            if shown.sheet in seen:
                raise CalibrationError(f"Two photographs {when} show sheet {shown.sheet + 1}; leave out {path}.")
            seen[shown.sheet] = shown
        found.append(seen)
    both = sorted(found[0].keys() & found[1].keys())
    pairs = {f"sheet_{sheet}": _Pair(found[0][sheet], found[1][sheet]) for sheet in both}
    if not pairs:
        raise CalibrationError("No sheet is photographed both before and after; give both photographs of each sheet.")
    return pairs


class _Change(NamedTuple):
    """What changed within a tool's width of a path."""

    amount: FloatArray
    """[N] how much darker it became, mean over the channels, sRGB; strokes lie on paper."""
    after: FloatArray
    """[N, 3] sRGB."""

    @property
    def painted(self) -> bool:
        return bool(np.percentile(self.amount, _PAINTED) > _MIN_CONTRAST)

    @property
    def washed_off(self) -> bool:
        return bool(np.percentile(-self.amount, _PAINTED) > _MIN_CONTRAST)


def _pair_of(stroke: RecordedPath, pairs: Mapping[str, _Pair]) -> _Pair | None:
    return pairs.get(str(stroke.about.get("surface_id")))


def _change(stroke: RecordedPath, recording: Recording, pairs: Mapping[str, _Pair]) -> _Change | None:
    """None where the stroke's sheet was not photographed, or its path cannot be used."""
    pair = _pair_of(stroke, pairs)
    if pair is None or stroke.fault is not None:
        return None
    canvas = np.array([0.0, 0.0, *recording.canvas_size_m])
    mask = np.zeros(pair.before.canvas.shape[:2], np.uint8)
    line = np.round(canvas_to_pixel(stroke.path[:, 1:3], canvas, PIXELS_PER_M)).astype(np.int32)
    cv2.polylines(mask, [line], False, 1, max(1, round(recording.nominal_width_m * PIXELS_PER_M)))
    before, after = (each.canvas[mask > 0] / 255 for each in pair)
    return _Change((before - after).mean(axis=1), after)


def _paint(changes: Collection[_Change | None]) -> FloatArray:
    """The paint's colour [3], sRGB: the median where it covers best.

    Raises:
        CalibrationError: the photographs before and after are exchanged.
        ContractError: no stroke was painted.
    """
    seen = [change for change in changes if change is not None]
    painted = [change for change in seen if change.painted]
    if sum(change.washed_off for change in seen) > len(painted):
        raise CalibrationError(
            "The photographs before show the painted sheets, and those after the blank ones; exchange them."
        )
    if not painted:
        raise ContractError(
            "No stroke was painted along its guide line; check that the photographs after show the painted sheets."
        )
    amount, after = (np.concatenate([getattr(change, name) for change in painted]) for name in ("amount", "after"))
    return np.asarray(np.median(after[amount > _FULL * np.percentile(amount, 99)], axis=0))
