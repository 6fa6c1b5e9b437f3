"""Registration of strokes: each path is moved onto the ink of its own photograph.

A person's pen is recorded by one instrument and its ink by another, so that every stroke is displaced by its own small
amount. That blurs whatever is learned from them. A robot's strokes need no registration: a displacement of theirs is an
effect to be diagnosed.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import cv2
import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pentimento.contracts import frames
from pentimento.contracts.schema import PATH
from pentimento.dynamics.strokes.samples import row_ink, sampling_of

Array = NDArray[Any]

_FARTHEST_WIDTHS = 1.5
"""Largest displacement that is looked for, in line widths."""
_FINER = 4
"""Places tried per pixel, in each direction."""
_RELUCTANCE = 0.02
"""Share of the ink under the path that a displacement of the largest size must gain."""


class Registered(NamedTuple):
    """A table whose paths lie on their ink."""

    table: pa.Table
    moved_m: Array
    """[B, 2]: displacement of each path; NaN where none within the limit was found, and the path stays."""

    @property
    def sentence(self) -> str:
        """What was done, for a card."""
        distance_mm = 1e3 * np.hypot(*self.moved_m.T)
        found = np.isfinite(distance_mm)
        if not found.any():
            return "No path lies near enough to its ink to be moved; check the frame and the scale of the paths."
        text = f"Each path was moved onto its ink: {np.median(distance_mm[found]):.2g} mm (median)"
        text += f", {np.quantile(distance_mm[found], 0.95):.2g} mm (95 % of the strokes)."
        if not found.all():
            text += f" {(~found).sum()} of {len(found)} lie farther from any ink and stayed."
        return f"{text} What displaces whole strokes can no longer be told from this table."


def register(table: pa.Table) -> Registered:
    """Move each path of a table in the strokes contract to where it covers most of its ink.

    Raises:
        ContractError: the table has no rows, a row makes no sample, or no row shows ink.
    """
    width_m = sampling_of(table, "auto", "auto").line_width_m
    paths, moved = [], []
    for row in (row for batch in table.to_batches() for row in batch.to_pylist()):
        path, share, scale, window = row_ink(row)
        shift = _shift_px(share, frames.canvas_to_pixel(path[:, 1:3], window, scale), width_m * scale) / scale
        shift_m = shift * (1, -1)  # rows count downwards
        moved.append(shift_m)
        if np.isfinite(shift_m).all():
            path[:, 1:3] += shift_m
        paths.append(path.tolist())
    index = table.schema.get_field_index("path")
    return Registered(table.set_column(index, table.schema.field(index), pa.array(paths, PATH)), np.array(moved))


def _shift_px(share: Array, path_px: Array, width_px: float) -> Array:
    """Displacement [2] (columns, rows) of a path that covers most ink; NaN where that is at the limit.

    Args:
        share: [H, W], how much of a pixel is inked.
        path_px: [N, 2] columns and rows, pixel centres at whole numbers.
        width_px: of the line.
    """
    limit = int(np.ceil(_FARTHEST_WIDTHS * width_px * _FINER))
    size = (share.shape[1] * _FINER, share.shape[0] * _FINER)
    ink = cv2.resize(np.clip(share, 0, 1).astype(np.float32), size, interpolation=cv2.INTER_LINEAR)
    line = np.zeros(ink.shape, np.uint8)
    fine = (path_px + 0.5) * _FINER - 0.5
    cv2.polylines(line, [np.round(fine).astype(np.int32)], False, 1, max(round(width_px * _FINER), 1))
    if not line.any():
        return np.full(2, np.nan)
    drawn = cv2.blur(line.astype(np.float32), (_FINER, _FINER))
    covered = cv2.matchTemplate(np.pad(ink, limit), drawn, cv2.TM_CCORR) / float(drawn.sum())
    steps = np.arange(-limit, limit + 1)
    covered -= (_RELUCTANCE * (steps[:, None] ** 2 + steps**2) / limit**2).astype(np.float32)
    row, column = np.unravel_index(covered.argmax(), covered.shape)
    if not 0 < row < 2 * limit or not 0 < column < 2 * limit:
        return np.full(2, np.nan)
    return np.array([column - limit, row - limit]) / _FINER
