"""A million commands against the safety envelope: none that breaks a limit may reach a driver.

`python -m benchmarks.envelope` sends 1,000,000 commands through a guarded robot, random and adversarial, and judges
each that reaches the driver by the limits as they are stated, in code of its own (`breaks`). It also counts commands
that are well inside and were refused all the same. tests/control/test_safety_million.py runs a part of it.
"""

from __future__ import annotations

import argparse
import dataclasses
import math
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import Any

import numpy as np

from pentimento.contracts.errors import EnvelopeViolation
from pentimento.control.guard import GuardedRobot
from pentimento.control.safety import SafetyEnvelope, envelope_for
from pentimento.robots.tools import load_tool

CANVAS_M = (0.3, 0.2)
TOOLS = ("marker", "round_brush", "flat_brush")
BATCH = 200
"""Paths that are drawn at once."""


@dataclasses.dataclass
class Tally:
    """What became of the commands."""

    sent: Counter[str] = dataclasses.field(default_factory=Counter)
    reached: Counter[str] = dataclasses.field(default_factory=Counter)
    escaped: list[str] = dataclasses.field(default_factory=list)
    """Broke a limit and reached the driver."""
    refused_inside: list[str] = dataclasses.field(default_factory=list)
    """Kept every limit with one per cent to spare and were refused."""


class Judge:
    """A driver that moves nothing and judges what reaches it."""

    canvas_size_m = CANVAS_M
    clock_s = 0.0

    def __init__(self, envelope: SafetyEnvelope) -> None:
        self.envelope = envelope
        self.verdict: str | None = None
        self.moves = 0

    def change_tool(self, tool: Any) -> None: ...

    def lift(self) -> None: ...

    def move(self, path: Any) -> Any:
        self.moves += 1
        self.verdict = breaks(path, self.envelope, margin=0.0)
        return path


def breaks(path: Any, envelope: SafetyEnvelope, margin: float) -> str | None:
    """Name the limit that a path breaks; None if it keeps them all.

    The limits as SafetyEnvelope states them, one after the other in plain Python. With `margin` 0 a number may be wrong
    by what its rest in a float32 table can have done to it; with a positive one every limit is narrower by that share.
    """
    if type(path) is not np.ndarray or path.dtype != np.float64 or path.ndim != 2 or path.shape[1] != 5:
        return "shape"
    if len(path) < 2:
        return "too few points"
    rows = path.tolist()
    if not all(math.isfinite(value) for row in rows for value in row):
        return "not finite"
    share = 1.0 - margin
    slip_m = (
        2 * float(np.spacing(np.float32(max(abs(value) for row in rows for value in row[1:4])))) if not margin else 0
    )
    slip_s = 2 * float(np.spacing(np.float32(max(abs(row[0]) for row in rows)))) if not margin else 0
    slip_rad = 2 * float(np.spacing(np.float32(max(abs(row[4]) for row in rows)))) if not margin else 0
    edge_m = 1.1e-7 if not margin else -margin * 0.004
    for t_s, x_m, y_m, z_m, yaw in rows:
        if not (envelope.x_min_m - edge_m <= x_m <= envelope.x_max_m + edge_m):
            return "x"
        if not (envelope.y_min_m - edge_m <= y_m <= envelope.y_max_m + edge_m):
            return "y"
        if not (-envelope.max_press_depth_m - edge_m <= z_m <= envelope.max_travel_height_m + edge_m):
            return "z"
        if abs(yaw) > envelope.max_yaw_rad * share + slip_rad:
            return "yaw"
        if abs(t_s) > envelope.max_duration_s * share + slip_s:
            return "duration"
    if abs(rows[0][0]) > 0.001 * share:
        return "start"
    speeds: list[tuple[list[float], float, float]] = []
    for before, after in pairwise(rows):
        step_s = after[0] - before[0]
        if step_s < 0.001 * (2 - share) - slip_s:
            return "control period"
        moved = [b - a for a, b in zip(before[1:4], after[1:4], strict=True)]
        speed = math.hypot(*moved) / step_s
        wrong = (math.sqrt(3) * slip_m + speed * slip_s) / step_s
        if speed - wrong > envelope.max_speed_m_s * share * (1 + 1e-6):
            return "speed"
        turn = abs(after[4] - before[4]) / step_s
        if turn - (slip_rad + turn * slip_s) / step_s > envelope.max_yaw_rate_rad_s * share * (1 + 1e-6):
            return "yaw rate"
        speeds.append(([value / step_s for value in moved], step_s, wrong))
    rest = ([0.0, 0.0, 0.0], 0.0, 0.0)
    for one, other in zip([rest, *speeds], [*speeds, rest], strict=True):
        span_s = (one[1] + other[1]) / 2
        change = math.hypot(*(b - a for a, b in zip(one[0], other[0], strict=True)))
        acceleration = change / span_s
        wrong = (one[2] + other[2] + acceleration * slip_s) / span_s
        if acceleration - wrong > envelope.max_acceleration_m_s2 * share * (1 + 1e-6):
            return "acceleration"
    return None


