"""From a bundle and a letter to a sculpture: ``pentimento run --material``, in the virtual studio."""

from __future__ import annotations

import io
import json
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from pentimento.bundle.graphs import Graphs
from pentimento.bundle.push_graphs import GraphClay
from pentimento.bundle.reader import Bundle, open_bundle
from pentimento.contracts.atomic import atomic_write
from pentimento.contracts.errors import ConfigError, PentimentoError
from pentimento.contracts.height_maps import encode_height_png
from pentimento.contracts.pushes import CONTRACT
from pentimento.contracts.schema import arrow_schema
from pentimento.control.commands import Control
from pentimento.control.commission import ClayCommission, alone_in, write_commission
from pentimento.control.execute import Session
from pentimento.control.execute_push import HEIGHT_PER_UNIT_M
from pentimento.control.journaled_clay import JournaledClay
from pentimento.control.progress import Progress as Shown
from pentimento.control.push_safety import GuardedSculptingRobot, push_envelope_for
from pentimento.control.sculptor import Array, Execution, Progress, Sculptor, seen_m
from pentimento.control.sculpture_state import SculptureState, has_sculpture, load_sculpture, save_sculpture
from pentimento.planning.objectives import Weights
from pentimento.planning.pushes.config import PushRates, SculptorConfig
from pentimento.planning.pushes.goal import GoalSettings, fit_goal, sunken_letters
from pentimento.robots.end_effectors import EndEffector, load_end_effector
from pentimento.robots.sculpting import SculptingRobot
from pentimento.robots.sculpting_virtual import virtual_sculpting_robot

SUMMARY: Final = "sculpture.json"
"""In a finished sculpture's folder: actions, and errors in height (mm²) and slope before and after."""
HEIGHTS: Final = ("before", "goal", "result")
"""Height maps in its folder, PNG in 16 bits."""
RECORD: Final = "pushes"
JOURNAL: Final = "journal.jsonl"

REACH_M: Final = 0.0035
ACTIONS: Final = 60
_SHARE, _SOFTEN_M = 0.7, 0.0028
"""Of the slab's side that a letter covers; how soft its edges are: about a third of what a ball rounds off."""
_PLANNER: Final = SculptorConfig(
    weights=Weights(error_3d=1.0, visual=4.0), caution=1.0, horizon=6, candidates=32, rounds=1, guided=0.8,
    refine="gradient", iterations=4, rates=PushRates(0.002, 0.15, 0.003, 0.0006), samples=24, elite=0.25,
    min_gain=0.001, edge_m=0.012, seed=0,
)  # fmt: skip
_EXECUTION: Final = Execution(batch=4, patience=12, dwell_s=0.5, retract_speed_m_s=0.05)
_GOAL: Final = GoalSettings(volume=1.0, floor=10.0, definition=0.01, kept=0.25, reach_m=REACH_M, border=0.1)


class Ended(PentimentoError):
    """A person has stopped the sculpture; what is known is on disk."""


def clay_commission_of(
    bundle: Path,
    material: str,
    world: str | None,
    letter: str,
    reach_m: float = REACH_M,
    actions: int | None = None,
    seed: int | None = None,
) -> ClayCommission:
    """What a command asks for.

    Args:
        world: the studio's; by default the one of the material's name.

    Raises:
        BundleError: the bundle is refused.
        ConfigError: it has no push model of that material.
        GoalError: the letter cannot be drawn.
    """
    opened = open_bundle(bundle)
    _clay_of(opened, material)
    sunken_letters(letter, (32, 32), _SHARE, 0.0)  # a slip leaves no folder behind
    return ClayCommission(
        str(bundle.resolve()), opened.digest, material, world or material, letter, reach_m,
        ACTIONS if actions is None else actions, _PLANNER.seed if seed is None else seed,
    )  # fmt: skip


def run_sculpture(
    commission: ClayCommission, folder: Path, resume: bool, control: Control, shown: Shown
) -> SculptureState:
    """Begin a sculpture in a folder, or go on with it: scan, plan, push, scan, replan; the state in which it ends.

    What is known is on disk before and after every push. Killed between two pushes, it goes on as if nothing had
    happened. A push of which nobody knows how far it went is not recorded: the clay is scanned, and planned anew.

    Raises:
        PentimentoError, OSError: what does not fit together, before anything moves; the guard or the robot refused.
    """
    bundle = open_bundle(Path(commission.bundle), commission.digest)
    name = _clay_of(bundle, commission.material)
    facts = bundle.manifest.clays[name]
    if resume and has_sculpture(folder) and load_sculpture(folder).stopped is not None:
        return load_sculpture(folder)
    if not resume:
        write_commission(folder, commission)
    with alone_in(folder):
        end_effector = load_end_effector(bundle.folder / "end_effectors" / f"{facts.end_effector}.toml")
        studio = virtual_sculpting_robot(commission.world, facts.shape[1], commission.seed)
        journaled = JournaledClay(studio, folder / JOURNAL, lambda _: end_effector)
        try:
            robot = GuardedSculptingRobot(journaled, push_envelope_for(end_effector, journaled.area_m))
            clay = GraphClay(Graphs(bundle), name, facts)
            return _sculpted(commission, folder, robot, end_effector, clay, control, shown)
        finally:
            journaled.close()


