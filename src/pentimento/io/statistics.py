"""What a table's rows command and show, one number a row, for its card."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pentimento.contracts.covariates import drawn_length_m
from pentimento.contracts.height_maps import decode_height_m
from pentimento.contracts.images import decode_png

Array = NDArray[np.float64]


def commanded_strokes(table: pa.Table) -> dict[str, Array]:
    """Of each stroke: its length (mm), mean press (mm), speed (mm/s; NaN where unknown), and place (mm)."""
    columns: dict[str, list[float]] = {
        name: [] for name in ("length (mm)", "press (mm)", "speed (mm/s)", "x (mm)", "y (mm)")
    }
    for points in table["path"].to_pylist():
        path = np.array(points, dtype=np.float64)
        length, duration = drawn_length_m(path), path[-1, 0] - path[0, 0]
        columns["length (mm)"].append(1e3 * length)
        columns["press (mm)"].append(1e3 * float(np.maximum(-path[:, 3], 0.0).mean()))
        columns["speed (mm/s)"].append(1e3 * length / duration if duration > 0 else np.nan)
        columns["x (mm)"].append(1e3 * float(path[:, 1].mean()))
        columns["y (mm)"].append(1e3 * float(path[:, 2].mean()))
    return {name: np.array(values) for name, values in columns.items()}


def commanded_pushes(table: pa.Table) -> dict[str, Array]:
    """Of each push: its travel and depth (mm), and place (mm)."""
    action = np.array(table["action"].to_pylist(), dtype=np.float64)
    named = {"length (mm)": action[:, 3], "depth (mm)": action[:, 4], "x (mm)": action[:, 0], "y (mm)": action[:, 1]}
    return {name: 1e3 * values for name, values in named.items()}


def heading_of_strokes(table: pa.Table) -> Array:
    """From the first to the last point, rad; NaN where they are one."""
    ends = [np.array([points[0][1:3], points[-1][1:3]]) for points in table["path"].to_pylist()]
    along = np.array([end[1] - end[0] for end in ends])
    return np.where(np.hypot(*along.T) > 1e-4, np.arctan2(along[:, 1], along[:, 0]), np.nan)


def heading_of_pushes(table: pa.Table) -> Array:
    """Of travel, rad."""
    return np.array(table["action"].to_pylist(), dtype=np.float64)[:, 2]


def shown_strokes(table: pa.Table) -> dict[str, Array]:
    """Of each pair of photographs: the lightness of the paper before (0 to 1), and how much the stroke changed."""
    paper, change = [], []
    for before, after in _pairs(table):
        first, second = (decode_png(data).astype(np.float64) / 255 for data in (before, after))
        paper.append(float(np.quantile(first, 0.9)))
        change.append(float(np.abs(second - first).mean()))
    return {"paper lightness": np.array(paper), "change of the photograph": np.array(change)}


def shown_pushes(table: pa.Table) -> dict[str, Array]:
    """Of each pair of scans: height of the surface before (mm, median), how much it changed (mm), and holes."""
    height, change, holes = [], [], []
    for (before, after), unit in zip(_pairs(table), table["height_per_unit_m"].to_pylist(), strict=True):
        first, second = (1e3 * decode_height_m(data, unit) for data in (before, after))
        there = np.isfinite(first) & np.isfinite(second)
        height.append(float(np.median(first[there])) if there.any() else np.nan)
        change.append(float(np.abs(second - first)[there].mean()) if there.any() else np.nan)
        holes.append(1 - float(there.mean()))
    return {
        "surface height (mm)": np.array(height),
        "change of the scan (mm)": np.array(change),
        "holes (share)": np.array(holes),
    }


def _pairs(table: pa.Table) -> list[tuple[bytes, bytes]]:
    rows: list[dict[str, Any]] = table.select(["before", "after"]).to_pylist()
    return [(row["before"]["bytes"], row["after"]["bytes"]) for row in rows]


def in_order(table: pa.Table) -> list[NDArray[np.intp]]:
    """For each session, its rows' indices in the order of execution."""
    session = np.array(table["session"].to_pylist())
    order = np.array(table["order"].to_pylist())
    return [
        rows[np.argsort(order[rows], kind="stable")] for rows in (np.flatnonzero(session == s) for s in _each(session))
    ]


def _each(values: Any) -> list[str]:
    return list(dict.fromkeys(values.tolist()))
