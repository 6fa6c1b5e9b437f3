"""Candidate actions for the next collection: random strokes within the ranges of the recorded ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from pentimento.contracts.covariates import Memory, StrokeEvent, advance, covariates, fresh_memory, paint_pickup
from pentimento.diagnosis.strokes.measured import Measured
from pentimento.diagnosis.strokes.model import Model
from pentimento.diagnosis.strokes.predict import ink, predicted_linear
from pentimento.dynamics.strokes.photometry import linear_to_srgb, srgb_to_linear
from pentimento.dynamics.strokes.samples import resample_path
from pentimento.robots.motion import timed_path
from pentimento.robots.strokes import stroke_points

Array = NDArray[Any]

_LONG_WAIT = 0.2
"""A long wait as a share of the recording's duration."""
_LONGEST_WAIT_S = 600.0
_REACHED = 0.75
"""Height of a Bézier stroke as a share of its control points' height."""
_TRIES = 60
"""Attempts at a path that fits."""
_POINTS = 24
_PAUSE_S = 3.0
"""Pause between strokes."""
_CROSSING = 0.4
"""Share of candidates that cross the stroke before."""
_FULL_CONTRAST = 0.15
"""Difference from paper in linear light that counts as fully painted."""


@dataclass(frozen=True)
class Ranges:
    """Ranges of the recorded strokes; pairs are minimum and maximum."""

    length_m: tuple[float, float]
    bend: tuple[float, float]
    """Height of a Bézier stroke's inner control points relative to its length, left positive."""
    bend_m: tuple[float, float]
    """The same height in metres; the longest strokes need not be the most bent."""
    press_m: tuple[float, float]
    yaw_rad: tuple[float, float]
    speed_m_s: tuple[float, float] | None
    """None where times are unknown."""
    place_m: tuple[Array, Array] | None
    """Lower left and upper right [2] of all paths; None where places on the canvas are unknown."""
    max_ink_m: float | None
    """Length drawn since a dip; None where the tool is not dipped or this was not recorded."""
    long_wait_s: float
    """0 where start times were not recorded."""
    window_px: tuple[int, int]
    """Longer and shorter side of the photographed window."""
    room_m: Array
    """[2] extent of a path within the window, margins left out."""
    crossing: bool
    """Whether recorded strokes are known to cross wet paint."""
    paper_srgb: Array
    """float32[3], the brightest usual tone of the canvases."""


def ranges_of(measured: Measured) -> Ranges:
    """The ranges of the recorded commands."""
    path = measured.command.double().numpy()
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
        max_ink_m=float(ink.max()) if ink is not None and dipped else None,
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
    """Extent of a path within a window, [2] along its longer and shorter side, with the margin of most recorded
    strokes.
    """
    samples = measured.samples
    xy = samples.path[..., 1:3].double().numpy()
    k = samples.pixels_per_m.double().numpy()
    spare = (_sides_px(measured) / k[:, None] - np.ptp(xy, axis=1)) / 2
    margin = float(np.clip(np.quantile(spare.min(1), 0.05), 0.0, None))
    return np.maximum(np.array(window_px) / np.median(k) - 2 * margin, 0.0)


def _range(values: Array) -> tuple[float, float]:
    low, high = np.quantile(values, [0.02, 0.98]) + 0.0  # turns -0.0 into 0.0: NumPy draws nothing between them
    return float(low), float(high)


class Action(NamedTuple):
    """A stroke that a robot can make."""

    path: Array
    """[N, 5] in the frame of the recording; times are NaN where the recording has none."""
    like: int
    """Index of the recorded row whose paint it uses."""
    reload: bool
    """Dip the tool before it."""
    wait_s: float
    """Wait this long before it."""
    crosses: bool = False
    """Whether it crosses the stroke before it while that is wet."""


def draw(rng: np.random.Generator, ranges: Ranges, measured: Measured, reload: bool) -> Action:
    """A random action: place, heading, length, bend, press, speed, paint and wait are drawn jointly."""
    path = _feasible_path(rng, ranges)
    if ranges.speed_m_s is not None:
        path = timed_path(path[:, 1:], float(np.exp(rng.uniform(*np.log(ranges.speed_m_s)))))
    wait_s = ranges.long_wait_s * float(rng.choice((0.0, 0.0, 0.3, 1.0)))
    crosses = ranges.crossing and bool(rng.random() < _CROSSING)
    return Action(path, int(rng.integers(len(measured))), reload, wait_s, crosses)