def smooth_paths(rng: np.random.Generator, envelope: SafetyEnvelope, count: int) -> np.ndarray:
    """[count, N, 5]: bent lines that speed up and slow down, most of them near one limit or another."""
    points = int(rng.integers(2, 14))
    s = np.linspace(0, 1, points)
    # Times of an even speeding up and slowing down, so that acceleration is spread over the path.
    t = np.where(s < 0.5, np.sqrt(s / 2), 1 - np.sqrt((1 - s) / 2)) if points > 2 else s
    middle = rng.uniform((0, 0), CANVAS_M, (count, 2))
    length = rng.uniform(0.002, 0.08, (count, 1))
    angle = rng.uniform(-np.pi, np.pi, (count, 1))
    bend = rng.uniform(-0.2, 0.2, (count, 1)) * length
    along, across = (s - 0.5) * length, 4 * s * (1 - s) * bend
    paths = np.empty((count, points, 5))
    paths[:, :, 1] = middle[:, :1] + np.cos(angle) * along - np.sin(angle) * across
    paths[:, :, 2] = middle[:, 1:] + np.sin(angle) * along + np.cos(angle) * across
    depth = rng.uniform(0, 1.02, (count, 1)) * envelope.max_press_depth_m
    paths[:, :, 3] = -depth * np.sin(np.pi * s) + rng.choice([0.0, 0.01], (count, 1))
    start_rad, turn_rad = rng.uniform(-6.5, 6.5, (count, 1)), rng.choice([0.0, 0.3, 2.0], (count, 1))
    paths[:, :, 4] = start_rad * rng.choice([0, 1], (count, 1)) + s * turn_rad
    # The fastest that the limits allow, times a factor: times scale speeds by 1/k, accelerations by 1/k².
    paths[:, :, 0] = t
    step = np.diff(t)
    velocity = np.diff(paths[:, :, 1:4], axis=1) / step[:, None]
    still = np.zeros((count, 1, 3))
    span = (np.append(step, 0) + np.insert(step, 0, 0)) / 2
    acceleration = np.linalg.norm(np.diff(velocity, axis=1, prepend=still, append=still), axis=2) / span
    fastest = np.maximum(
        np.linalg.norm(velocity, axis=2).max(axis=1) / envelope.max_speed_m_s,
        np.sqrt(acceleration.max(axis=1) / envelope.max_acceleration_m_s2),
    )
    factor = rng.choice([0.5, 0.9, 1 - 1e-3, 1 - 1e-7, 1.0, 1 + 1e-7, 1.02, 1.5, 4.0], count)
    paths[:, :, 0] *= (fastest * factor)[:, None]
    return paths


def touched(rng: np.random.Generator, path: np.ndarray, envelope: SafetyEnvelope) -> tuple[str, Any]:
    """The path with one fault that a person or a bug could cause."""
    kinds = list(_CHANGES)
    kind = kinds[int(rng.integers(len(kinds)))]
    return kind, _CHANGES[kind](rng, path.copy(), envelope)


