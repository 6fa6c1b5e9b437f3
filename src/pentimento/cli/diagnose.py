"""`pentimento diagnose`; the method is described in docs/diagnosis.md."""

from __future__ import annotations

import argparse
import importlib
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from pentimento.cli import Command, option, seed, workshop
from pentimento.contracts.atomic import atomic_write
from pentimento.contracts.errors import ConfigError

if TYPE_CHECKING:
    import pyarrow as pa

    from pentimento.contracts.tables import CheckedTable
    from pentimento.diagnosis.strokes.problem import StrokeResult


_NO_TABLES: Final = (".npz", ".npy", ".csv")
"""Endings of files that are measured, and no Parquet."""


def _run(arguments: argparse.Namespace) -> None:
    if arguments.problem is not None:
        _diagnose_problem(arguments)
    elif arguments.rows.suffix.lower() in _NO_TABLES:
        raise ConfigError(
            f"{arguments.rows} is no table of strokes or pushes. For a simulator of your own, add --problem "
            "MODULE:FUNCTION (docs/diagnose_your_simulator.md); recorded strokes become a table by `pentimento import`."
        )
    elif (arguments.kind or _kind_of(arguments.rows)) == "pushes":
        _diagnose_pushes(arguments)
    else:
        _diagnose_strokes(arguments)


def _kind_of(rows: Path) -> str:
    """Tell a table's contract by its columns. An unreadable table counts as strokes: its reader reports the error."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    from pentimento.contracts.tables import parquet_files

    files = parquet_files(rows)
    try:
        columns = pq.read_schema(files[0]).names if files else []
    except (OSError, pa.ArrowException):
        columns = []
    return "pushes" if "action" in columns and "path" not in columns else "strokes"


def _diagnose_pushes(arguments: argparse.Namespace) -> None:
    from pentimento.contracts.pushes import CONTRACT
    from pentimento.contracts.tables import read_table

    if arguments.base or arguments.collect or arguments.world:
        options = ", ".join(f"--{name}" for name in ("base", "collect", "world") if getattr(arguments, name))
        raise ConfigError(f"{options} is for strokes, and {arguments.rows} holds pushes; leave it out.")
    with workshop("diagnose"):
        from pentimento.diagnosis.pushes.write import write_push_diagnosis
    checked = read_table(arguments.rows, CONTRACT)
    outside = None if arguments.test is None else read_table(arguments.test, CONTRACT).table
    write_push_diagnosis(
        checked.table, arguments.out, arguments.seed, log=_progress, outside=outside, left_out=_left_out(checked)
    )
    print(json.loads((arguments.out / "verdict.json").read_text(encoding="utf-8"))["text"])
    print(f"The report is {arguments.out / 'report.html'}.")


def _diagnose_problem(arguments: argparse.Namespace) -> None:
    """Diagnose a simulator of the user's own (docs/diagnose_your_simulator.md)."""
    with workshop("diagnose"):
        from pentimento.diagnosis.diagnose import diagnose
        from pentimento.diagnosis.splits import few_actions
        from pentimento.diagnosis.verdict import verdict
    problem = _factory(arguments.problem)(arguments.rows, arguments.seed)
    found = diagnose(problem, seed=arguments.seed, log=_progress)
    warning = few_actions(problem.rows)
    if warning is not None:
        print(warning, file=sys.stderr)
    content = verdict(found, notes=() if warning is None else (warning,))
    atomic_write(arguments.out / "verdict.json", (json.dumps(content, indent=1) + "\n").encode())
    print(content["text"])
    print(f"The verdict is {arguments.out / 'verdict.json'}.")


def _factory(name: str) -> Callable[[Path, int], Any]:
    """The function `module:function`, from the current folder or an installed package.

    Raises:
        ConfigError: it cannot be found.
    """
    module, _, function = name.partition(":")
    if not module or not function:
        raise ConfigError(f"--problem {name} is not of the form module:function, such as my_arm:problem.")
    if module.endswith(".py") or len(Path(module).parts) > 1:
        raise ConfigError(f"--problem {name} names a file; {_as_module(Path(module), function)}.")
    sys.path.insert(0, str(Path.cwd()))
    try:
        found = getattr(importlib.import_module(module), function, None)
    except ModuleNotFoundError as error:
        raise ConfigError(
            f"--problem {name} cannot be imported: {error}. Modules are looked up from the current folder, "
            f"{Path.cwd()}."
        ) from error
    if not callable(found):
        raise ConfigError(f"--problem {name}: the module {module} has no function {function}.")
    return found