def _sculpted(
    commission: ClayCommission,
    folder: Path,
    robot: SculptingRobot,
    end_effector: EndEffector,
    clay: GraphClay,
    control: Control,
    shown: Shown,
) -> SculptureState:
    there = load_sculpture(folder) if has_sculpture(folder) else None
    sessions = there.sessions + 1 if there else 1
    if there is not None:
        goal = there.goal_m
    else:
        robot.change_tool(end_effector)
        goal = _goal(commission, seen_m(robot.scan())[0], robot.area_m)
    sculptor = Sculptor(
        robot, end_effector, commission.material, goal, (clay,), replace(_PLANNER, seed=commission.seed), _EXECUTION,
        commission.actions, Session(f"sculpture-{commission.material}-{commission.seed}-{sessions}", 0.0), 0,
    )  # fmt: skip
    progress = sculptor.begin()[0] if there is None else there.progress
    if progress.pushing:
        progress = sculptor.look_again(progress)

    def keep(now: Progress, row: dict[str, Any] | None) -> None:
        if row is not None:
            _record(folder, row)
            shown.step("push", len(now.actions), commission.actions, f"error {now.values[-1]:.4f}")
        save_sculpture(folder, SculptureState(goal, now, sessions, None))
        if not now.pushing and control.heard() == "stop":
            raise Ended(f"Stopped after {len(now.actions)} pushes. Go on with: pentimento run --resume {folder}")

    keep(progress, None)
    progress, stopped = sculptor.carry_on(progress, keep)
    _sum_up(folder, sculptor, progress, stopped)
    state = SculptureState(goal, progress, sessions, stopped)
    save_sculpture(folder, state)  # last: what is done is whole
    return state


def _clay_of(bundle: Bundle, material: str) -> str:
    """The name of a material's graphs."""
    name = f"clay_{material}"
    if name not in bundle.manifest.clays:
        there = ", ".join(sorted(clay.removeprefix("clay_") for clay in bundle.manifest.clays)) or "none"
        raise ConfigError(f"The bundle has no push model of {material!r}; it has: {there}. Choose one with --material.")
    return name


def _goal(commission: ClayCommission, height_m: Array, area_m: tuple[float, float]) -> Array:
    shape = (height_m.shape[0], height_m.shape[1])
    relief = sunken_letters(commission.letter, shape, _SHARE, _SOFTEN_M * shape[1] / area_m[0])
    return fit_goal(relief, height_m, replace(_GOAL, reach_m=commission.reach_m)).height_m


def _record(folder: Path, row: dict[str, Any]) -> None:
    """Write a row of the ``pushes`` contract as the next shard of the record."""
    schema = arrow_schema(CONTRACT, include_optional=set(row))
    for name in sorted(row.keys() - set(schema.names)):
        schema = schema.append(pa.field(name, pa.float32()))  # covariates of the room's sensors
    written = io.BytesIO()
    pq.write_table(pa.Table.from_pylist([row], schema=schema), written, compression="zstd")
    there = len(list((folder / RECORD).glob("part-*.parquet")))
    atomic_write(folder / RECORD / f"part-{there:05d}.parquet", written.getvalue())


def _sum_up(folder: Path, sculptor: Sculptor, progress: Progress, stopped: str) -> None:
    """Write what came of it."""
    maps = (progress.heights_m[0], sculptor.goal_m, progress.heights_m[-1])
    for name, heights in zip(HEIGHTS, maps, strict=True):
        atomic_write(folder / f"{name}.png", encode_height_png(heights, HEIGHT_PER_UNIT_M))
    objective, ends = sculptor.foresight.objective, np.stack([maps[0], maps[2]])
    error, slope = objective.error_3d_mm2(ends).tolist(), objective.visual_error(ends).tolist()
    told = {
        "actions": len(progress.actions),
        "stopped": stopped,
        "error_3d_mm2": {"before": error[0], "after": error[1]},
        "visual_error": {"before": slope[0], "after": slope[1]},
        "holes_filled": progress.holes,
    }
    atomic_write(folder / SUMMARY, (json.dumps(told, indent=2) + "\n").encode())