def draw_sequence(rng: np.random.Generator, ranges: Ranges, measured: Measured, count: int) -> list[Action]:
    """Random actions in sequence. Dips before the 1st, 2nd, 4th, 8th, ... vary the length of loads, so that remaining
    ink correlates with nothing else.
    """
    dipped = ranges.max_ink_m is not None
    return [draw(rng, ranges, measured, dipped and (turn + 1) & turn == 0) for turn in range(count)]


class State(NamedTuple):
    """State of a session before its next stroke."""

    memory: Memory
    clock_s: float
    executed: int
    """Number of executed strokes."""


def state_after(measured: Measured) -> State:
    """The state after the last recorded stroke, on a new blank sheet."""
    last = {name: float(values[-1]) for name, values in measured.covariates.items()}
    xy = measured.samples.path[..., 1:3].double().numpy()
    size = float(max(xy[..., 0].max(), 1e-3)), float(max(xy[..., 1].max(), 1e-3))
    drawn = float(measured.samples.path[-1, :, 1:3].diff(dim=0).norm(dim=-1).sum())
    memory = fresh_memory(size)

    def known(name: str) -> float:
        return last[name] if np.isfinite(last.get(name, np.nan)) else 0.0

    memory = replace(
        memory,
        since_reload=int(known("since_reload")) + 1,
        ink_since_reload_m=known("ink_since_reload_m") + drawn,
        tool_age_m=known("tool_age_m") + drawn,
    )
    return State(memory, known("t_start_s") + _PAUSE_S, int(known("order")) + 1)


def predicted_columns(action: Action, state: State, measured: Measured) -> dict[str, float]:
    """What would be recorded beside the action: columns with memory are advanced, the others keep their last values."""
    row = {name: float(values[-1]) for name, values in measured.covariates.items()}
    start_s = state.clock_s + action.wait_s
    event = _event(action, start_s, measured)
    advanced = covariates(state.memory, event) | paint_pickup(state.memory, event)
    known = {name: float(value) for name, value in advanced.items() if not isinstance(value, list)}
    known |= {"order": float(state.executed), "t_start_s": start_s, "t_before_s": start_s}
    known["t_after_s"] = start_s + _duration_s(action)
    return row | {name: value for name, value in known.items() if name in row}


def after(action: Action, state: State, measured: Measured) -> State:
    """The state after the action."""
    start_s = state.clock_s + action.wait_s
    memory = advance(state.memory, _event(action, start_s, measured))
    return State(memory, start_s + _duration_s(action) + _PAUSE_S, state.executed + 1)


def executable(
    actions: Sequence[Action], measured: Measured, ranges: Ranges
) -> tuple[list[Action], list[dict[str, float]]]:
    """The actions as they can be executed after the recorded ones, and what would be recorded beside each.

    The tool is dipped where paint would not last. A crossing action is moved onto the stroke before it.
    """
    state = state_after(measured)
    feasible: list[Action] = []
    columns: list[dict[str, float]] = []
    for action in actions:
        empty = ranges.max_ink_m is not None and state.memory.ink_since_reload_m > ranges.max_ink_m
        possible = action._replace(reload=action.reload or empty, crosses=action.crosses and bool(feasible))
        if possible.crosses:
            possible = possible._replace(path=_moved_onto(feasible[-1].path, action.path, ranges))
        feasible.append(possible)
        columns.append(predicted_columns(possible, state, measured))
        state = after(possible, state, measured)
    return feasible, columns


def as_measured(
    actions: Sequence[Action], columns: Sequence[dict[str, float]], model: Model, measured: Measured, ranges: Ranges
) -> Measured:
    """A sequence of actions as strokes without photographs (``after`` is ``before``).

    They lie on blank paper, or on the predicted stroke before them where they cross it.
    """
    strokes = _on_paper(actions, columns, measured, ranges)
    rows = [row for row, action in enumerate(actions) if action.crosses and row]
    if not rows:
        return strokes
    windows = strokes.samples.pick(torch.tensor(rows))
    below = strokes.pick(np.array(rows) - 1)
    seen = below.samples._replace(top_left_m=windows.top_left_m, pixels_per_m=windows.pixels_per_m, valid=windows.valid)
    below = replace(below, samples=seen)
    wet = predicted_linear(ink(model, below), below)
    paper = strokes.samples.before_linear.numpy()[rows]
    before, painted = strokes.samples.before_linear.clone(), strokes.painted.copy()
    before[rows] = torch.as_tensor(wet, dtype=before.dtype)
    painted[rows] = np.clip(np.abs(wet - paper).max(-1) / _FULL_CONTRAST, 0.0, 1.0)
    srgb = linear_to_srgb(before)
    return replace(
        strokes, painted=painted, samples=strokes.samples._replace(before_linear=before, before=srgb, after=srgb)
    )


