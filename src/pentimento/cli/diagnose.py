"""`pentimento diagnose`."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pentimento.cli.workshop import workshop
from pentimento.contracts.errors import ConfigError

if TYPE_CHECKING:
    import pyarrow as pa

    from pentimento.contracts.tables import CheckedTable
    from pentimento.diagnosis.strokes.diagnose import Diagnosis

_KINDS = ("strokes", "pushes")


def add(commands: Any, seed: Callable[[str], int]) -> None:
    """The subcommand ``diagnose``; see README, "What the simulation gets wrong". ``seed`` parses its option."""
    diagnose = commands.add_parser(
        "diagnose",
        help="what a simulation gets wrong about measured strokes or pushes, and why (needs pentimento[train])",
    )
    diagnose.add_argument(
        "rows", type=Path, help="a table in the strokes or the pushes contract: a file, or a folder of shards"
    )
    diagnose.add_argument("--out", required=True, type=Path, help="folder for verdict.json, report.html and more")
    diagnose.add_argument("--kind", choices=_KINDS, help="what the rows are; by default told by the table's columns")
    diagnose.add_argument(
        "--base", type=Path, metavar="FILE",
        help="parameters.json of a stroke model, whose error is told beside that of the finder's own base",
    )  # fmt: skip
    diagnose.add_argument(
        "--test", type=Path, help="an outside table, on which the share of the gap that is closed is measured, too"
    )
    diagnose.add_argument(
        "--collect", type=int, default=0, metavar="ROUNDS",
        help="while an established cause has rivals, let the studio's robot make the strokes that tell them apart and "
        "diagnose again: at most so many times",
    )  # fmt: skip
    diagnose.add_argument(
        "--world", help="the studio's world for --collect: a name or a TOML file; by default named like the tool"
    )
    diagnose.add_argument("--seed", type=seed, default=0, help="of splits, bootstraps and the studio")
    diagnose.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> None:
    if (arguments.kind or _kind_of(arguments.rows)) == "pushes":
        _diagnose_pushes(arguments)
    else:
        _diagnose_strokes(arguments)


def _kind_of(rows: Path) -> str:
    """What a table holds, by its columns; one that cannot be read is left to its reader, who says why."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    files = sorted(rows.glob("*.parquet")) if rows.is_dir() else [rows]
    try:
        columns = pq.read_schema(files[0]).names if files else []
    except (OSError, pa.ArrowException):
        columns = []
    return "pushes" if "action" in columns and "path" not in columns else "strokes"


def _diagnose_pushes(arguments: argparse.Namespace) -> None:
    from pentimento.contracts.pushes import CONTRACT
    from pentimento.contracts.tables import read_table

    given = {"--base": arguments.base, "--collect": arguments.collect, "--world": arguments.world}
    if strange := [name for name, value in given.items() if value]:
        raise ConfigError(f"{', '.join(strange)} is for strokes, and {arguments.rows} holds pushes; leave it out.")
    with workshop("diagnose"):
        from pentimento.diagnosis.pushes.write import write_push_diagnosis
    checked = read_table(arguments.rows, CONTRACT)
    outside = None if arguments.test is None else read_table(arguments.test, CONTRACT).table
    write_push_diagnosis(checked.table, arguments.out, arguments.seed, _progress, outside, _left_out(checked))
    print(json.loads((arguments.out / "verdict.json").read_text())["sentence"])
    print(f"The report is {arguments.out / 'report.html'}.")


def _left_out(checked: CheckedTable) -> str | None:
    """What the contract's check left out, as a sentence."""
    if not checked.quarantined:
        return None
    reasons = "; ".join(f"row {bad.row}: {bad.reason}" for bad in checked.quarantined[:8])
    return f"{len(checked.quarantined)} rows break the contract and are left out ({reasons})."


def _diagnose_strokes(arguments: argparse.Namespace) -> None:
    from pentimento.contracts.strokes import CONTRACT
    from pentimento.contracts.tables import read_table

    with workshop("diagnose"):
        from pentimento.diagnosis.strokes.write import diagnose_in_rounds, write_diagnosis
        from pentimento.dynamics.strokes.traj2stroke import read_parameters
    checked = read_table(arguments.rows, CONTRACT)
    given = None if arguments.base is None else read_parameters(arguments.base)
    outside = None if arguments.test is None else read_table(arguments.test, CONTRACT).table

    def diagnosed(table: pa.Table, added: str | None) -> Diagnosis:
        notes = [line for line in (_left_out(checked), added) if line]
        found = write_diagnosis(
            table, arguments.out, arguments.seed, _progress, outside, " ".join(notes) or None, given
        )
        print(json.loads((arguments.out / "verdict.json").read_text())["sentence"])
        return found

    if arguments.collect:
        made = _robot_in(arguments.world, checked.table, arguments.seed)
        diagnose_in_rounds(checked.table, arguments.out, arguments.collect, diagnosed, made, print)
    else:
        diagnosed(checked.table, None)
    print(f"The report is {arguments.out / 'report.html'}.")


def _robot_in(world: str | None, table: pa.Table, seed: int) -> Callable[[pa.Table, pa.Table, int], pa.Table]:
    """A robot in the studio with the tool that made a table's strokes, as what makes proposed actions."""
    import numpy as np

    from pentimento.collection.follow import follow, tool_of
    from pentimento.contracts.covariates import drawn_length_m
    from pentimento.control.guard import GuardedRobot
    from pentimento.control.safety import envelope_for
    from pentimento.robots.tools import load_tool
    from pentimento.robots.virtual import VirtualRobot
    from pentimento.studio.studio import Studio
    from pentimento.studio.world import load_world

    tool = load_tool(tool_of(table))
    robot = VirtualRobot(Studio(load_world(world or tool.name), seed))
    guarded = GuardedRobot(robot, envelope_for(tool, robot.canvas_size_m))
    guarded.change_tool(tool)

    drawn_m = 0.0

    def made(actions: pa.Table, recorded: pa.Table, number: int) -> pa.Table:
        nonlocal drawn_m
        rows = follow(guarded, tool, actions, recorded, f"{tool.name}-{seed}-round-{number}", drawn_m)
        drawn_m += sum(drawn_length_m(np.array(path)) for path in rows["path"].to_pylist())
        return rows

    return made


def _progress(line: str) -> None:
    """For a person at a terminal; a log needs the verdict alone."""
    if sys.stderr.isatty():
        print(line, file=sys.stderr)