def _as_module(file: Path, function: str) -> str:
    """What to write instead of a file, in words."""
    file = file.resolve().with_suffix("")
    if file.is_relative_to(Path.cwd()):
        dotted = ".".join(file.relative_to(Path.cwd()).parts)
        return f"write --problem {dotted}:{function}, from the current folder"
    return f"go to {file.parent} and write --problem {file.name}:{function}"


def _left_out(checked: CheckedTable) -> str | None:
    """Describe the quarantined rows in a sentence."""
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

    def diagnosed(table: pa.Table, added: str | None) -> StrokeResult:
        notes = [line for line in (_left_out(checked), added) if line]
        found = write_diagnosis(
            table,
            arguments.out,
            arguments.seed,
            log=_progress,
            outside=outside,
            left_out=" ".join(notes) or None,
            given=given,
        )
        print(json.loads((arguments.out / "verdict.json").read_text(encoding="utf-8"))["text"])
        return found

    if arguments.collect:
        execute = _robot_in(arguments.world, checked.table, arguments.seed)
        diagnose_in_rounds(
            checked.table, arguments.out, arguments.collect, diagnosed=diagnosed, made=execute, log=print
        )
    else:
        diagnosed(checked.table, None)
    print(f"The report is {arguments.out / 'report.html'}.")


def _robot_in(world: str | None, table: pa.Table, seed: int) -> Callable[[pa.Table, pa.Table, int], pa.Table]:
    """Return a function that lets the studio's robot execute proposed actions with the tool of the table's strokes."""
    from pentimento.collection.follow import further_strokes, tool_of
    from pentimento.control.guard import GuardedRobot
    from pentimento.control.safety import envelope_for
    from pentimento.robots.tools import load_tool
    from pentimento.robots.virtual import VirtualRobot
    from pentimento.studio.strokes.studio import Studio
    from pentimento.studio.strokes.world import load_world

    tool = load_tool(tool_of(table))
    robot = VirtualRobot(Studio(load_world(world or tool.name), seed))
    guarded = GuardedRobot(robot, envelope_for(tool, robot.canvas_size_m))
    guarded.change_tool(tool)
    return further_strokes(guarded, tool, f"{tool.name}-{seed}")


def _progress(line: str) -> None:
    """Print progress if the output is a terminal; a log gets only the verdict."""
    if sys.stderr.isatty():
        print(line, file=sys.stderr)


def _problem(arguments: argparse.Namespace) -> str | None:
    for_tables = ("kind", "base", "test", "collect", "world")
    if arguments.problem is not None and (given := [f"--{n}" for n in for_tables if getattr(arguments, n)]):
        return f"{', '.join(given)} is for strokes or pushes; leave it out with --problem."
    if arguments.collect < 0 or (arguments.world is not None and arguments.collect == 0):
        return "--collect takes a number of rounds, 1 or more, and --world needs it."
    return None


COMMAND = Command(
    "diagnose",
    "what a simulation gets wrong about measured strokes or pushes, and why (needs pentimento[train])",
    (
        option(
            "rows",
            type=Path,
            help="a table in the strokes or the pushes contract: a file or a folder of shards; any file with --problem",
        ),
        option(
            "--out",
            required=True,
            type=Path,
            help="folder for verdict.json and, without --problem, report.html and more",
        ),
        option("--kind", choices=("strokes", "pushes"), help="what the rows are; by default by the table's columns"),
        option(
            "--problem",
            metavar="MODULE:FUNCTION",
            help="a simulator of your own: a function of the file and the seed that returns its problem "
            "(docs/diagnose_your_simulator.md)",
        ),
        option(
            "--base",
            type=Path,
            metavar="FILE",
            help="parameters.json of a stroke model, whose error is reported, too",
        ),
        option("--test", type=Path, help="another table, on which the fraction of the gap closed is measured, too"),
        option(
            "--collect",
            type=int,
            default=0,
            metavar="ROUNDS",
            help="maximum number of rounds in which the studio's robot makes strokes that distinguish a named cause "
            "from its rivals, before the diagnosis is repeated",
        ),
        option("--world", help="the studio's world for --collect: a name or a TOML file; by default the tool's name"),
        option("--seed", type=seed, default=0, help="of splits, bootstraps and the studio"),
    ),
    _run,
    _problem,
)
