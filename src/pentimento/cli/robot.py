"""`pentimento run`, `studio`, `replay` and `calibrate`; see docs/running.md and docs/on_a_robot.md."""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pentimento.cli import Command, count, given, length, option, seed, words
from pentimento.contracts.codec import from_plain
from pentimento.contracts.errors import ConfigError, ContractError, PentimentoError

if TYPE_CHECKING:
    from pentimento.control.commission import ClayGoal, Commission, Weights
    from pentimento.control.expression import Expression
    from pentimento.control.run import Turns

_CLAY_GOALS = ("letter", "goal_mesh", "goal_heights")  # and goal_image, which painting has as well
_OF_CLAY = ("material", *_CLAY_GOALS, "font", "up", "raised", "pushes", "scan_pixels")
_OF_PAINT = (
    "setting",
    "goal_image",
    "goal_svg",
    "goal_text",
    "listen",
    "sound_model",
    "as_typed",
    "strokes",
    "replan_every",
    "weights",
    "hand",
    "page",
    "turns",
    "choices",
)
_OF_A_PLAN = ("strokes", "weights", "hand")
_STUDIO_CHOICES = 3  # goals to choose from
_NOT_OF_CLAY = "clay is sculpted without {}; leave it out."
_OF_A_NEW_RUN = (
    "robot",
    "setting",
    "goal_image",
    "goal_svg",
    "strokes",
    "replan_every",
    "weights",
    "hand",
    "seed",
    "out",
    "execute",
    *_OF_CLAY,
)


def _run(arguments: argparse.Namespace) -> None:
    from pentimento.cli.listening import confirmed, expression_for, heard_in
    from pentimento.control.commission import Wanted, read_clay_commission, read_commission
    from pentimento.control.expression import PLAIN
    from pentimento.control.request_items import plain_text
    from pentimento.control.run import Turns, commission_of

    if arguments.material is not None or (arguments.resume is not None and read_clay_commission(arguments.resume)):
        if paint := _not_of_clay(arguments):
            raise ConfigError(_NOT_OF_CLAY.format(", ".join(paint)))
        _sculpt(arguments)
        return
    folder: Path = arguments.out if arguments.resume is None else arguments.resume
    commission = None if arguments.resume is None else read_commission(folder)
    bundle: Path = arguments.bundle if commission is None else Path(commission.bundle)
    # Without any goal the canvas is completed; words that were given and are empty are a mistake.
    text = "" if arguments.goal_text is None else plain_text(arguments.goal_text)
    heard, expression = None, PLAIN
    if arguments.listen is not None:
        heard = heard_in(arguments.listen, bundle, arguments.sound_model)
        text = heard.words
        _tell(f"Heard: {text}")
    if commission is None:
        wanted = Wanted("words", text)
        if arguments.goal_image is not None:
            wanted = Wanted("picture", str(arguments.goal_image.resolve()))
        if arguments.goal_svg is not None:
            wanted = Wanted("drawing", str(arguments.goal_svg.resolve()))
        commission = commission_of(
            bundle, wanted, tell=_tell, setting=arguments.setting,
            robot=arguments.robot or "virtual", execute=arguments.execute, strokes=arguments.strokes,
            replan_every=arguments.replan_every, seed=arguments.seed, weights=_weights(arguments.weights),
            hand=arguments.hand,
        )  # fmt: skip
    if heard is not None:
        if heard.manner is not None and not arguments.as_typed:
            expression = expression_for(heard, bundle, commission.setting)
            _tell(expression.sentence())
        if not confirmed(is_at_terminal=sys.stdin.isatty(), executes=commission.execute):
            _tell("Nothing was painted.")
            return
    if arguments.resume is None:
        commission = replace(commission, expression=expression)
    turns = Turns(arguments.turns, arguments.choices or 1)
    if turns.in_turns and not (arguments.page or sys.stdin.isatty()):
        raise ConfigError(
            "With --turns the robot waits for a person, and nobody can say whose turn it is: there is no terminal and "
            "no page. Start it at a terminal, or give --page."
        )
    wish = text if arguments.resume is not None else ""
    _paint(
        commission, folder, calibration=arguments.calibration, has_page=arguments.page, turns=turns, wish=wish,
        expression=expression, resume=arguments.resume is not None, sound_model=arguments.sound_model,
    )  # fmt: skip


