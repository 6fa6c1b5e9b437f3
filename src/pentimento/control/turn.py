"""A person's turn: the person draws, asks for something new and chooses a goal; the robot waits with its tool up."""

from __future__ import annotations

import json
import shutil
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from pentimento.contracts.atomic import atomic_write
from pentimento.contracts.codec import from_plain, to_plain
from pentimento.contracts.errors import ConfigError, ContractError
from pentimento.contracts.images import write_png
from pentimento.control.checkpoint import PaintingState
from pentimento.control.drawn import drawn_strokes
from pentimento.control.expression import PLAIN, Expression
from pentimento.control.layout import Wish
from pentimento.control.loop import Interrupt
from pentimento.control.painter import as_picture, dips_of, first_plan, predict_canvas
from pentimento.control.person import Order
from pentimento.control.pictures import GOALS, PLAN, write_pictures
from pentimento.control.recording import PIXELS_PER_M
from pentimento.control.undo import check_undo, forget
from pentimento.control.workplace import PLAN_S, Proposal, Workplace
from pentimento.planning.strokes.config import no_log

TURNS: Final = "turns"
"""Folder of the canvas at each of the person's turns, with what the person asked for and the goal of it."""
FOR_A_TURN: Final = ("choose", "draw")
"""Orders that mean something at a person's turn only."""


@dataclass(frozen=True)
class Turn:
    """What is known of a turn; number 0 is the painting's start."""

    number: int
    words: str
    """What the person asked for; "" for nothing new."""
    executed_before: int
    """Number of strokes that the robot had executed."""
    planned: int
    """Number of strokes that were planned for the words."""
    things: tuple[Wish, ...] = ()
    """What was asked for, and where on the largest centred square of the canvas; empty where that is not known."""
    expression: Expression = PLAIN
    """How the words are painted."""
    lines: int = 0
    """Number of lines that the person had drawn on the page, also those that were refused."""


def take_turn(at: Workplace, state: PaintingState, order: Order) -> tuple[PaintingState, Interrupt]:
    """A person's turn from its first order until the person goes on, stops, or asks for something that is understood.

    Returns:
        The state to go on from, and whether to stop; in the phase "undoing", to undo.
    """
    while True:
        try:
            match order.command:
                case "your turn" | "pause":  # also again: the page waits for an answer to every command
                    state = at.rest(state, "your turn", f"{order.value} {_invitation(state)}".strip())
                case "stop":
                    return _end_of_turn(at, state) if _may_be_new(at, state) else state, "stop"
                case "undo":
                    check_undo(at.session.folder, state, in_studio=at.session.traits.in_studio)
                    message = "The robot's last strokes are being undone."
                    return at.checkpoint(replace(state, phase="undoing", message=message)), "stop"
                case "go on":
                    forget(at.session.folder)
                    return _end_of_turn(at, state), "changed"
                case "wish":
                    return _wished(at, state, order.value, order.expression), "changed"
                case "draw":
                    # Counted even if it is refused: the page then no longer shows it.
                    state = replace(state, lines=state.lines + 1)
                    state = at.rest(_drawn(at, state, order.value), "your turn", _invitation(state))
        except ConfigError as error:
            state = at.rest(state, "your turn", f"{error} {_invitation(state)}")
        order = at.session.control.wait()


def note_turn(at: Workplace, state: PaintingState) -> None:
    """Write the canvas as it is at the end of a turn, by the number of the state's turns. A camera is needed."""
    if at.camera is not None:
        write_png(at.session.folder / TURNS / f"{state.turns:03d}.png", at.photograph(state, PIXELS_PER_M))
        is_told = state.turns == 0 and (at.session.folder / TURNS / "000.json").exists()  # what was asked for first
        if not is_told:
            write_turn(at.session.folder, Turn(state.turns, "", state.executed, 0, lines=state.lines))


def write_turn(folder: Path, turn: Turn) -> None:
    """Write what is known of a turn."""
    text = json.dumps(to_plain(turn), indent=1) + "\n"
    atomic_write(folder / TURNS / f"{turn.number:03d}.json", text.encode())


def read_turns(folder: Path) -> list[Turn]:
    """All turns of a painting, in their order. Raises ContractError where a file is damaged."""
    found = []
    for path in sorted((folder / TURNS).glob("[0-9][0-9][0-9].json")):
        try:
            plain = json.loads(path.read_bytes())
        except ValueError as error:
            raise ContractError(f"{path} is damaged ({error}); take it out of the folder.") from error
        found.append(from_plain(Turn, plain, str(path)))
    return found


def words_in(folder: Path) -> str:
    """What a person asked for last, in words that were taught where they are known; "" for nothing.

    Raises:
        ContractError: a file is damaged.
    """
    return next((_taught(turn) for turn in reversed(read_turns(folder)) if turn.words), "")


def expression_in(folder: Path) -> Expression:
    """How what a person asked for last is painted. Raises ContractError as `words_in`."""
    return next((turn.expression for turn in reversed(read_turns(folder)) if turn.words), PLAIN)


def turns_in(folder: Path) -> list[Turn]:
    """The turns of a painting that have a photograph, in their order; without those that led to nothing.

    Raises:
        ContractError: a file is damaged.
    """
    found = read_turns(folder)
    shown = [turn for turn in found if (folder / TURNS / f"{turn.number:03d}.png").is_file()]
    following = [*shown[1:], None][: len(shown)]
    return [
        turn for turn, after in zip(shown, following, strict=True)
        if turn.words or turn.number == 0 or after is None or after.executed_before > turn.executed_before
    ]  # fmt: skip


