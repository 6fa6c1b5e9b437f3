"""The command `pentimento`. Each subcommand imports what it needs when it runs."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from pentimento.cli import diagnose, new, recordings
from pentimento.contracts.errors import ConfigError, ContractError, PentimentoError


def main(arguments: list[str] | None = None) -> int:
    """Run a subcommand; 0, or 1 with a sentence on stderr."""
    parser = argparse.ArgumentParser(prog="pentimento", description="Robots that learn their own brushes.")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    diagnose.add(commands, _seed)
    _add_run(commands)
    _add_calibrate(commands)
    recordings.add(commands, _seed)
    new.add(commands)
    chosen = parser.parse_args(arguments)
    if chosen.run is diagnose.run and (chosen.collect < 0 or (chosen.world is not None and chosen.collect == 0)):
        parser.error("--collect takes a number of rounds, 1 or more, and --world needs it.")
    if chosen.run is _run and (chosen.bundle is None) == (chosen.resume is None):
        parser.error("give a bundle to begin a painting, or --resume FOLDER to go on with one.")
    if chosen.run is _run and chosen.bundle is not None and chosen.out is None:
        parser.error("--out FOLDER says where the painting is kept.")
    if chosen.run is _run and chosen.resume is not None and (given := _of_a_new_painting(chosen)):
        parser.error(f"--resume goes on as the painting was begun, and cannot change {', '.join(given)}; leave it out.")
    if chosen.run is _run and (wrong := _wrong_of_clay(chosen)):
        parser.error(wrong)
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
    run.add_argument("--material", help="sculpt this clay of the bundle, in the studio, instead of painting")
    run.add_argument("--letter", metavar="LETTERS", help="sink this into the clay")
    run.add_argument("--pushes", type=_count, metavar="N", help="into the clay, at most; by default 60")
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
    from pentimento.cli.calibrate import calibrate_rig, told, write_prints, yes_at_terminal
    from pentimento.robots.hardware import ask_at_terminal
    from pentimento.robots.rig import load_rig

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


_OF_CLAY = ("material", "letter", "pushes")
_OF_PAINT = ("robot", "setting", "goal_image", "goal_text", "strokes", "batch", "execute", "page")


def _wrong_of_clay(chosen: argparse.Namespace) -> str | None:
    """What does not go together when clay is sculpted: there is no driver but the studio's, and no page."""
    given = [f"--{name.replace('_', '-')}" for name in _OF_CLAY if getattr(chosen, name) is not None]
    if not given:
        return None
    if chosen.material is None or chosen.letter is None:
        return f"{', '.join(given)}: to sculpt, give both --material and --letter."
    painted = [f"--{name.replace('_', '-')}" for name in _OF_PAINT if getattr(chosen, name) not in (None, False)]
    return f"clay is sculpted in the studio, without {', '.join(painted)}; leave it out." if painted else None


def _of_a_new_painting(chosen: argparse.Namespace) -> list[str]:
    """The options given that say how a painting is begun."""
    names = ("robot", "setting", "goal_image", "goal_text", "strokes", "batch", "seed", "out", "execute", *_OF_CLAY)
    return [f"--{name.replace('_', '-')}" for name in names if getattr(chosen, name) not in (None, False)]


def _sentence(error: BaseException) -> str:
    """What an error says; of the system's own, which file (where it names one) and why, without its number."""
    if isinstance(error, OSError) and error.strerror:
        return f"{error.strerror}." if error.filename is None else f"{error.filename}: {error.strerror}."
    return str(error) or "interrupted."


def _whole(text: str, minimum: int) -> int:
    try:
        number = int(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number") from error
    if number < minimum:
        raise argparse.ArgumentTypeError(f"{number} is less than {minimum}")
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


def _sculpt(arguments: argparse.Namespace) -> None:
    from pentimento.control.commission import read_clay_commission
    from pentimento.control.person import Control, Progress, at_terminal, ended_by_signal
    from pentimento.control.run_sculpture import clay_commission_of, run_sculpture

    folder: Path = arguments.out if arguments.resume is None else arguments.resume
    commission = read_clay_commission(folder) if arguments.resume is not None else None
    if commission is None:
        commission = clay_commission_of(
            arguments.bundle, arguments.material, arguments.letter, actions=arguments.pushes, seed=arguments.seed
        )
    control, progress = Control(), Progress()
    at_terminal(control, progress)
    with ended_by_signal():
        state = run_sculpture(
            commission, folder, resume=arguments.resume is not None, control=control, progress=progress
        )
    progress.message("")
    print(f"{len(state.progress.actions)} pushes; {state.stopped}. The sculpture is in {folder}.")


def _run(arguments: argparse.Namespace) -> None:
    from pentimento.control.checkpoint import has_state
    from pentimento.control.commission import Wanted, read_clay_commission, read_commission
    from pentimento.control.person import Control, Progress, at_terminal, ended_by_signal
    from pentimento.control.run import commission_of, run

    if arguments.material is not None or (arguments.resume is not None and read_clay_commission(arguments.resume)):
        _sculpt(arguments)
        return
    folder: Path = arguments.out if arguments.resume is None else arguments.resume
    if arguments.resume is not None:
        commission = read_commission(folder)
    else:
        picture = None if arguments.goal_image is None else Wanted("picture", str(arguments.goal_image.resolve()))
        wanted = picture or Wanted("words", arguments.goal_text or "")
        commission = commission_of(
            arguments.bundle, wanted, setting=arguments.setting, robot=arguments.robot or "virtual",
            execute=arguments.execute, strokes=arguments.strokes, batch=arguments.batch, seed=arguments.seed,
        )  # fmt: skip
    control, progress = Control(), Progress()
    keyboard = at_terminal(control, progress)
    page = _tell_address if arguments.page else None
    try:
        with ended_by_signal():
            state = run(
                commission, folder, resume=arguments.resume is not None, calibration=arguments.calibration,
                ask=keyboard.ask, page=page, control=control, progress=progress,
            )  # fmt: skip
    except (PentimentoError, OSError, KeyboardInterrupt) as error:
        if has_state(folder) and not isinstance(error, ContractError):  # what is damaged cannot be gone on with
            error.add_note(f"Go on with: pentimento run --resume {folder}")
        raise
    progress.message("")
    print(f"{state.message} The painting is in {folder}.")


if __name__ == "__main__":
    sys.exit(main())