def _on_paper(
    actions: Sequence[Action], columns: Sequence[dict[str, float]], measured: Measured, ranges: Ranges
) -> Measured:
    template = measured.pick(np.array([action.like for action in actions]))
    samples, side = template.samples, max(ranges.window_px)
    path = torch.tensor(np.stack([resample_path(action.path, samples.path.shape[1]) for action in actions]))
    windows = np.stack([window_of(action, measured, ranges) for action in actions])
    paper = torch.tensor(ranges.paper_srgb, dtype=torch.float32).expand(len(actions), side, side, 3).contiguous()
    valid = torch.zeros(len(actions), side, side)
    for row, action in zip(valid, actions, strict=True):
        width, height = _shape(action, ranges)
        row[:height, :width] = 1.0
    samples = samples._replace(
        path=path.float(),
        top_left_m=torch.tensor(windows[:, [0, 3]]).float(),
        before=paper,
        before_linear=srgb_to_linear(paper),
        after=paper,
        ink=valid > 1,
        valid=valid,
        action=torch.arange(len(actions)),
    )
    return replace(
        template,
        samples=samples,
        covariates={name: np.array([row[name] for row in columns]) for name in measured.covariates},
        painted=np.zeros(valid.shape, np.float32),
        residual_prediction=np.zeros((*valid.shape, 3), np.float32),
    )


def window_of(action: Action, measured: Measured, ranges: Ranges) -> Array:
    """The window to photograph, [4] x_min, y_min, x_max, y_max: of the recorded size, around the path."""
    size = np.array(_shape(action, ranges)) / float(measured.samples.pixels_per_m[action.like])
    xy = action.path[:, 1:3]
    middle = (xy.min(0) + xy.max(0)) / 2
    return np.concatenate([middle - size / 2, middle + size / 2])


def _shape(action: Action, ranges: Ranges) -> tuple[int, int]:
    """Width and height of the action's window in pixels."""
    width, height = np.ptp(action.path[:, 1:3], axis=0)
    return ranges.window_px if width >= height else (ranges.window_px[1], ranges.window_px[0])


def _feasible_path(rng: np.random.Generator, ranges: Ranges) -> Array:
    """A path [N, 5] without times that fits the window and the place; the last attempt if none does."""
    for _ in range(_TRIES):
        length = rng.uniform(*ranges.length_m)
        bend = length * rng.uniform(*ranges.bend)
        press = rng.uniform(*ranges.press_m, size=3)
        yaw = rng.uniform(*ranges.yaw_rad)
        heading, middle = 0.0, np.array([length / 2, 0.0])
        if ranges.place_m is not None:
            heading, middle = rng.uniform(-np.pi, np.pi), rng.uniform(*ranges.place_m)
        points = stroke_points(middle, heading, length, bend_m=bend, press_m=press, yaw_rad=yaw, points=_POINTS)
        low, high = points[:, :2].min(0), points[:, :2].max(0)
        fits = bool((np.sort(high - low)[::-1] <= ranges.room_m).all())
        inside = ranges.place_m is None or bool((low >= ranges.place_m[0]).all() and (high <= ranges.place_m[1]).all())
        if fits and inside and ranges.bend_m[0] <= bend <= ranges.bend_m[1]:
            break
    return np.column_stack([np.full(_POINTS, np.nan), points])


def _moved_onto(target: Array, path: Array, ranges: Ranges) -> Array:
    """A path with its middle moved onto that of another one, as far as it stays within the place."""
    xy = path[:, 1:3] + target[len(target) // 2, 1:3] - path[len(path) // 2, 1:3]
    if ranges.place_m is not None:
        low, high = ranges.place_m
        xy = xy + np.maximum(low - xy.min(0), 0) + np.minimum(high - xy.max(0), 0)
    moved: Array = np.column_stack([path[:, :1], xy, path[:, 3:]])
    return moved


def _event(action: Action, start_s: float, measured: Measured) -> StrokeEvent:
    color = measured.samples.color[action.like].double().numpy()
    return StrokeEvent(action.path, start_s, action.reload, color)


def _duration_s(action: Action) -> float:
    seconds = float(action.path[-1, 0] - action.path[0, 0])
    return seconds if np.isfinite(seconds) else 0.0