def _taught(turn: Turn) -> str:
    return " and ".join(wish.words for wish in turn.things) or turn.words


def _invitation(state: PaintingState) -> str:
    if len(state.remaining):
        return "It is your turn: draw, then say go on or what to add. The robot does not move."
    return "It is your turn: draw, or say what to add. Stop ends the painting."


def _may_be_new(at: Workplace, state: PaintingState) -> bool:
    """Whether the sheet may show something of the person's that no noted turn does."""
    if at.session.traits.in_studio:
        return state.lines > max((turn.lines for turn in read_turns(at.session.folder)), default=0)
    return at.camera is not None and state.phase == "your turn"


def _end_of_turn(at: Workplace, state: PaintingState) -> PaintingState:
    """Observe what the person painted."""
    message = "The robot goes on." if at.camera is None else "The robot looks at what you painted."
    state = at.checkpoint(replace(state, turns=state.turns + 1, phase="painting", message=message))
    state = at.checkpoint(at.look(state, "the look after your turn"))
    note_turn(at, state)
    return state


def _wished(at: Workplace, state: PaintingState, words: str, expression: Expression) -> PaintingState:
    """A new goal for what a person asks for, on the canvas as it is now, and a plan in place of the old one.

    Raises:
        ConfigError: the words are not understood, or the person does not choose any of the goals.
    """
    session = at.session
    at.robot.lift()
    state = _end_of_turn(at, state)
    state = at.checkpoint(replace(state, message="The robot thinks of what to draw."))
    at.watchdog.beat(PLAN_S, "a new goal")
    proposal = session.goals_for(state.canvas, words)
    proposal = replace(proposal, goals=[expression.goal(goal, state.canvas) for goal in proposal.goals])
    state, number = _chosen(at, state, proposal)
    goal, things = proposal.goals[number], proposal.things[number] if proposal.things else ()
    forget(session.folder)
    state = at.checkpoint(replace(state, phase="painting", message="The robot plans its strokes."))
    at.watchdog.beat(PLAN_S, "a new plan")
    turn = Turn(state.turns, words, state.executed, 0, tuple(things), expression, state.lines)
    context = at.context.about(_taught(turn), expression)
    remaining, palette = first_plan(
        context.in_hand(session.control.hand), state.canvas, goal, count=session.strokes,
        start=at.start_of(state), log=no_log,
    )  # fmt: skip
    at.watchdog.rest()  # a person may have to fill the paints
    at.load(palette)
    turns = session.folder / TURNS
    write_png(turns / f"{state.turns:03d}_goal.png", goal)
    write_turn(session.folder, replace(turn, planned=len(remaining)))
    how = [expression.sentence()] if expression.said else []
    dips = dips_of(context, remaining, state.memory)
    message = " ".join([f"{len(remaining)} strokes are planned for: {words}.", *how, *dips, *_sentences(proposal)])
    predicted = predict_canvas(context, remaining, state.canvas, at.start_of(state))
    write_png(session.folder / PLAN, as_picture(predicted))
    state = replace(state, remaining=remaining, palette_srgb=palette, goal=goal, phase="painting", message=message)
    write_pictures(session.folder, context, state, session.replan_every)
    return at.checkpoint(state)


def _chosen(at: Workplace, state: PaintingState, proposal: Proposal) -> tuple[PaintingState, int]:
    """The index of the goal that the person chooses, on the canvas as it is then; the only one at once.

    Raises:
        ConfigError: the person says something else, which is sent again.
    """
    goals, folder, control = proposal.goals, at.session.folder / GOALS, at.session.control
    if len(goals) == 1:
        return state, 0
    shutil.rmtree(folder, ignore_errors=True)  # of an earlier turn
    for number, goal in enumerate(goals, 1):
        write_png(folder / f"{number}.png", goal)
    message = (
        f"Choose one of the goals: click it, or type its number, 1 to {len(goals)} (pictures in the folder {GOALS}). "
        "Say your turn to choose none of them."
    )
    control.forget("choose")  # among other goals
    state = at.rest(state, "choosing", " ".join([message, *_sentences(proposal)]))
    order = control.wait()
    numbers = [str(number) for number in range(1, len(goals) + 1)]
    while order.command != "choose" or order.value not in numbers:
        if order.command not in FOR_A_TURN:
            control.send(order.command, order.value, order.expression)
            raise ConfigError("None of the goals was chosen.")
        order = control.wait()
    return at.look(state, "the look after your choice"), numbers.index(order.value)


def _drawn(at: Workplace, state: PaintingState, line: str) -> PaintingState:
    """Draw a line of the person's in the studio, with the robot's tool.

    Raises:
        ConfigError: the line cannot be read, or the robot is not the studio's.
    """
    if not at.session.traits.in_studio:
        raise ConfigError("Lines can be drawn on the page in the studio only; draw on the sheet.")
    strokes = drawn_strokes(line, at.tool, at.context.canvas_size_m)
    forget(at.session.folder)
    for stroke in strokes:
        at.watchdog.beat(3 * at.session.traits.reach_s + 2 * float(stroke.path[-1, 0]), "your stroke")
        if at.tool.dips:
            at.robot.wipe()
            at.robot.load_palette(stroke.color_srgb[None])
            at.robot.dip(0)
        at.robot.move(stroke.path)
    if at.tool.dips:
        at.robot.wipe()
    at.load(state.palette_srgb)
    return at.look(state, "the look after your stroke")


def _sentences(proposal: Proposal) -> list[str]:
    return [f"{message[0].upper()}{message[1:]}." for message in proposal.messages]
