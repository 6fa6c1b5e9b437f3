"""`pentimento import`: paths in a CSV file and a photograph before and after each stroke become a strokes table."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pentimento.contracts.errors import ContractError, PentimentoError
from pentimento.contracts.frames import crop, snap_window, window_around
from pentimento.contracts.images import encode_png, read_image
from pentimento.contracts.rows import row_faults
from pentimento.contracts.schema import arrow_schema
from pentimento.contracts.strokes import CONTRACT
from pentimento.contracts.tables import write_table
from pentimento.recordings.path_table import RecordedPath, each_about, read_paths
from pentimento.recordings.place import Placement

_MARGIN_M: Final = 0.012
"""Paper round a stroke's path that its row shows."""
_ENDINGS: Final = (".png", ".jpg", ".jpeg")
_MOST_PIXELS: Final = 2**27


class Imported(NamedTuple):
    """What came of an import."""

    rows: int
    refused: dict[str, list[str]]
    """Names of strokes by the reason for which they were left out."""


class Refused(PentimentoError):
    """One stroke cannot be used; its text is the reason."""


def import_photo_pairs(paths: Path, photos: Path, placement: Placement, tool: str, out: Path) -> Imported:
    """Write the folder ``out`` as shards of the strokes contract with a card that counts what was refused.

    A stroke without its own ``session``, ``order`` or ``action_id`` gets ``paths``' name, its place in the file and an
    action of its own: repeats of one command are known only where ``action_id`` says so. Photographs are rectified to
    ``placement`` already, ``<stroke>_before.png`` and ``<stroke>_after.png``; each row keeps what lies around its path.

    Raises:
        ContractError: the file of paths cannot be read, or no stroke of it can be used; nothing is written.
    """
    strokes = read_paths(paths)
    rows: list[dict[str, Any]] = []
    refused: dict[str, list[str]] = {}
    first: dict[str, int] = {}
    for number, stroke in enumerate(strokes):
        try:
            row = _row(stroke, number, photos, placement, tool, paths.stem)
            if row["action_id"] in first and len(strokes[first[row["action_id"]]].path) != len(stroke.path):
                raise Refused("its action_id is that of a stroke with another number of points")
        except Refused as reason:
            refused.setdefault(str(reason), []).append(stroke.name)
            continue
        first.setdefault(row["action_id"], number)
        rows.append(row)
    if not rows:
        raise ContractError(f"None of the {len(strokes)} strokes of {paths} can be used: {_counted(refused)}.")
    names = list(each_about(strokes))
    write_table(out, _table(rows, names), CONTRACT, _card(paths, tool, len(rows), refused))
    return Imported(len(rows), refused)


def _row(
    stroke: RecordedPath, number: int, photos: Path, placement: Placement, tool: str, session: str
) -> dict[str, Any]:
    if stroke.fault is not None:
        raise Refused(stroke.fault)
    before, after = (_photo(photos, f"{stroke.name}_{when}") for when in ("before", "after"))
    if before.shape != after.shape:
        raise Refused("its two photographs differ in size")
    shape = before.shape[0], before.shape[1]
    path, whole = placement.to_canvas(stroke.path, shape), np.array(placement.window_m(shape))
    if not ((path[:, 1:3] >= whole[:2]) & (path[:, 1:3] <= whole[2:])).all():
        raise Refused("its path leaves the photograph")
    try:
        window = snap_window(window_around(path, _MARGIN_M), whole, shape)
        shown, shown_after = crop(before, whole, window), crop(after, whole, window)
    except ContractError as error:
        raise Refused(f"its window does not fit the photograph: {str(error).partition(';')[0].rstrip('.')}") from error
    given: dict[str, Any] = {"session": session, "order": number, "action_id": number, "tool": tool}
    row = given | stroke.about | {
        "path": path.tolist(),
        "window_m": window.tolist(),
        "before": {"bytes": encode_png(shown), "path": None},
        "after": {"bytes": encode_png(shown_after), "path": None},
        "frame": "canvas",
    }  # fmt: skip
    fault = row_faults(_table([row], list(stroke.about)), CONTRACT)[0]
    if fault is not None:
        raise Refused(fault)
    return row


def _photo(folder: Path, stem: str) -> NDArray[np.uint8]:
    found = next((folder / f"{stem}{end}" for end in _ENDINGS if (folder / f"{stem}{end}").is_file()), None)
    if found is None:
        raise Refused(f"there is no photograph {'before' if stem.endswith('_before') else 'after'} it")
    try:
        image = read_image(found)
    except PentimentoError as error:
        raise Refused("a photograph is unreadable") from error
    if image.shape[0] * image.shape[1] > _MOST_PIXELS:
        raise Refused("a photograph is larger than 128 megapixels")
    return image


def _table(rows: list[dict[str, Any]], names: list[str]) -> pa.Table:
    """Contract columns as the contract says, other numbers as float32 covariates."""
    present = {name for row in rows for name in row}
    schema = arrow_schema(CONTRACT, include_optional=present)
    for name in names:
        if CONTRACT.column(name) is None and name in present:
            schema = schema.append(pa.field(name, pa.float32()))
    return pa.Table.from_pylist(rows, schema=schema)


def _card(paths: Path, tool: str, rows: int, refused: dict[str, list[str]]) -> str:
    left = f"{_counted(refused)}." if refused else "none."
    return f"# Strokes of the {tool}\n\nImported from `{paths.name}`: {rows} rows. Refused: {left}\n"


def _counted(refused: dict[str, list[str]]) -> str:
    return "; ".join(f"{len(names)} × {reason}" for reason, names in refused.items())
