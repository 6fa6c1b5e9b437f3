"""Design and collection of the pushes from which a material is learned (thesis 7.3.4), and figures of the recording.

Place, direction, length, depth, speed, dwell and retract speed are drawn jointly at random, so that the causes of the
residual are not aliased (docs/diagnosis.md). The material is smoothed after every few pushes, so that pushes meet fresh
and worked material; a share of them is aimed at earlier pushes. Some actions are repeated, each time as the first push
into freshly smoothed material, so that repeats differ by noise and slow drifts only.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.errors import ContractError
from pentimento.contracts.ranges import above_zero, at_least
from pentimento.control.execute import Session
from pentimento.control.execute_push import execute_push, levelled_m, record_push
from pentimento.robots.driver import SculptingRobot, span_m
from pentimento.robots.tools import EndEffector

FloatArray = NDArray[np.float64]

_TRIES = 300
_BESIDE_M = 0.008
_ORDERED = 1  # random stream that is shared by actions


@dataclass(frozen=True)
class PushCollectionConfig:
    """Size and ranges of a push collection."""

    pushes: int
    """Rows, repeats included."""
    repeated: int
    """Number of actions that are executed ``times`` times; the noise floor is estimated from them."""
    times: int
    pushes_per_smoothing: tuple[int, int]
    """Min and max number of pushes between two smoothings."""
    revisit_share: float
    """Share of the other pushes that are aimed at a push since the smoothing."""
    edge_m: float
    """Pushes, and a gripper's fingers, keep this far from the slab's edge."""
    scan_pixels: int
    """Of a scan, along the slab's longer side."""
    seed: int

    def __post_init__(self) -> None:
        at_least(self, 1, "pushes", "times")
        at_least(self, 8, "scan_pixels")
        at_least(self, 0, "repeated", "revisit_share", "edge_m", "seed")
        above_zero(self, "scan_pixels")
        if self.repeated * self.times > self.pushes:
            raise ValueError(
                f"repeated is {self.repeated}; with times {self.times}, pushes must be at least "
                f"{self.repeated * self.times} and is {self.pushes}: raise pushes, or lower repeated."
            )
        if self.revisit_share > 1:
            raise ValueError(f"revisit_share is {self.revisit_share}; it is a share of the pushes, at most 1.")
        if not 1 <= self.pushes_per_smoothing[0] <= self.pushes_per_smoothing[1]:
            raise ValueError(
                f"pushes_per_smoothing is {list(self.pushes_per_smoothing)}; give the min number, from 1, and the max."
            )


@dataclass(frozen=True, eq=False)
class PushCommand:
    """One push to execute."""

    action_id: int
    """Commands of one value repeat the same action, speeds and dwell."""
    smooth: bool
    """Whether the material is smoothed before it."""
    action: FloatArray
    """[5] of the ``pushes`` contract."""
    speed_m_s: float
    dwell_s: float
    retract_speed_m_s: float


def design_pushes(
    end_effector: EndEffector, area_m: tuple[float, float], config: PushCollectionConfig
) -> list[PushCommand]:
    """``config.pushes`` commands in their order; each action is drawn from (seed, action) alone.

    Raises:
        ContractError: no push of the end-effector fits on the slab.
    """
    singles = config.pushes - config.repeated * config.times
    chooser = np.random.default_rng([config.seed, 0, _ORDERED])
    sizes = _group_sizes(config, chooser)
    repeats = chooser.permutation(np.repeat(np.arange(singles, singles + config.repeated), config.times))
    first_of = dict(zip(chooser.permutation(len(sizes))[: len(repeats)].tolist(), repeats.tolist(), strict=True))
    commands: list[PushCommand] = []
    next_single = 0
    for group, size in enumerate(sizes):
        pressed: list[FloatArray] = []
        for place in range(size):
            if place == 0 and group in first_of:
                command = _drawn(first_of[group], True, end_effector, area_m=area_m, config=config, pressed=[])
            else:
                command = _drawn(next_single, place == 0, end_effector, area_m=area_m, config=config, pressed=pressed)
                next_single += 1
            pressed.append(command.action)
            commands.append(command)
    return commands


def _group_sizes(config: PushCollectionConfig, rng: np.random.Generator) -> list[int]:
    """Numbers of pushes between smoothings: in that range, but as many groups as there are repeats."""
    low, high = config.pushes_per_smoothing
    repeats = config.repeated * config.times
    sizes: list[int] = []
    while sum(sizes) < config.pushes:
        sizes.append(int(rng.integers(low, high + 1)))
    sizes[-1] -= sum(sizes) - config.pushes
    if len(sizes) < repeats:
        sizes = [len(part) for part in np.array_split(np.arange(config.pushes), repeats)]
    return sizes