def _weights(text: str | None) -> Weights | None:
    """The weights of objectives in "print=1,semantic=0.3,text=0.1"; those that are left out are 0.

    Raises:
        ConfigError: the text says something else.
    """
    from pentimento.control.commission import Weights

    if text is None:
        return None
    pairs = [part.partition("=")[::2] for part in text.split(",")]
    try:
        found = {name.strip(): float(value) for name, value in pairs}
        return from_plain(Weights, dict.fromkeys(("print", "semantic", "text"), 0.0) | found, "--weights", ConfigError)
    except ValueError as error:
        raise ConfigError(
            f"--weights is {text!r}; give weights of print, semantic and text, such as print=1,semantic=0.3."
        ) from error


def _paint(
    commission: Commission,
    folder: Path,
    *,
    calibration: Path,
    has_page: bool,
    turns: Turns,
    wish: str = "",
    expression: Expression | None = None,
    resume: bool = False,
    sound_model: Path | None = None,
) -> None:
    """Paint, and print how it ended and how to go on."""
    from pentimento.cli.listening import page_listener
    from pentimento.control.checkpoint import has_state
    from pentimento.control.expression import PLAIN
    from pentimento.control.person import Control, Progress, at_terminal, ended_by_signal
    from pentimento.control.pictures import PHOTOGRAPH
    from pentimento.control.run import run

    control, progress = Control(), Progress()
    keyboard = at_terminal(control, progress)
    go_on = f"pentimento run --resume {folder}"
    if turns.in_turns:
        go_on += f" --turns --choices {turns.choices}" + (" --page" if has_page else "")
    try:
        with ended_by_signal():
            state = run(
                commission, folder, resume=resume, calibration=calibration, ask=keyboard.ask,
                page=_print_address if has_page else None, control=control, progress=progress, turns=turns, wish=wish,
                expression=expression or PLAIN,
                listen=page_listener(Path(commission.bundle), commission.setting, sound_model) if has_page else None,
            )  # fmt: skip
    except (PentimentoError, OSError, KeyboardInterrupt) as error:
        if has_state(folder) and not isinstance(error, ContractError):  # a damaged state cannot be resumed
            error.add_note(f"Go on with: {go_on}")
        raise
    progress.message("")
    print(f"{state.message} The painting is in {folder / PHOTOGRAPH}.")
    if turns.in_turns:
        print(f"Go on with: {go_on}")


def _studio(arguments: argparse.Namespace) -> None:
    from pentimento.control.commission import Wanted
    from pentimento.control.run import Turns, commission_of

    folder: Path = arguments.out or Path("paintings") / time.strftime("%Y-%m-%d_%H-%M-%S")
    commission = commission_of(
        arguments.bundle, Wanted("words", ""), tell=_tell, setting=arguments.setting, strokes=arguments.strokes,
        seed=arguments.seed,
    )  # fmt: skip
    _paint(
        commission, folder, calibration=Path("calibration"), has_page=True, sound_model=arguments.sound_model,
        turns=Turns(in_turns=True, choices=_STUDIO_CHOICES),
    )  # fmt: skip


def _replay(arguments: argparse.Namespace) -> None:
    from pentimento.contracts.atomic import command_page
    from pentimento.control.checkpoint import has_sculpture
    from pentimento.control.replay import REPLAY, replay_page

    if has_sculpture(arguments.folder):
        from pentimento.control.run_sculpture import PICTURE, PREVIEW

        raise ConfigError(
            f"{arguments.folder} is a sculpture, and a replay shows a painting. The sculpture's pictures are "
            f"{arguments.folder / PREVIEW} and, at its end, {arguments.folder / PICTURE}."
        )
    place = arguments.out or arguments.folder / REPLAY
    command_page(place, replay_page(arguments.folder), "pentimento replay")
    print(f"The replay is {place}; open it in a browser.")


