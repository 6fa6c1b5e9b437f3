"""The command `pentimento`. Each subcommand imports what it needs when it runs."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pentimento.contracts.errors import ConfigError, ContractError, PentimentoError

if TYPE_CHECKING:
    import pyarrow as pa

    from pentimento.contracts.tables import CheckedTable
    from pentimento.gap.diagnose import Diagnosis

_KINDS = ("strokes", "pushes")


def main(arguments: list[str] | None = None) -> int:
    """Run a subcommand; 0, or 1 with a sentence on stderr."""
    parser = argparse.ArgumentParser(prog="pentimento", description="Robots that learn their own brushes.")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
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
    diagnose.add_argument("--seed", type=_seed, default=0, help="of splits, bootstraps and the studio")
    diagnose.set_defaults(run=_diagnose)
    _add_run(commands)
    _add_calibrate(commands)
    chosen = parser.parse_args(arguments)
    if chosen.run is _diagnose and (chosen.collect < 0 or (chosen.world is not None and chosen.collect == 0)):
        parser.error("--collect takes a number of rounds, 1 or more, and --world needs it.")
    if chosen.run is _run and (chosen.bundle is None) == (chosen.resume is None):
        parser.error("give a bundle to begin a painting, or --resume FOLDER to go on with one.")
    if chosen.run is _run and chosen.bundle is not None and chosen.out is None:
        parser.error("--out FOLDER says where the painting is kept.")
    if chosen.run is _run and chosen.resume is not None and (given := _of_a_new_painting(chosen)):
        parser.error(f"--resume goes on as the painting was begun, and cannot change {', '.join(given)}; leave it out.")
    try:
        chosen.run(chosen)
    except (PentimentoError, OSError, KeyboardInterrupt) as error:
        print("\n".join([f"pentimento: {_sentence(error)}", *getattr(error, "__notes__", [])]), file=sys.stderr)
        return 130 if isinstance(error, KeyboardInterrupt) else 1
    return 0


def _add_run(commands: Any) -> None:
    """The subcommand ``run``; see docs/running.md."""
    run = commands.add_parser("run", help="paint beside a person from a bundle: plan, paint, look, replan")
    run.add_argument("bundle", type=Path, nargs="?", help="folder of a bundle, as `deploy` writes it")
    run.add_argument(
        "--robot", metavar="ROBOT",
        help="virtual (default; virtual:WORLD names the studio's world), svg (a drawing on file), gcode (a file), "
        "gcode:PORT (a plotter), or the name or path of a rig file",
    )  # fmt: skip
    run.add_argument(
        "--setting", help="of the bundle: tool, canvas and planner; by default the one whose tool brings its ink"
    )
    goal = run.add_mutually_exclusive_group()
    goal.add_argument("--goal-image", type=Path, metavar="FILE", help="paint this picture")
    goal.add_argument(
        "--goal-text",
        type=_words,
        metavar="WORDS",
        help="paint this; without any goal, what is on the canvas is completed",
    )
    run.add_argument("--strokes", type=_count, metavar="N", help="at most; by default the setting's")
    run.add_argument(
        "--batch", type=_count, metavar="N", help="strokes between two replannings; by default the setting's"
    )
    run.add_argument("--seed", type=_seed, metavar="N", help="of plan, goal and studio; by default the setting's")
    run.add_argument("--out", type=Path, metavar="FOLDER", help="a new folder for the painting")
    run.add_argument("--resume", type=Path, metavar="FOLDER", help="go on with a painting, however it ended")
    run.add_argument(
        "--execute", action="store_true",
        help="let hardware move, which needs a fresh calibration; without it, hardware is rehearsed in the studio",
    )  # fmt: skip
    run.add_argument(
        "--calibration", type=Path, default=Path("calibration"), metavar="FOLDER", help="of the rig (calibration)"
    )
    run.add_argument("--page", action="store_true", help="serve a page with the painting on this computer alone")
    run.set_defaults(run=_run)


def _add_calibrate(commands: Any) -> None:
    """The subcommand ``calibrate``; see docs/on_a_robot.md."""
    calibrate = commands.add_parser("calibrate", help="measure a rig: its lens, canvas, colours, and where it touches")
    calibrate.add_argument("rig", help="name or file of the rig")
    calibrate.add_argument("kind", choices=("prints", "lens", "canvas", "colour", "touch"), help="in this order")
    calibrate.add_argument("--tool", default="marker", help="for the touch: name or file of the tool in the holder")
    calibrate.add_argument(
        "--calibration", type=Path, default=Path("calibration"), metavar="FOLDER", help="to write into"
    )
    calibrate.set_defaults(run=_calibrate)


def _calibrate(arguments: argparse.Namespace) -> None:
    from pentimento.robots.hardware import ask_at_terminal
    from pentimento.robots.rig import load_rig
    from pentimento.runner.calibrate_command import calibrate_rig, told, write_prints, yes_at_terminal

    if arguments.kind == "prints":
        for path in write_prints(arguments.calibration, load_rig(arguments.rig).canvas_size_m):
            print(path)
        return
    try:
        found = calibrate_rig(
            arguments.rig, arguments.kind, arguments.tool, arguments.calibration, ask_at_terminal, yes_at_terminal
        )
    except EOFError as error:
        raise ConfigError(
            "A calibration needs a person's answers, and nobody is there; run it at a terminal."
        ) from error
    print(told(found))


def _of_a_new_painting(chosen: argparse.Namespace) -> list[str]:
    """The options given that say how a painting is begun."""
    names = ("robot", "setting", "goal_image", "goal_text", "strokes", "batch", "seed", "out", "execute")
    return [f"--{name.replace('_', '-')}" for name in names if getattr(chosen, name) not in (None, False)]


def _sentence(error: BaseException) -> str:
    """What an error says; of the system's own, which file (where it names one) and why, without its number."""
    if isinstance(error, OSError) and error.strerror:
        return f"{error.strerror}." if error.filename is None else f"{error.filename}: {error.strerror}."
    return str(error) or "interrupted."


