"""Photographed robot strokes: which sets are trained on, and on which others their models are tested."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from pentimento.diagnosis.strokes.quarantine import usable_rows

BRUSHES = (
    "brush_2022a", "brush_2022b", "brush_2022c_16x20", "brush_big_11x14", "brush_big_16x20", "brush_small_16x20",
    "brush_small2_16x20", "brush_small_spline",
)  # fmt: skip
PENS = ("sharpie_spline_1019", "sharpie_spline_1020", "sharpie_short", "marker_6x6")
LIKE = {
    "brush_2022a": "brush_2022b",
    "brush_2022b": "brush_2022a",
    "brush_2022c_16x20": "brush_2022b",
    "brush_big_11x14": "brush_big_16x20",
    "brush_big_16x20": "brush_big_11x14",
    "brush_small_16x20": "brush_small2_16x20",
    "brush_small2_16x20": "brush_small_16x20",
    "brush_small_spline": "brush_small2_16x20",
    "sharpie_spline_1019": "sharpie_spline_1020",
    "sharpie_spline_1020": "sharpie_spline_1019",
    "sharpie_short": "sharpie_spline_1019",
    "marker_6x6": "sharpie_short",
}
"""A set of a similar tool, recorded at another time. ``brush_2022c`` has none; ``brush_small_spline`` is executed as
splines, and its like as Bézier strokes."""
QUARTERS = 4
_OTHER = 120


def parts(folder: Path, name: str, number: int) -> tuple[pa.Table, dict[str, pa.Table]]:
    """Training strokes of a set; its held-out strokes (``own``), the quarter of that ``number``, and, at most 120,
    strokes of its like (``other``).
    """
    table, other = (pq.read_table(folder / f"{each}.parquet") for each in (name, LIKE[name]))
    some = np.sort(np.random.default_rng([0, 32]).permutation(other.num_rows)[:_OTHER])
    training, held_out = held_out_of(usable_rows(table).table, number)
    return training, {"own": held_out, "other": usable_rows(other.take(some)).table}


def held_out_of(table: pa.Table, number: int) -> tuple[pa.Table, pa.Table]:
    """(training, held-out) strokes of a table, the latter a quarter of its actions: numbers 0 to 3 hold out each action
    once, 4 to 7 once more in another draw, and so on.
    """
    action = np.array(table["action_id"].to_pylist())
    drawn, quarter = divmod(number, QUARTERS)
    order = np.random.default_rng([drawn, 31]).permutation(np.unique(action))
    apart = np.isin(action, np.array_split(order, QUARTERS)[quarter])
    return table.filter(pa.array(~apart)), table.filter(pa.array(apart))
