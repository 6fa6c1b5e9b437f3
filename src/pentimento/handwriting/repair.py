"""Repair of recordings: faults that can be repaired are, other strokes are refused, and both are counted.

A tracker that loses the pen leaves holes. One that mistakes a reflection for a marker leaves jumps. A short hole is
bridged. A long hole, and a jump that does not return, ends a stroke and starts another one.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.ranges import above_zero, at_least
from pentimento.handwriting.recording import (
    PRESSURE,
    XY,
    Recording,
    T,
    Z,
)

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.intp]


@dataclass(frozen=True)
class Limits:
    """Limits of human movement. A recording beyond them has a fault."""

    max_gap_samples: int
    """Largest number of missing samples within a stroke. A longer hole starts another stroke."""
    jump_m: float
    """A step longer than this is a jump, if it also is ``jump_factor`` as long as the steps around it."""
    jump_factor: float
    """See ``jump_m``."""
    shortest_m: float
    """Strokes of a shorter path have no direction and are refused."""
    longest_m: float
    """Strokes of a longer path are refused; the likely cause is a wrong unit."""

    def __post_init__(self) -> None:
        at_least(self, 0, "max_gap_samples")
        above_zero(self, "jump_m", "jump_factor", "shortest_m")
        if not self.longest_m > self.shortest_m:
            raise ValueError(f"longest_m is {self.longest_m}; it must be above shortest_m, {self.shortest_m}.")


@dataclass(frozen=True, eq=False)
class Repaired:
    """The result of repairing one recording."""

    source: Recording
    strokes: tuple[Recording, ...]
    """None, one, or several where the recording was split."""
    removed: BoolArray
    """[K] the recording's samples that are in none of the strokes."""
    counts: Counter[str]
    """Number of faults of each kind in ``FAULTS``."""


FAULTS = (
    "holes_bridged", "holes_ending_a_stroke", "times_repeated", "spikes_removed", "jumps_ending_a_stroke",
    "strokes_of_one_point", "strokes_too_short", "strokes_too_long", "pressure_out_of_range",
)  # fmt: skip
"""All kinds of faults. Those that begin with `strokes_` are refusals; all others are repaired."""


def repair(source: Recording, limits: Limits) -> Repaired:
    """Repair one recording, or refuse it."""
    counts: Counter[str] = Counter()
    points = source.points.copy()
    keep: BoolArray = np.asarray(np.isfinite(points[:, XY]).all(axis=1), dtype=np.bool_)
    ends_after = _holes(keep, limits, counts)
    keep = _in_time(points, keep, counts)
    keep, jumps = _without_spikes(points, keep, limits, counts)
    _pressure_in_range(points, counts)
    index = np.flatnonzero(keep)
    strokes, used = [], np.zeros(len(points), dtype=bool)
    for piece in np.split(index, np.searchsorted(index, sorted(ends_after | jumps), side="right")):
        reason = _refusal(points[piece], limits)
        if reason is None:
            strokes.append(replace(source, points=_from_zero(points[piece])))
            used[piece] = True
        else:
            counts[reason] += 1
    return Repaired(source, tuple(strokes), ~used, counts)


@dataclass(frozen=True)
class RepairedAll:
    """Result of repairing many recordings."""

    strokes: list[Recording]
    """All strokes, in order."""
    counts: dict[str, int]
    """Number of each of ``FAULTS``."""
    faulty: list[Repaired]
    """The recordings with any fault."""


def repair_all(sources: Sequence[Recording], limits: Limits) -> RepairedAll:
    """Repair all recordings, or refuse them."""
    repaired = [repair(source, limits) for source in sources]
    total = sum((each.counts for each in repaired), Counter[str]())
    strokes = [stroke for each in repaired for stroke in each.strokes]
    counts = {fault: total[fault] for fault in FAULTS}
    return RepairedAll(strokes, counts, [each for each in repaired if each.counts])