def _put(values: list[float]) -> Callable[..., Any]:
    def change(rng: np.random.Generator, path: np.ndarray, envelope: SafetyEnvelope) -> np.ndarray:
        path[rng.integers(len(path)), rng.integers(5)] = values[rng.integers(len(values))]
        return path

    return change


def _times(columns: list[list[int]], factors: list[float]) -> Callable[..., Any]:
    def change(rng: np.random.Generator, path: np.ndarray, envelope: SafetyEnvelope) -> np.ndarray:
        path[:, columns[rng.integers(len(columns))]] *= factors[rng.integers(len(factors))]
        return path

    return change


def _edge(rng: np.random.Generator, path: np.ndarray, envelope: SafetyEnvelope) -> np.ndarray:
    """Move the whole path, or one point, to just inside or just outside a wall of the workspace."""
    column = int(rng.integers(1, 4))
    walls = {
        1: (envelope.x_min_m, envelope.x_max_m),
        2: (envelope.y_min_m, envelope.y_max_m),
        3: (-envelope.max_press_depth_m, envelope.max_travel_height_m),
    }[column]
    side = int(rng.integers(2))
    beyond = float(rng.choice([-1e-6, 0.0, 1e-9, 5e-8, 9e-8, 2e-7, 1e-6, 1e-5, 1e-3, 1.0]))
    target = np.float32(walls[side]) if rng.random() < 0.5 else walls[side]
    extreme = path[:, column].max() if side else path[:, column].min()
    move = float(target) + (beyond if side else -beyond) - extreme
    if rng.random() < 0.7:
        path[:, column] += move
    else:
        path[rng.integers(len(path)), column] += move
    return path


def _time_slip(rng: np.random.Generator, path: np.ndarray, envelope: SafetyEnvelope) -> np.ndarray:
    index = int(rng.integers(1, len(path)))
    match int(rng.integers(5)):
        case 0:
            path[index, 0] = path[index - 1, 0]
        case 1:
            path[[index - 1, index], 0] = path[[index, index - 1], 0]
        case 2:
            path[:, 0] += rng.choice([-1.0, 0.0011, 5.0, 40.0])
        case 3:
            path[index, 0] = np.nextafter(path[index - 1, 0] + 0.001, rng.choice([-1.0, 1.0]))
        case _:
            path[:, 0] = path[::-1, 0]
    return path


def _jump(rng: np.random.Generator, path: np.ndarray, envelope: SafetyEnvelope) -> np.ndarray:
    path[rng.integers(len(path)), 1:4] += rng.normal(size=3) * 10.0 ** rng.uniform(-6, -1)
    return path


def _turn(rng: np.random.Generator, path: np.ndarray, envelope: SafetyEnvelope) -> np.ndarray:
    path[rng.integers(len(path)) :, 4] += rng.choice([0.01, 0.1, 1.0, 2 * np.pi, 90.0])
    return path


def _wrong_shape(rng: np.random.Generator, path: np.ndarray, envelope: SafetyEnvelope) -> Any:
    shapes: list[Any] = [
        path[:1], path[:0], path[:, :4], path[None], path.ravel(), path.T, np.hstack((path, path)), path[0, 0],
    ]  # fmt: skip
    return shapes[rng.integers(len(shapes))]


def _wrong_kind(rng: np.random.Generator, path: np.ndarray, envelope: SafetyEnvelope) -> Any:
    kinds: list[Any] = [
        path.astype(object), path.astype(str), path.astype(complex), path > 0, None, "path", b"path", {},
        path.tolist()[:-1],
        [[0, 0, 0, 0, 0], [1]], path.astype("datetime64[s]"), path.astype(np.int64), 10**400, object(),
    ]  # fmt: skip
    return kinds[rng.integers(len(kinds))]


def _other_rest(rng: np.random.Generator, path: np.ndarray, envelope: SafetyEnvelope) -> Any:
    """The same numbers, resting otherwise: rounded, turned round in memory, as lists."""
    rests: list[Callable[[], Any]] = [
        lambda: path.astype(np.float32), lambda: path.astype(np.float16), lambda: path.astype(">f8"),
        lambda: np.asfortranarray(path), path.tolist, lambda: path[::-1], lambda: np.ma.masked_array(path, path > 0.1),
        lambda: path.astype(np.longdouble),
    ]  # fmt: skip
    return rests[rng.integers(len(rests))]()


