"""Checks of a table for its data card: what its rows command and show, one number a row, and warnings about them."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from scipy.stats import rankdata

from pentimento.contracts.covariates import drawn_length_m
from pentimento.contracts.height_maps import decode_height_m
from pentimento.contracts.images import decode_png

Array = NDArray[np.float64]


def commanded_strokes(table: pa.Table) -> dict[str, Array]:
    """Return length (mm), mean press (mm), speed (mm/s; NaN where unknown) and place (mm) of each stroke [N]."""
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
    """Return travel (mm), depth (mm) and place (mm) of each push [N]."""
    action = np.array(table["action"].to_pylist(), dtype=np.float64)
    named = {"length (mm)": action[:, 3], "depth (mm)": action[:, 4], "x (mm)": action[:, 0], "y (mm)": action[:, 1]}
    return {name: 1e3 * values for name, values in named.items()}


def heading_of_strokes(table: pa.Table) -> Array:
    """Return the direction (rad) from the first to the last point of each stroke [N]; NaN where they coincide."""
    ends = [np.array([points[0][1:3], points[-1][1:3]]) for points in table["path"].to_pylist()]
    along = np.array([end[1] - end[0] for end in ends])
    return np.where(np.hypot(*along.T) > 1e-4, np.arctan2(along[:, 1], along[:, 0]), np.nan)


def heading_of_pushes(table: pa.Table) -> Array:
    """Return the direction of travel (rad) of each push [N]."""
    return np.array(table["action"].to_pylist(), dtype=np.float64)[:, 2]


def shown_strokes(table: pa.Table) -> dict[str, Array]:
    """Return for each stroke [N] the lightness of the paper before (0 to 1) and the mean change of the photograph."""
    paper, change = [], []
    for before, after in _pairs(table):
        first, second = (decode_png(data).astype(np.float64) / 255 for data in (before, after))
        paper.append(float(np.quantile(first, 0.9)))
        change.append(float(np.abs(second - first).mean()))
    return {"paper lightness": np.array(paper), "change of the photograph": np.array(change)}


def shown_pushes(table: pa.Table) -> dict[str, Array]:
    """Return for each push [N] the median height before (mm), the mean change (mm) and the fraction of holes."""
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
    """Return the row indices of each session in the order of execution."""
    session = np.array(table["session"].to_pylist())
    order = np.array(table["order"].to_pylist())
    return [
        rows[np.argsort(order[rows], kind="stable")] for rows in (np.flatnonzero(session == s) for s in _each(session))
    ]


def _each(values: Any) -> list[str]:
    return list(dict.fromkeys(values.tolist()))


_SURE: Final = 3.3
"""Standard errors of a rank correlation (p < .001)."""
_CONFOUNDED: Final = 0.5
"""Rank correlation of a command with the order, above which the two are confounded."""
_LEANS: Final = 0.8
"""Fraction of rows with one value, above which a column is imbalanced."""
_RARE: Final = 0.05
"""Fraction of rows with one value, below which the value is rare."""
_SECTORS: Final = 8
"""Of directions, 45 degrees each."""
_ONE_WAY: Final = 0.5
"""Fraction of rows in one sector, above which directions are imbalanced."""
_MIN_ROWS: Final = 60
_MIN_REPEATED: Final = 3
_FLAT: Final = 0.02
"""Relative change below which a quantity counts as constant."""
_MIN_RANKED: Final = 8
"""Known pairs that a rank correlation needs."""


def drift(shown: dict[str, Array], sessions: Sequence[NDArray[np.intp]]) -> list[str]:
    """Return a warning for each session in which the unpainted paper or the unpressed clay changed with time.

    Only the first quantity of ``shown`` is tested: the others depend on the commands.
    """
    name, values = next(iter(shown.items()))
    warnings = []
    for number, rows in enumerate(sessions):
        rho, certain = rank_correlation(np.arange(len(rows), dtype=np.float64), values[rows])
        third = max(len(rows) // 3, 1)
        moved = float(np.nanmean(values[rows[-third:]]) - np.nanmean(values[rows[:third]]))
        if certain and abs(moved) > _FLAT * abs(float(np.nanmean(values[rows]))):
            warnings.append(
                f"Drift: {name} goes {'up' if rho > 0 else 'down'} in the course of session {number + 1} (rank "
                f"correlation with order {rho:+.2f}, by {moved:+.3g} from its first to its last third). Light, camera "
                "or material changed: effects of time cannot be separated from it."
            )
    return warnings


def confounded_with_time(commanded: dict[str, Array], sessions: Sequence[NDArray[np.intp]]) -> list[str]:
    """Return warnings about commands that correlate with the order: wear, drying and drift do the same."""
    warnings = []
    for name, values in commanded.items():
        for number, rows in enumerate(sessions):
            rho, certain = rank_correlation(np.arange(len(rows), dtype=np.float64), values[rows])
            if certain and abs(rho) > _CONFOUNDED:
                warnings.append(
                    f"Confounded: {name} {'grows' if rho > 0 else 'falls'} with the order in session {number + 1} "
                    f"(rank correlation {rho:+.2f}): its effect cannot be separated from wear or drift. Shuffle "
                    "the order."
                )
    return warnings


def imbalance(table: pa.Table, heading: Array, commanded: dict[str, Array]) -> list[str]:
    """Return warnings about dominant and rare values of columns, one direction, and commands that do not vary."""
    warnings = []
    for name in ("tool", "material", "kind", "session", "surface", "color_srgb"):
        if name not in table.column_names:
            continue
        counts = Counter(_label(value) for value in table[name].to_pylist() if value is not None)
        (most, count), total = counts.most_common(1)[0] if counts else ("", 0), sum(counts.values())
        if len(counts) > 1 and count > _LEANS * total:
            warnings.append(f"Imbalance: {count} of {total} rows have {name} {most}; the others hardly count in a fit.")
        elif rare := [label for label, number in counts.items() if len(counts) > 1 and number < _RARE * total]:
            warnings.append(f"Imbalance: of {name} {', '.join(rare[:4])} there are few rows (below 5 %).")
    known = heading[np.isfinite(heading)]
    if len(known):
        sector = np.floor((known % (2 * math.pi)) / (2 * math.pi) * _SECTORS).astype(int)
        share = float(np.bincount(sector, minlength=_SECTORS).max() / len(known))
        if share > _ONE_WAY:
            warnings.append(
                f"Imbalance: {100 * share:.0f} % of the rows go one way (within 45°): offset, lag, backlash and tilt "
                "look alike. Vary the direction."
            )
    for name, values in commanded.items():
        spread = float(np.nanstd(values)) if np.isfinite(values).any() else 0.0
        if spread < _FLAT * abs(float(np.nanmean(values)) if np.isfinite(values).any() else 0.0):
            warnings.append(f"Imbalance: {name} hardly varies: its effect cannot be learned.")
    return warnings


def too_little(table: pa.Table) -> list[str]:
    """Return warnings about too few rows and too few repeated actions."""
    warnings = []
    actions = Counter(table["action_id"].to_pylist())
    repeated = sum(1 for count in actions.values() if count > 1)
    if repeated < _MIN_REPEATED:
        warnings.append(
            f"Actions that are repeated: {repeated or 'none'}. The noise floor is unknown, and with it how much of an "
            "error is a gap: make some actions three times."
        )
    if table.num_rows < _MIN_ROWS:
        warnings.append(
            f"{table.num_rows} rows are few: causes need about a hundred to be confirmed on rows of their own."
        )
    return warnings


def rank_correlation(a: Array, b: Array) -> tuple[float, bool]:
    """Return Spearman's rank correlation of the known pairs, and whether it differs from 0 (normal approximation)."""
    there = np.isfinite(a) & np.isfinite(b)
    count = int(there.sum())
    if count < _MIN_RANKED or np.ptp(a[there]) == 0 or np.ptp(b[there]) == 0:
        return 0.0, False
    rho = float(np.corrcoef(rankdata(a[there]), rankdata(b[there]))[0, 1])
    return rho, abs(rho) * math.sqrt(count - 1) > _SURE


def _label(value: Any) -> str:
    return "(" + ", ".join(f"{v:.2f}" for v in value) + ")" if isinstance(value, list) else str(value)