def _whole(text: str, least: int) -> int:
    try:
        number = int(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number") from error
    if number < least:
        raise argparse.ArgumentTypeError(f"{number} is less than {least}")
    return number


def _count(text: str) -> int:
    return _whole(text, 1)


def _seed(text: str) -> int:
    return _whole(text, 0)


def _words(text: str) -> str:
    try:
        text.encode()
    except UnicodeEncodeError as error:  # bytes that the terminal's encoding has no letters for
        raise argparse.ArgumentTypeError("it is not text in UTF-8") from error
    return text


def _tell_address(address: str) -> None:
    print(f"The page is {address}", flush=True)


def _run(arguments: argparse.Namespace) -> None:
    from pentimento.runner.commission import Wanted, read_commission
    from pentimento.runner.control import Control
    from pentimento.runner.keyboard import at_terminal, ended_by_signal
    from pentimento.runner.progress import Progress
    from pentimento.runner.run import commission_of, run
    from pentimento.runner.state import has_state

    folder: Path = arguments.out if arguments.resume is None else arguments.resume
    if arguments.resume is not None:
        commission = read_commission(folder)
    else:
        picture = None if arguments.goal_image is None else Wanted("picture", str(arguments.goal_image.resolve()))
        wanted = picture or Wanted("words", arguments.goal_text or "")
        commission = commission_of(
            arguments.bundle, arguments.setting, arguments.robot or "virtual", arguments.execute, wanted,
            arguments.strokes, arguments.batch, arguments.seed,
        )  # fmt: skip
    control, progress = Control(), Progress()
    keyboard = at_terminal(control, progress)
    page = _tell_address if arguments.page else None
    try:
        with ended_by_signal():
            state = run(
                commission, folder, arguments.resume is not None, arguments.calibration, keyboard.ask, page,
                control, progress,
            )  # fmt: skip
    except (PentimentoError, OSError, KeyboardInterrupt) as error:
        if has_state(folder) and not isinstance(error, ContractError):  # what is damaged cannot be gone on with
            error.add_note(f"Go on with: pentimento run --resume {folder}")
        raise
    progress.say("")
    print(f"{state.sentence} The painting is in {folder}.")


def _diagnose(arguments: argparse.Namespace) -> None:
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
    with _workshop():
        from pentimento.gap.pushes.write import write_push_diagnosis
    checked = read_table(arguments.rows, CONTRACT)
    outside = None if arguments.test is None else read_table(arguments.test, CONTRACT).table
    write_push_diagnosis(checked.table, arguments.out, arguments.seed, _progress, outside, _left_out(checked))
    print(json.loads((arguments.out / "verdict.json").read_text())["sentence"])
    print(f"The report is {arguments.out / 'report.html'}.")


@contextmanager
def _workshop() -> Iterator[None]:
    """For imports of the workshop: where it is not installed, say how to."""
    try:
        yield
    except ModuleNotFoundError as error:
        if (error.name or "").startswith("pentimento"):
            raise
        raise ConfigError(
            f"To diagnose, the workshop has to be installed, and {error.name} is missing: a robot's computer needs "
            "none of it. Where the pipeline runs, install it with: pip install '.[train]'."
        ) from error


def _left_out(checked: CheckedTable) -> str | None:
    """What the contract's check left out, as a sentence."""
    if not checked.quarantined:
        return None
    reasons = "; ".join(f"row {bad.row}: {bad.reason}" for bad in checked.quarantined[:8])
    return f"{len(checked.quarantined)} rows break the contract and are left out ({reasons})."


def _diagnose_strokes(arguments: argparse.Namespace) -> None:
    from pentimento.contracts.strokes import CONTRACT
    from pentimento.contracts.tables import read_table

    with _workshop():
        from pentimento.gap.rounds import diagnose_in_rounds
        from pentimento.gap.write import write_diagnosis
        from pentimento.stroke_dynamics.traj2stroke import read_parameters
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

    from pentimento.contracts.covariates import drawn_length_m
    from pentimento.robots.tools import load_tool
    from pentimento.robots.virtual import VirtualRobot
    from pentimento.runner.follow import follow, tool_of
    from pentimento.runner.safety import GuardedRobot, envelope_for
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


if __name__ == "__main__":
    sys.exit(main())