class Fickle:
    """Answers one path when it is checked and another one later."""

    def __init__(self, first: np.ndarray, later: np.ndarray) -> None:
        self._answers = [first, later]

    def __array__(self, dtype: Any = None, copy: Any = None) -> np.ndarray:
        return self._answers.pop(0) if len(self._answers) > 1 else self._answers[0]


def _fickle(rng: np.random.Generator, path: np.ndarray, envelope: SafetyEnvelope) -> Any:
    return Fickle(path, path + 1.0)


_CHANGES: dict[str, Callable[..., Any]] = {
    "left as it is": lambda rng, path, envelope: path,
    "not a number": _put([math.nan, math.inf, -math.inf]),
    "a huge or tiny number": _put([1e300, -1e300, 1e38, 5e-324, -0.0, 2.0**63]),
    "a slip of a thousand": _times([[1, 2, 3], [1, 2], [3], [0], [1], [2]], [1e3, 1e-3, -1.0, 25.4]),
    "degrees": _times([[4]], [180 / math.pi, 1e6]),
    "at a wall": _edge,
    "times out of order": _time_slip,
    "a jump": _jump,
    "a turn": _turn,
    "too fast": _times([[0]], [0.5, 0.9, 0.99, 0.999999]),
    "too long": _times([[0]], [10.0, 100.0, 1e4]),
    "wrong shape": _wrong_shape,
    "wrong kind": _wrong_kind,
    "other rest": _other_rest,
    "fickle": _fickle,
}


def commands(seed: int, envelope: SafetyEnvelope) -> Iterator[tuple[str, Any]]:
    """Commands without end, each with a word for what was done to it."""
    rng = np.random.default_rng(seed)
    while True:
        for path in smooth_paths(rng, envelope, BATCH):
            yield touched(rng, path, envelope)


def attack(count: int, seed: int) -> Tally:
    """Send so many commands, in equal parts to the guards of the three tools."""
    tally = Tally()
    for number, name in enumerate(TOOLS):
        tool = load_tool(name)
        envelope = envelope_for(tool, CANVAS_M)
        judge = Judge(envelope)
        guard = GuardedRobot(judge, envelope)  # type: ignore[arg-type]
        guard.change_tool(tool)
        source = commands(seed * len(TOOLS) + number, envelope)
        for _ in range((count + number) // len(TOOLS)):
            kind, path = next(source)
            tally.sent[kind] += 1
            moves = judge.moves
            try:
                guard.move(path)
            except EnvelopeViolation:
                if breaks(path, envelope, margin=0.01) is None:
                    tally.refused_inside.append(f"{name}, {kind}: {path.tolist()}")
            if judge.moves > moves:
                tally.reached[kind] += 1
                if judge.verdict is not None:
                    tally.escaped.append(f"{name}, {kind}: {judge.verdict}")
    return tally


def main() -> int:
    """Attack, and print what became of it; 1 if anything escaped."""
    parser = argparse.ArgumentParser(description="Commands against the safety envelope.")
    parser.add_argument("--commands", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    begun_s = time.perf_counter()
    tally = attack(arguments.commands, arguments.seed)
    took_s = time.perf_counter() - begun_s
    print(f"{'what was done':24} {'sent':>9} {'reached':>9}")
    for kind, sent in sorted(tally.sent.items()):
        print(f"{kind:24} {sent:9,} {tally.reached[kind]:9,}")
    print(f"{'all':24} {tally.sent.total():9,} {tally.reached.total():9,}   in {took_s:.0f} s")
    print(f"outside a limit and reached the driver: {len(tally.escaped)}")
    print(f"inside by one per cent and refused: {len(tally.refused_inside)}")
    for line in (*tally.escaped[:5], *tally.refused_inside[:5]):
        print(line)
    return 1 if tally.escaped or tally.refused_inside else 0


if __name__ == "__main__":
    sys.exit(main())
