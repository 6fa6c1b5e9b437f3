"""What the recorded strokes span, and so what tool, robot and camera are known to do."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pentimento.diagnosis.strokes.measured import Measured

Array = NDArray[Any]

_LONG_WAIT = 0.2  # of the time that the recording took
_LONGEST_WAIT_S = 600.0
_REACHED = 0.75  # of its control points' height by a Bézier stroke


@dataclass(frozen=True)
class Ranges:
    """Of strokes; pairs are least and most."""

    length_m: tuple[float, float]
    bend: tuple[float, float]
    """Of the length: height of a Bézier stroke's inner control points, left positive."""
    bend_m: tuple[float, float]
    """The same height in metres: the longest strokes need not have been the most bent."""
    press_m: tuple[float, float]
    yaw_rad: tuple[float, float]
    speed_m_s: tuple[float, float] | None
    """None where times are unknown."""
    place_m: tuple[Array, Array] | None
    """Lower left and upper right [2] of all paths; None where strokes are recorded in their own frame."""
    most_ink_m: float | None
    """Length drawn since a dip; None where the tool is not dipped or it was not recorded."""
    long_wait_s: float
    """0 where it was not recorded when strokes were made."""
    window_px: tuple[int, int]
    """Longer and shorter side of what is photographed, lying or upright as the stroke does."""
    room_m: Array
    """[2] what a path may take of that, margins left out."""
    crossing: bool
    """Whether recorded strokes are known to cross wet paint."""
    paper_srgb: Array
    """float32[3], the usual brightest tone of the canvases."""


def ranges_of(measured: Measured) -> Ranges:
    """What the recorded strokes span."""
    path = measured.samples.path.double().numpy()
    chord = path[:, -1, 1:3] - path[:, 0, 1:3]
    length = np.maximum(np.hypot(*chord.T), 1e-6)
    across = np.einsum("bnk,bk->bn", path[..., 1:3] - path[:, :1, 1:3], chord[:, ::-1] * (-1, 1)) / length[:, None]
    height = np.take_along_axis(across, np.abs(across).argmax(1)[:, None], 1)[:, 0]
    press = -path[:, [0, path.shape[1] // 2, -1], 3]
    duration = path[:, -1, 0] - path[:, 0, 0]
    drawn = np.hypot(*np.diff(path[..., 1:3], axis=1).transpose(2, 0, 1)).sum(1)
    timed = bool(np.isfinite(duration).all() and (duration > 0).all())
    start = path[:, 0, 1:3]
    placed = bool(np.ptp(start, axis=0).max() > 1e-3)
    xy = path[..., 1:3].reshape(-1, 2)
    ink = measured.covariates.get("ink_since_reload_m")
    dipped = ink is not None and bool(np.isfinite(ink).all()) and np.ptp(ink) > 0
    clock = measured.covariates.get("t_start_s")
    known_clock = clock is not None and bool(np.isfinite(clock).all())
    window_px = _window_px(measured)
    return Ranges(
        length_m=_range(length),
        bend=_range(height / length / _REACHED),
        bend_m=_range(height / _REACHED),
        press_m=_range(press),
        yaw_rad=(float(path[..., 4].min()), float(path[..., 4].max())),
        speed_m_s=_range(drawn / duration) if timed else None,
        place_m=(xy.min(0), xy.max(0)) if placed else None,
        most_ink_m=float(ink.max()) if ink is not None and dipped else None,
        long_wait_s=min(_LONG_WAIT * float(np.ptp(clock)), _LONGEST_WAIT_S)
        if clock is not None and known_clock
        else 0.0,
        window_px=window_px,
        room_m=_room(measured, window_px),
        crossing="wet_age_s" in measured.covariates,
        paper_srgb=np.quantile(measured.samples.before.numpy()[measured.samples.valid.numpy() > 0], 0.9, axis=0),
    )


def _window_px(measured: Measured) -> tuple[int, int]:
    sides = np.sort(_sides_px(measured), axis=1)
    shorter, longer = np.median(sides, axis=0).astype(int)
    return int(longer), int(shorter)


def _sides_px(measured: Measured) -> Array:
    """Width and height of each window, [B, 2]."""
    valid = measured.samples.valid
    return np.stack([valid.amax(1).sum(1).numpy(), valid.amax(2).sum(1).numpy()], 1)


def _room(measured: Measured, window_px: tuple[int, int]) -> Array:
    """What a path may take of a window, [2] along its longer and its shorter side: as much as most recorded do."""
    samples = measured.samples
    xy = samples.path[..., 1:3].double().numpy()
    k = samples.pixels_per_m.double().numpy()
    spare = (_sides_px(measured) / k[:, None] - np.ptp(xy, axis=1)) / 2
    margin = float(np.clip(np.quantile(spare.min(1), 0.05), 0.0, None))
    return np.maximum(np.array(window_px) / np.median(k) - 2 * margin, 0.0)


def _range(values: Array) -> tuple[float, float]:
    low, high = np.quantile(values, [0.02, 0.98]) + 0.0  # not -0.0, from which to 0.0 NumPy draws nothing
    return float(low), float(high)
