"""What should worry who learns from a table: drift, imbalance, designs that confound, too little of something."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

Array = NDArray[np.float64]

_SURE: Final = 3.3
"""Standard errors of a rank correlation (p < .001)."""
_CONFOUNDED: Final = 0.5
_LEANS: Final = 0.8
_RARE: Final = 0.05
_SECTORS: Final = 8
_ONE_WAY: Final = 0.5
_FEW_ROWS: Final = 60
_REPEATED: Final = 3
_FLAT: Final = 0.02


def drift(shown: dict[str, Array], sessions: Sequence[NDArray[np.intp]]) -> list[str]:
    """What the camera saw of unpainted paper, or the scanner of unpressed clay, that moved in the course of a session.

    Only the first of ``shown`` is asked: what a stroke changes depends on its command.
    """
    name, values = next(iter(shown.items()))
    said = []
    for number, rows in enumerate(sessions):
        rho, certain = rank_correlation(np.arange(len(rows), dtype=np.float64), values[rows])
        third = max(len(rows) // 3, 1)
        moved = float(np.nanmean(values[rows[-third:]]) - np.nanmean(values[rows[:third]]))
        if certain and abs(moved) > _FLAT * abs(float(np.nanmean(values[rows]))):
            said.append(
                f"Drift: {name} goes {'up' if rho > 0 else 'down'} in the course of session {number + 1} (rank "
                f"correlation with order {rho:+.2f}, by {moved:+.3g} from its first to its last third). Light, camera "
                "or material changed: what depends on time cannot be told from it."
            )
    return said


def confounded_with_time(commanded: dict[str, Array], sessions: Sequence[NDArray[np.intp]]) -> list[str]:
    """Commands that go with the order of execution: wear, drying and drift look like them."""
    said = []
    for name, values in commanded.items():
        for number, rows in enumerate(sessions):
            rho, certain = rank_correlation(np.arange(len(rows), dtype=np.float64), values[rows])
            if certain and abs(rho) > _CONFOUNDED:
                said.append(
                    f"Confounded: {name} {'grows' if rho > 0 else 'falls'} with the order in session {number + 1} "
                    f"(rank correlation {rho:+.2f}): what it does cannot be told from wear or drift. Shuffle the order."
                )
    return said


def imbalance(table: pa.Table, heading: Array, commanded: dict[str, Array]) -> list[str]:
    """Rows of which nearly all are of one kind, kinds with hardly any row, and commands that do not vary."""
    said = []
    for name in ("tool", "material", "kind", "session", "surface", "color_srgb"):
        if name not in table.column_names:
            continue
        counts = Counter(_label(value) for value in table[name].to_pylist() if value is not None)
        (most, count), total = counts.most_common(1)[0] if counts else ("", 0), sum(counts.values())
        if len(counts) > 1 and count > _LEANS * total:
            said.append(f"Imbalance: {count} of {total} rows have {name} {most}; the others hardly count in a fit.")
        elif rare := [label for label, number in counts.items() if len(counts) > 1 and number < _RARE * total]:
            said.append(f"Imbalance: of {name} {', '.join(rare[:4])} there are few rows (below 5 %).")
    known = heading[np.isfinite(heading)]
    if len(known):
        sector = np.floor((known % (2 * math.pi)) / (2 * math.pi) * _SECTORS).astype(int)
        share = float(np.bincount(sector, minlength=_SECTORS).max() / len(known))
        if share > _ONE_WAY:
            said.append(
                f"Imbalance: {100 * share:.0f} % of the rows go one way (within 45°): offset, lag, backlash and tilt "
                "look alike. Vary the direction."
            )
    for name, values in commanded.items():
        spread = float(np.nanstd(values)) if np.isfinite(values).any() else 0.0
        if spread < _FLAT * abs(float(np.nanmean(values)) if np.isfinite(values).any() else 0.0):
            said.append(f"Imbalance: {name} hardly varies: what it does cannot be learned.")
    return said


def too_little(table: pa.Table) -> list[str]:
    """Few rows, and nothing repeated."""
    said = []
    actions = Counter(table["action_id"].to_pylist())
    repeated = sum(1 for count in actions.values() if count > 1)
    if repeated < _REPEATED:
        said.append(
            f"Actions that are repeated: {repeated or 'none'}. The noise floor is unknown, and with it how much of an "
            "error is a gap: make some actions three times."
        )
    if table.num_rows < _FEW_ROWS:
        said.append(f"{table.num_rows} rows are few: causes need about a hundred to be confirmed on rows of their own.")
    return said


def rank_correlation(a: Array, b: Array) -> tuple[float, bool]:
    """Spearman's correlation where both are known, and whether it is surely not 0 (normal approximation)."""
    there = np.isfinite(a) & np.isfinite(b)
    count = int(there.sum())
    if count < 8 or np.ptp(a[there]) == 0 or np.ptp(b[there]) == 0:
        return 0.0, False
    rho = float(np.corrcoef(_ranks(a[there]), _ranks(b[there]))[0, 1])
    return rho, abs(rho) * math.sqrt(count - 1) > _SURE


def _ranks(values: Array) -> Array:
    """Ranks in which equal values share their mean."""
    _, inverse, counts = np.unique(values, return_inverse=True, return_counts=True)
    ends = np.cumsum(counts)
    return (ends - (counts - 1) / 2)[inverse]


def _label(value: Any) -> str:
    return "(" + ", ".join(f"{v:.2f}" for v in value) + ")" if isinstance(value, list) else str(value)
