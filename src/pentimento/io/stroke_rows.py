"""A recorded stroke, its path and a photograph before and after it, as a row of the strokes contract."""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pentimento.contracts.errors import ContractError, PentimentoError
from pentimento.contracts.frames import crop, snap_window, window_around
from pentimento.contracts.images import encode_png
from pentimento.contracts.rows import row_faults
from pentimento.contracts.schema import arrow_schema
from pentimento.contracts.strokes import CONTRACT
from pentimento.io.path_table import RecordedPath
from pentimento.io.place import Placement

MAX_PIXELS: Final = 2**27
"""Of a photograph."""
_MARGIN_M: Final = 0.012
"""Paper round a stroke's path that its row shows."""


class Imported(NamedTuple):
    """What came of an import."""

    rows: int
    refused: dict[str, list[str]]
    """Names of strokes by the reason for which they were left out."""


class Refused(PentimentoError):
    """One stroke cannot be used; its text is the reason."""


def stroke_row(
    stroke: RecordedPath,
    before: NDArray[np.uint8],
    after: NDArray[np.uint8],
    placement: Placement,
    given: dict[str, Any],
) -> dict[str, Any]:
    """A row that shows what lies around the path.

    Args:
        stroke: whose path is in the frame of ``placement`` and without fault.
        before: photograph [H, W, 3], sRGB, rectified to ``placement``; likewise ``after``.
        given: values of columns where the stroke says nothing of its own.

    Raises:
        Refused: the photographs differ in size, the path leaves them, or the row would break the contract.
    """
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
    row = given | stroke.about | {
        "path": path.tolist(),
        "window_m": window.tolist(),
        "before": {"bytes": encode_png(shown), "path": None},
        "after": {"bytes": encode_png(shown_after), "path": None},
        "frame": "canvas",
    }  # fmt: skip
    fault = row_faults(table_of([row], list(stroke.about)), CONTRACT)[0]
    if fault is not None:
        raise Refused(fault)
    return row


def table_of(rows: list[dict[str, Any]], names: list[str]) -> pa.Table:
    """Contract columns as the contract says, and the other numbers among ``names`` as float32 covariates."""
    present = {name for row in rows for name in row}
    schema = arrow_schema(CONTRACT, include_optional=present)
    for name in names:
        if CONTRACT.column(name) is None and name in present:
            schema = schema.append(pa.field(name, pa.float32()))
    return pa.Table.from_pylist(rows, schema=schema)


def card(source: str, tools: str, rows: int, refused: dict[str, list[str]]) -> str:
    """The first lines of a table's README.md."""
    left = f"{counted(refused)}." if refused else "none."
    return f"# Strokes of the {tools}\n\nImported from `{source}`: {rows} rows. Refused: {left}\n"


def counted(refused: dict[str, list[str]]) -> str:
    """How many were refused for each reason."""
    return "; ".join(f"{len(names)} × {reason}" for reason, names in refused.items())
