"""`pentimento import` of an .npz file: paths of strokes with their pictures before and after, as arrays.

    path            float[N, K, 3]: x, y, z; or float[N, K, 5]: t_s, x, y, z, yaw_rad
    before, after   uint8[N, H, W, 3], sRGB, or uint8[N, H, W], grey: what one window shows

Any other array [N] that is named like a column of the strokes contract (`session`, `order`, `action_id`, …) becomes
that column. Where all paths begin at the origin, they and the window lie in each stroke's own frame.
"""

from __future__ import annotations

import io
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pentimento.contracts.atomic import check_replaceable
from pentimento.contracts.errors import ConfigError, ContractError
from pentimento.contracts.strokes import CONTRACT
from pentimento.io.photo_pairs import import_strokes
from pentimento.io.stroke_rows import COMMAND, Imported, Placement, RecordedPath, path_fault, stroke_row

SUFFIX: Final = ".npz"
_XYZ, _TXYZYAW = 3, 5
_AT_ORIGIN_M: Final = 1e-3
"""How far a stroke's own frame may be from the start of its path."""


class PairArrays(NamedTuple):
    """The content of a file."""

    strokes: list[RecordedPath]
    """By their number from 0; paths in metres, as the file has their axes."""
    before: NDArray[np.uint8]
    """[N, H, W, 3]"""
    after: NDArray[np.uint8]
    frame: str
    """Of paths and pictures, as in the contract."""
    assumed: list[str]
    """What the file does not say, as sentences."""


def read_pairs(file: Path, unit_m: float, press_m: float | None) -> PairArrays:
    """Read a file.

    Args:
        unit_m: length of the unit of x and y, and of z where ``press_m`` is None.
        press_m: depth of the tip where z is 1, for a z that is the share of the full press.

    Raises:
        ContractError: the file is no such record; the message says what is wrong.
        ConfigError: z does not fit ``press_m``, or is above the canvas throughout.
    """
    arrays = _loaded(file)
    path, (before, after) = arrays["path"], (_pictures(file, name, arrays[name]) for name in ("before", "after"))
    if path.ndim != 3 or path.shape[2] not in (_XYZ, _TXYZYAW) or path.dtype.kind not in "fiu":
        raise ContractError(
            f"{file}: path is {path.dtype} {list(path.shape)}; write numbers [strokes, points, 3] (x, y, z) or "
            "[strokes, points, 5] (t in s, x, y, z, yaw in rad)."
        )
    if not len(path) == len(before) == len(after):
        raise ContractError(
            f"{file} has {len(path)} paths, {len(before)} pictures before and {len(after)} after; it needs one of each "
            "for a stroke."
        )
    paths = np.zeros((*path.shape[:2], _TXYZYAW))
    paths[:, :, 0] = np.nan
    paths[:, :, (1, 2, 3) if path.shape[2] == _XYZ else slice(None)] = path
    paths[:, :, 1:3] *= unit_m
    paths[:, :, 3] = _height_m(file, paths[:, :, 3], unit_m, press_m)
    columns = {name: array for name, array in arrays.items() if _is_column(name, array, len(path))}
    left_out = sorted(arrays.keys() - columns.keys() - {"path", "before", "after"})
    strokes = [
        RecordedPath(
            str(number), each, {name: array[number].item() for name, array in columns.items()}, path_fault(each)
        )
        for number, each in enumerate(paths)
    ]
    own_frame = len(paths) > 1 and bool((np.abs(paths[:, 0, 1:3]) <= _AT_ORIGIN_M).all())
    assumed = [f"Left out, since the strokes contract has no such columns: {', '.join(left_out)}."] if left_out else []
    if own_frame:
        assumed.append("Every path begins at 0, 0: paths and window lie in each stroke's own frame, not on the canvas.")
    return PairArrays(strokes, before, after, "stroke" if own_frame else "canvas", assumed)


def _loaded(file: Path) -> dict[str, NDArray[Any]]:
    try:
        with np.load(io.BytesIO(file.read_bytes()), allow_pickle=False) as content:
            arrays = {name: content[name] for name in content.files}
    except (OSError, ValueError, TypeError, EOFError, zipfile.BadZipFile, zlib.error, NotImplementedError) as error:
        raise ContractError(f"{file} cannot be read as .npz: {error}. Save plain arrays with numpy.savez.") from error
    if missing := [name for name in ("path", "before", "after") if name not in arrays]:
        raise ContractError(f"{file} has no array {missing[0]!r} among {', '.join(sorted(arrays)) or 'none'}.")
    return arrays


def _pictures(file: Path, name: str, pictures: NDArray[Any]) -> NDArray[np.uint8]:
    colours = np.repeat(pictures[..., None], 3, axis=-1) if pictures.ndim == 3 else pictures
    if pictures.dtype != np.uint8 or colours.ndim != 4 or colours.shape[-1] != 3:
        raise ContractError(
            f"{file}: {name} is {pictures.dtype} {list(pictures.shape)}; write uint8 [strokes, height, width, 3] "
            "(sRGB) or [strokes, height, width] (grey)."
        )
    return colours


def _height_m(file: Path, z: NDArray[np.float64], unit_m: float, press_m: float | None) -> NDArray[np.float64]:
    """The height of the tip above the canvas."""
    known = z[np.isfinite(z)]
    if press_m is not None:
        if ((known < 0) | (known > 1)).any():
            raise ConfigError(
                f"{file}: z is between {known.min():.3g} and {known.max():.3g}, and --press is the depth where z is 1: "
                "give z as a share from 0 to 1, or leave --press out where z is a height (below 0 where it presses)."
            )
        return -press_m * z
    if (known > 0).any() and not (known < 0).any():
        raise ConfigError(
            f"{file}: z is never below 0, so nothing presses: give --press, the depth where z is 1, or write depths "
            "below the canvas as negative heights."
        )
    return unit_m * z


def _is_column(name: str, array: NDArray[Any], strokes: int) -> bool:
    column = CONTRACT.column(name)
    scalar = column is not None and not pa.types.is_nested(column.type) and name != "frame"
    return scalar and array.shape == (strokes,)


def import_pair_arrays(file: Path, pairs: PairArrays, placement: Placement, tool: str, out: Path) -> Imported:
    """Write the folder ``out`` as shards of the strokes contract, as ``photo_pairs.import_photo_pairs`` does.

    Args:
        placement: where the pictures lie, in the frame of the paths.

    Raises:
        ContractError: no stroke can be used; nothing is written.
        ConfigError: ``out`` holds what this command did not write, or y points down and paths have their own frames.
    """
    check_replaceable(out, COMMAND)
    if pairs.frame == "stroke" and (placement.y_down or placement.pixels_per_m is not None):
        raise ConfigError(
            f"{file}: every path begins at 0, 0, so its window cannot lie as --scale or --y-down has it; give "
            "--window with y up."
        )

    def row(number: int, stroke: RecordedPath, given: Mapping[str, Any]) -> dict[str, Any]:
        own = {**given, "frame": pairs.frame}
        return stroke_row(stroke, pairs.before[number], pairs.after[number], placement, own)

    return import_strokes(file, pairs.strokes, row, tool, out)