def _sculpt(arguments: argparse.Namespace) -> None:
    from pentimento.control.checkpoint import has_sculpture
    from pentimento.control.commission import read_clay_commission
    from pentimento.control.person import Control, Progress, at_terminal, ended_by_signal
    from pentimento.control.run_sculpture import PICTURE, Ended, clay_commission_of, run_sculpture

    folder: Path = arguments.out if arguments.resume is None else arguments.resume
    commission = read_clay_commission(folder) if arguments.resume is not None else None
    if commission is None:
        commission = clay_commission_of(
            arguments.bundle, arguments.material, _clay_goal(arguments), actions=arguments.pushes, seed=arguments.seed,
            raised_m=0.0 if arguments.raised is None else arguments.raised, scan_pixels=arguments.scan_pixels,
            robot=arguments.robot or "virtual", execute=arguments.execute,
        )  # fmt: skip
    control, progress = Control(), Progress()
    keyboard = at_terminal(control, progress)
    try:
        with ended_by_signal():
            state = run_sculpture(
                commission, folder, resume=arguments.resume is not None, control=control, progress=progress,
                calibration=arguments.calibration, ask=keyboard.ask,
            )  # fmt: skip
    except (PentimentoError, OSError, KeyboardInterrupt) as error:
        if has_sculpture(folder) and not isinstance(error, ContractError | Ended):
            error.add_note(f"Go on with: pentimento run --resume {folder}")
        raise
    progress.message("")
    made = len(state.progress.actions)
    print(f"{made} push{'' if made == 1 else 'es'}; {state.stopped}. The sculpture is in {folder / PICTURE}.")


def _bundle(arguments: argparse.Namespace) -> None:
    from pentimento.bundle.reader import open_bundle

    opened = open_bundle(arguments.bundle)
    manifest = opened.manifest
    print(f"{arguments.bundle} is whole: {len(manifest.files)} files, digest {opened.digest[:12]}.")
    for name, setting in manifest.settings.items():
        across, along = (f"{1e3 * side:.0f}" for side in setting.canvas_m)
        print(f"--setting {name}: {Path(setting.tool).stem}, {across} x {along} mm, up to {setting.strokes} strokes")
    for name, clay in manifest.clays.items():
        print(f"--material {name.removeprefix('clay_')}: {clay.end_effector}, {clay.kind}es")
    for name in manifest.hands:
        print(f"--hand {name}")
    print(f'Begin with: pentimento run {arguments.bundle} --goal-text "a sun" --out sun')


def _clay_goal(arguments: argparse.Namespace) -> ClayGoal:
    from pentimento.control.commission import ClayGoal

    if arguments.letter is not None:
        font = None if arguments.font is None else str(arguments.font.resolve())
        return ClayGoal("letter", arguments.letter, font=font)
    if arguments.goal_mesh is not None:
        return ClayGoal("mesh", str(arguments.goal_mesh.resolve()), up=arguments.up)
    if arguments.goal_heights is not None:
        return ClayGoal("heights", str(arguments.goal_heights.resolve()))
    return ClayGoal("image", str(arguments.goal_image.resolve()))


def _tell(message: str) -> None:
    print(message, flush=True)


def _print_address(address: str) -> None:
    print(f"The page is {address}", flush=True)


def _problem_of_run(arguments: argparse.Namespace) -> str | None:
    if arguments.bundle is not None and arguments.resume is not None:
        return "--resume knows the bundle; leave it out."
    if arguments.bundle is None and arguments.resume is None:
        return "give a bundle to begin a painting, or --resume FOLDER to go on with one."
    if arguments.bundle is not None and arguments.out is None:
        return "--out FOLDER says where the painting is kept."
    if arguments.resume is not None and (fixed := given(arguments, _OF_A_NEW_RUN)):
        return f"--resume goes on as the painting was begun, and cannot change {', '.join(fixed)}; leave it out."
    if arguments.sound_model is not None and arguments.listen is None and not arguments.page:
        return "--sound-model is for what --listen FILE or the page hears; give one of them."
    if arguments.as_typed and arguments.listen is None:
        return "--as-typed is for a wish that --listen FILE hears; give that, or leave it out."
    if arguments.goal_svg is not None and (planned := given(arguments, _OF_A_PLAN)):
        return f"--goal-svg is a plan already, which {', '.join(planned)} would change; leave it out."
    clay = given(arguments, _OF_CLAY)
    if not clay:
        return None
    if arguments.material is None or not given(arguments, (*_CLAY_GOALS, "goal_image")):
        return (
            f"{', '.join(clay)}: to sculpt, give --material and a goal: --letter, --goal-mesh, --goal-heights or "
            "--goal-image."
        )
    if arguments.font is not None and arguments.letter is None:
        return "--font is for --letter; leave it out."
    if arguments.up is not None and arguments.goal_mesh is None:
        return "--up is for --goal-mesh; leave it out."
    if paint := _not_of_clay(arguments):
        return _NOT_OF_CLAY.format(", ".join(paint))
    return None