def _drawn(
    action_id: int,
    smooth: bool,
    end_effector: EndEffector,
    *,
    area_m: tuple[float, float],
    config: PushCollectionConfig,
    pressed: list[FloatArray],
) -> PushCommand:
    rng = np.random.default_rng([config.seed, action_id])
    about = None
    if pressed and rng.random() < config.revisit_share:
        about = _along(pressed[int(rng.integers(len(pressed)))], rng.random(), end_effector)
    action = _action(rng, end_effector, area_m, config, about)
    speed, retract = (
        float(np.exp(rng.uniform(*np.log(bounds))))
        for bounds in (end_effector.speed_range_m_s, end_effector.retract_speed_range_m_s)
    )
    dwell = float(rng.uniform(*end_effector.dwell_range_s))
    return PushCommand(action_id, smooth, action, speed, dwell, retract)


def _along(action: FloatArray, share: float, end_effector: EndEffector) -> FloatArray:
    """A place [2] on the way of an earlier push, or in the middle of a pinch."""
    way = share * action[3] if end_effector.kind == "push" else 0.0
    return np.array([action[0] + way * math.cos(action[2]), action[1] + way * math.sin(action[2])])


def _action(
    rng: np.random.Generator,
    end_effector: EndEffector,
    area_m: tuple[float, float],
    config: PushCollectionConfig,
    about: FloatArray | None,
) -> FloatArray:
    low, high = np.full(2, config.edge_m), np.array(area_m) - config.edge_m
    for attempt in range(_TRIES if np.all(low < high) else 0):
        theta = rng.uniform(-np.pi, np.pi)
        length, depth = rng.uniform(*end_effector.travel_m), rng.uniform(*end_effector.depth_m)
        # A place at the edge may leave no room: then it is anywhere.
        if about is not None and attempt < _TRIES // 2:
            middle = about + _BESIDE_M * rng.standard_normal(2)
        else:
            middle = rng.uniform(low, high)
        way = length * np.array([math.cos(theta), math.sin(theta)]) if end_effector.kind == "push" else np.zeros(2)
        action = np.array([*(middle - 0.5 * way), theta, length, depth])
        places = span_m(end_effector.kind, action, end_effector.opening_m)
        if np.all(places >= low) and np.all(places <= high):
            return action
    raise ContractError(
        f"The {end_effector.name} finds no room for a push on {area_m} m: shorten travel in its file or lower "
        "collect_pushes.edge_m."
    )


def collect_pushes(
    robot: SculptingRobot,
    end_effector: EndEffector,
    material: str,
    config: PushCollectionConfig,
    log: Callable[[str, float, int], None],
) -> list[dict[str, Any]]:
    """Make the pushes of ``design_pushes``; rows of the ``pushes`` contract in their order.

    ``log("change_mm2", mean squared change, i)`` is called after every push.
    """
    robot.change_tool(end_effector)
    commands = design_pushes(end_effector, robot.area_m, config)
    session = Session(f"{material}-{end_effector.name}-{config.seed}", robot.clock_s)
    rows: list[dict[str, Any]] = []
    smoothings, since, surface_m = -1, 0, float("nan")
    for order, command in enumerate(commands):
        if command.smooth:
            robot.smooth()
            smoothings, since = smoothings + 1, 0
        before = robot.scan()
        if command.smooth:
            surface_m = float(np.nanmedian(levelled_m(before)))
        executed = execute_push(
            robot,
            end_effector,
            command.action,
            before=before,
            speed_m_s=command.speed_m_s,
            dwell_s=command.dwell_s,
            retract_speed_m_s=command.retract_speed_m_s,
        )
        row = record_push(
            session, order, command.action_id, end_effector=end_effector, material=material, executed=executed
        )
        rows.append(
            row
            | {
                "surface_height_m": surface_m,
                "reset_id": smoothings,
                "pushes_since_reset": since,
                "tool_id": f"{end_effector.name}_0",
            }
        )
        since += 1
        change_mm = 1000 * (executed.after.height_m - before.height_m)
        log("change_mm2", float(np.nanmean(change_mm**2)), order)
    return rows


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
    """Unbiased variance of the changes [N, H, W] of repeated actions, mean over the scan [mm²].

    It contains the noise of both scans. None where no action is repeated.
    """
    change_mm = 1000.0 * (after_m - before_m).astype(np.float64)
    scatters = []
    for action in np.unique(action_id):
        rows = np.flatnonzero(action_id == action)
        seen = known[rows].all(axis=0)
        if len(rows) > 1 and seen.any():
            scatters.append(float(change_mm[rows][:, seen].var(axis=0, ddof=1).mean()))
    return float(np.mean(scatters)) if scatters else None
