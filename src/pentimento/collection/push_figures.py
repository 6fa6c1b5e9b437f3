"""What measured pushes say about themselves: is material kept, and how far do repeats scatter?"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]


def volume_figures(before_m: Array, after_m: Array, known: Array, reset_id: Array) -> dict[str, float]:
    """Mass conservation of the measured data, shares of the slab's volume as seen in both scans.

    Args:
        before_m, after_m: [N, H, W] heights above the table in metres.
        known: bool[N, H, W], measured in both.
        reset_id: [N], which rows lie between the same two smoothings; NaN = unknown.

    Returns:
        Mean and standard deviation of the relative change of volume by a push, the mean share of a dent's volume
        that came up nowhere, and, where smoothings are known, the mean relative change from one to the last push before
        the next.
    """
    change = np.where(known, after_m - before_m, 0.0).astype(np.float64)
    held = np.where(known, before_m, 0.0).sum(axis=(1, 2), dtype=np.float64)
    gained = change.sum(axis=(1, 2))
    dented = -np.minimum(change, 0.0).sum(axis=(1, 2))
    relative = gained / held
    figures = {
        "volume_change_mean": float(relative.mean()),
        "volume_change_sd": float(relative.std()),
        "dent_volume_lost": float(-gained.sum() / dented.sum()) if dented.any() else 0.0,
    }
    between = [
        _change_of_volume(before_m[rows[0]], after_m[rows[-1]], known[rows[0]] & known[rows[-1]])
        for group in np.unique(reset_id[np.isfinite(reset_id)])
        if len(rows := np.flatnonzero(reset_id == group))
    ]
    return figures | ({"volume_change_between_smoothings": float(np.mean(between))} if between else {})


def _change_of_volume(first_m: Array, last_m: Array, known: Array) -> float:
    return float(last_m[known].sum(dtype=np.float64) / first_m[known].sum(dtype=np.float64) - 1.0)


def repeat_floor_mm2(before_m: Array, after_m: Array, known: Array, action_id: Array) -> float | None:
    """How far the changes [N, H, W] of repeated actions scatter about their mean: unbiased variance over the scan.

    It holds the noise of both scans. None where no action is repeated.
    """
    change_mm = 1000.0 * (after_m - before_m).astype(np.float64)
    scatters = []
    for action in np.unique(action_id):
        rows = np.flatnonzero(action_id == action)
        seen = known[rows].all(axis=0)
        if len(rows) > 1 and seen.any():
            scatters.append(float(change_mm[rows][:, seen].var(axis=0, ddof=1).mean()))
    return float(np.mean(scatters)) if scatters else None