def _not_of_clay(arguments: argparse.Namespace) -> list[str]:
    """Options of painting that the command line sets and sculpting has not."""
    return [name for name in given(arguments, _OF_PAINT) if name != "--goal-image"]


def _calibrate(arguments: argparse.Namespace) -> None:
    from pentimento.cli.calibrate import calibrate_rig, residual_sentence, write_prints, yes_at_terminal
    from pentimento.robots.carrier import ask_at_terminal
    from pentimento.robots.rig import load_rig

    if arguments.kind == "prints":
        for path in write_prints(arguments.calibration, load_rig(arguments.rig).canvas_size_m):
            print(path)
        return
    try:
        found = calibrate_rig(
            arguments.rig,
            arguments.kind,
            arguments.tool,
            folder=arguments.calibration,
            ask=ask_at_terminal,
            ask_yes=yes_at_terminal,
        )
    except EOFError as error:
        raise ConfigError("A calibration needs a person's answers; run it at a terminal.") from error
    print(residual_sentence(found))


_SOUND_MODEL: dict[str, Any] = {
    "type": Path,
    "metavar": "FOLDER",
    "help": "a published model that listens instead of the embedded recogniser: Whisper (speech) or CLAP (sounds)",
}
_CALIBRATION: dict[str, Any] = {"type": Path, "default": Path("calibration"), "metavar": "FOLDER"}