def _holes(keep: BoolArray, limits: Limits, counts: Counter[str]) -> set[int]:
    """Indices of the samples before long holes, after which a stroke ends."""
    index = np.flatnonzero(keep)
    missing = np.diff(index) - 1
    long = missing > limits.max_gap_samples
    for fault, number in (("holes_bridged", (missing > 0) & ~long), ("holes_ending_a_stroke", long)):
        if number.any():
            counts[fault] += int(number.sum())
    return {int(last) for last in index[:-1][long]}


def _in_time(points: FloatArray, keep: BoolArray, counts: Counter[str]) -> BoolArray:
    """Drop samples whose time is not later than that of an earlier sample."""
    times = np.where(keep & np.isfinite(points[:, T]), points[:, T], -np.inf)
    latest = np.concatenate([[-np.inf], np.maximum.accumulate(times)[:-1]])
    repeated = keep & np.isfinite(points[:, T]) & (points[:, T] <= latest)
    if repeated.any():
        counts["times_repeated"] += int(repeated.sum())
    return keep & ~repeated


def _without_spikes(
    points: FloatArray, keep: BoolArray, limits: Limits, counts: Counter[str]
) -> tuple[BoolArray, set[int]]:
    """Drop samples that jump away and return within the longest hole. Return the indices before other jumps, too."""
    keep, jumps = keep.copy(), set[int]()
    index = np.flatnonzero(keep)
    place = points[index][:, XY]
    if not (np.linalg.norm(np.diff(place, axis=0), axis=1) > limits.jump_m).any():
        return keep, jumps
    usual = _usual_step(place, index)
    at = 0
    while at + 1 < len(index):
        ahead = range(at + 1, min(at + 2 + limits.max_gap_samples, len(index)))
        near = [not _is_jump(place, index, at, b=k, usual=usual, limits=limits) for k in ahead]
        if near[0]:
            at += 1
            continue
        back = ahead[near.index(True)] if True in near else None
        if back is None:
            jumps.add(int(index[at]))
            counts["jumps_ending_a_stroke"] += 1
            at += 1
        else:
            keep[index[at + 1 : back]] = False
            counts["spikes_removed"] += 1
            at = back
    return keep, jumps


def _usual_step(place: FloatArray, index: IntArray) -> FloatArray:
    """[K] median of the nine steps around each sample, metres per sample, since speed varies along a stroke."""
    step = np.linalg.norm(np.diff(place, axis=0), axis=1) / np.diff(index)
    if len(step) == 0:
        return np.zeros(len(place))
    padded = np.pad(step, 4, mode="edge")
    usual = np.median(np.lib.stride_tricks.sliding_window_view(padded, 9), axis=1)
    return np.append(usual, usual[-1])


def _is_jump(place: FloatArray, index: IntArray, a: int, *, b: int, usual: FloatArray, limits: Limits) -> bool:
    far = float(np.linalg.norm(place[b] - place[a])) / int(index[b] - index[a])
    return far > max(limits.jump_m, limits.jump_factor * float(usual[a]))


def _pressure_in_range(points: FloatArray, counts: Counter[str]) -> None:
    outside = (points[:, PRESSURE] < 0) | (points[:, PRESSURE] > 1)
    if outside.any():
        counts["pressure_out_of_range"] += int(outside.sum())
        points[outside, PRESSURE] = np.nan


def _refusal(piece: FloatArray, limits: Limits) -> str | None:
    if len(np.unique(piece[:, XY], axis=0)) < 2:
        return "strokes_of_one_point"
    length = float(np.linalg.norm(np.diff(piece[:, XY], axis=0), axis=1).sum())
    if length < limits.shortest_m:
        return "strokes_too_short"
    return "strokes_too_long" if length > limits.longest_m else None


def _from_zero(piece: FloatArray) -> FloatArray:
    """Times from the stroke's start. A column with any unknown value becomes unknown."""
    piece = piece.copy()
    for column in (T, Z, PRESSURE):
        if not np.isfinite(piece[:, column]).all():
            piece[:, column] = np.nan
    piece[:, T] -= piece[0, T]
    return piece