COMMANDS = (
    Command(
        "bundle",
        "check a bundle, and list what `pentimento run` can do with it",
        (option("bundle", type=Path, help="its folder"),),
        _bundle,
    ),
    Command(
        "run",
        "paint beside a person from a bundle: plan, paint, look, replan",
        (
            option("bundle", type=Path, nargs="?", help="folder of a bundle, as `deploy` writes it"),
            option(
                "--robot",
                metavar="ROBOT",
                help="virtual (default; virtual:WORLD names the studio's world), svg (a drawing on file), gcode (a "
                "file), gcode:PORT (a plotter), or the name or path of a rig file",
            ),
            option(
                "--setting",
                help="of the bundle: tool, canvas and planner; by default the one whose tool brings its ink",
            ),
            option(
                "--goal-image",
                type=Path,
                metavar="FILE",
                exclusive="goal",
                help="paint this picture; with --material, sculpt it: what is light is high",
            ),
            option(
                "--goal-svg",
                type=Path,
                metavar="FILE",
                exclusive="goal",
                help="draw the lines of this SVG file as they are: the drawing is the plan",
            ),
            option(
                "--goal-text",
                type=words,
                metavar="WORDS",
                exclusive="goal",
                help="paint this; with --resume, from now on; without any goal, what is on the canvas is completed",
            ),
            option(
                "--listen",
                type=Path,
                metavar="FILE",
                exclusive="goal",
                help="as --goal-text, with the words that are spoken in this WAV file",
            ),
            option("--sound-model", **_SOUND_MODEL),
            option(
                "--as-typed",
                action="store_true",
                help="paint what --listen hears like a typed wish, however loud, fast or lively it was said",
            ),
            option("--strokes", type=count, metavar="N", help="maximum; by default the setting's"),
            option(
                "--replan-every",
                type=count,
                metavar="N",
                help="strokes between two replannings; by default the setting's",
            ),
            option(
                "--weights",
                metavar="W",
                help="of the objectives, such as print=1,semantic=0.3,text=0.1: the goal pixel by pixel, what an "
                "encoder sees in it, and the words asked for; by default the setting's",
            ),
            option(
                "--hand",
                metavar="NAME",
                help="a hand of the bundle: draw in this handwriting; by default the robot draws its own strokes",
            ),
            option(
                "--material",
                help="sculpt this clay of the bundle instead of painting, in the studio or by a rig with a scanner",
            ),
            option(
                "--letter",
                metavar="LETTERS",
                type=words,
                exclusive="goal",
                help="sink this into the clay; of any script that an installed font has",
            ),
            option(
                "--font",
                type=Path,
                metavar="FILE",
                help="font of --letter (TrueType, OpenType); by default plain strokes, else the first installed font "
                "with these letters",
            ),
            option(
                "--goal-mesh",
                type=Path,
                metavar="FILE",
                exclusive="goal",
                help="sculpt this mesh as seen from above (STL, OBJ, PLY; any unit)",
            ),
            option("--up", choices=("x", "y", "z"), help="axis of the mesh that points up; z, but an OBJ needs it"),
            option(
                "--goal-heights",
                type=Path,
                metavar="FILE",
                exclusive="goal",
                help="sculpt these heights: .npy, grey .png or .tif; NaN is a hole",
            ),
            option(
                "--raised",
                type=length,
                metavar="HEIGHT",
                help="let the goal stand this high above the clay, such as '4 mm', of pellets that are placed; by "
                "default it is sunk",
            ),
            option(
                "--pushes",
                type=count,
                metavar="N",
                help="maximum number of pushes into the clay and pellets on it; by default the bundle's",
            ),
            option(
                "--scan-pixels",
                type=count,
                metavar="N",
                help="of a scan of the clay, along its longer side, such as 512; by default as the bundle's push model",
            ),
            option("--seed", type=seed, metavar="N", help="of plan, goal and studio; by default the setting's"),
            option("--out", type=Path, metavar="FOLDER", help="a new folder for the painting"),
            option("--resume", type=Path, metavar="FOLDER", help="go on with a painting, however it ended"),
            option(
                "--execute",
                action="store_true",
                help="let hardware move, which needs a fresh calibration; without it, hardware is rehearsed in the "
                "studio",
            ),
            option("--calibration", help="of the rig (calibration)", **_CALIBRATION),
            option(
                "--turns",
                action="store_true",
                help="after its strokes the robot waits for you, who may draw and ask for something new; stop ends it",
            ),
            option(
                "--choices",
                type=count,
                metavar="N",
                choices=range(1, 5),
                help="goals to choose from when you ask for something new, at most 4; by default 1",
            ),
            option("--page", action="store_true", help="serve a page with the painting on this computer alone"),
        ),
        _run,
        _problem_of_run,
    ),
    Command(
        "studio",
        "paint on a page in turns with the studio's robot, without any hardware",
        (
            option("bundle", type=Path, help="folder of a bundle, as `deploy` writes it"),
            option("--setting", help="of the bundle; by default the one whose tool brings its ink"),
            option(
                "--strokes", type=count, metavar="N", help="maximum in a turn of the robot's; by default the setting's"
            ),
            option("--sound-model", **_SOUND_MODEL),
            option("--seed", type=seed, metavar="N", help="of plans, goals and studio; by default the setting's"),
            option("--out", type=Path, metavar="FOLDER", help="a new folder for the painting; by default its time"),
        ),
        _studio,
    ),
    Command(
        "replay",
        "the turns of a painting as one HTML file that shows its photographs one after the other",
        (
            option("folder", type=Path, metavar="FOLDER", help="of the painting"),
            option("--out", type=Path, metavar="FILE", help="by default replay.html in that folder"),
        ),
        _replay,
    ),
    Command(
        "calibrate",
        "measure a rig: its lens, canvas, colours, and where it touches",
        (
            option("rig", help="name or file of the rig"),
            option("kind", choices=("prints", "lens", "canvas", "colour", "touch"), help="in this order"),
            option("--tool", default="marker", help="for the touch: name or file of the tool in the holder"),
            option("--calibration", help="to write into", **_CALIBRATION),
        ),
        _calibrate,
    ),
)
