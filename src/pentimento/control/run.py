"""From a bundle and a goal to a painting: the command ``pentimento run``."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pentimento.bundle.graphs import (
    GraphBrush,
    GraphMeaning,
    GraphPathBrush,
    Graphs,
    PictureStyle,
    goal_networks,
    noise_schedule,
    tokenizer,
)
from pentimento.bundle.reader import Bundle, open_bundle
from pentimento.contracts.atomic import atomic_write
from pentimento.contracts.errors import ConfigError
from pentimento.contracts.images import read_image
from pentimento.control.checkpoint import PaintingState, has_state, load_state
from pentimento.control.commission import Commission, Wanted, Weights, begun, exclusive
from pentimento.control.drawing import drawn_plan
from pentimento.control.expression import PLAIN, Expression
from pentimento.control.goal import GoalSampling, centred_square, goal_from_picture, goal_from_words
from pentimento.control.guard import GuardedRobot
from pentimento.control.layout import WHOLE, Wish, in_medium, placed
from pentimento.control.open_robot import is_in_studio, open_robot, rig_named
from pentimento.control.page import Page, Pen
from pentimento.control.painter import PaintContext, as_linear, objective_value
from pentimento.control.person import Control, Progress
from pentimento.control.pictures import GOAL, PLAN
from pentimento.control.request import MAX_THINGS, Understood, understand
from pentimento.control.safety import SafetyEnvelope, envelope_for
from pentimento.control.saved import saved_files, write_drawings
from pentimento.control.session import begin
from pentimento.control.session import resume as resume_session
from pentimento.control.standing import Standing, beside_standing, known_things, sentences, standing_in
from pentimento.control.turn import Turn, words_in, write_turn
from pentimento.control.undo import take_back
from pentimento.control.workplace import PaintingSession, Proposal
from pentimento.planning.strokes.config import PlanConfig, PlannerConfig
from pentimento.planning.strokes.memory import Start
from pentimento.planning.strokes.target import load_photograph
from pentimento.robots.rig import Rig
from pentimento.robots.tools import Tool

Picture = NDArray[np.uint8]

SUMMARY = "painting.json"
"""In a finished painting's folder: number of strokes and dips, and errors by the planner's objective."""

_ROOM = 0.45
"""Maximum side of a thing that is drawn in a turn, in sides of the canvas: the next turns need room. Several things get
that area each."""

_THREADS = 2
"""Maximum number of cores that plan; plans do not depend on it."""


@dataclass(frozen=True)
class Turns:
    """How a person takes part."""

    in_turns: bool
    """After its last stroke the robot waits for the person, who may draw and ask for something new."""
    choices: int
    """Number of goals to choose from when a person asks for something new; the first goal is not chosen."""


ALONE = Turns(in_turns=False, choices=1)


def commission_of(
    bundle: Path,
    wanted: Wanted,
    *,
    tell: Callable[[str], None],
    setting: str | None = None,
    robot: str = "virtual",
    execute: bool = False,
    strokes: int | None = None,
    replan_every: int | None = None,
    seed: int | None = None,
    weights: Weights | None = None,
    hand: str | None = None,
) -> Commission:
    """The commission of a command; for what is None, the bundle's setting decides.

    Args:
        tell: called with each sentence about words that are drawn as something else, or left out.

    Raises:
        BundleError: the bundle is refused, or has no such setting or hand.
        ConfigError: the bundle has several settings to begin with, and none is named; the words are not understood; or
            words are to weigh, and a picture is the goal.
        ImageError: the goal picture cannot be read.
        ContractError, EnvelopeViolation: the drawing cannot be read, or not be made.
    """
    opened = open_bundle(bundle)
    if weights is not None and weights.text > 0 and wanted.kind == "picture":
        raise ConfigError("The weight of text is that of the words asked for: give --goal-text instead of a picture.")
    if weights is not None and weights.print + weights.semantic == 0 and not wanted.value:
        raise ConfigError("Only text has a weight, and nothing was asked for: say with --goal-text what to paint.")
    if hand is not None:
        opened.hand(hand)
    # These are checked here, so that an error leaves no folder behind.
    if wanted.kind == "picture":
        read_image(Path(wanted.value))
    elif wanted.kind == "words" and wanted.value:
        for message in understand(wanted.value, opened.vocabulary).messages():
            tell(message)
    # A tool with its own ink needs no paints, so it is the one to begin with.
    names = sorted(name for name, tool in opened.tools.items() if tool.color_srgb is not None) or sorted(opened.tools)
    if setting is None and len(names) > 1:
        raise ConfigError(f"The bundle has the settings {', '.join(sorted(opened.tools))}; choose one with --setting.")
    name = names[0] if setting is None else setting
    defaults = opened.setting(name)
    if wanted.kind == "drawing":
        rig = rig_named(robot)
        canvas_size_m = _canvas_size_m(defaults.canvas_m, rig)
        envelope = _envelope(opened, name, canvas_size_m, rig)
        tell(drawn_plan(Path(wanted.value), opened.tools[name], canvas_size_m, envelope).sentence)
    return Commission(
        bundle=str(bundle.resolve()),
        digest=opened.digest,
        setting=name,
        robot=robot,
        execute=execute,
        wanted=wanted,
        strokes=defaults.strokes if strokes is None else strokes,
        replan_every=defaults.replan_every if replan_every is None else replan_every,
        seed=defaults.planner.seed if seed is None else seed,
        weights=weights,
        hand=hand,
    )


def run(
    commission: Commission,
    folder: Path,
    *,
    resume: bool,
    calibration: Path,
    ask: Callable[[str], None],
    page: Callable[[str], None] | None,
    control: Control,
    progress: Progress,
    turns: Turns = ALONE,
    wish: str = "",
    expression: Expression = PLAIN,
    listen: Callable[[bytes], tuple[str, Expression]] | None = None,
) -> PaintingState:
    """Begin or resume a painting in a folder; its final state.

    Args:
        wish: for a painting that is resumed, what a person asks for now; "" for nothing new.
        expression: how that wish is painted.
        calibration: folder of the rig's calibrations, for hardware that is to move.
        ask: shows a request to the person and returns when it is done.
        page: called with the address of the person's page; None for no page.
        listen: see `Page`.

    Raises:
        PentimentoError, OSError: as ``session.resume``; and, before anything moves, for arguments that do not fit.
    """
    bundle = open_bundle(Path(commission.bundle), commission.digest)
    setting, tool = bundle.setting(commission.setting), bundle.tools[commission.setting]
    rig = rig_named(commission.robot)
    canvas_size_m = _canvas_size_m(setting.canvas_m, rig)
    new = bool(wish) or turns.in_turns
    if resume and has_state(folder) and (state := load_state(folder)).phase == "done" and not new:
        return state
    for message in understand(wish, bundle.vocabulary).messages() if wish else ():
        progress.message(message)
    with exclusive(folder) if resume else begun(folder, commission):
        control.hand = load_state(folder).hand if has_state(folder) else commission.hand
        # What a person draws on the page is seen by the studio's camera alone.
        has_pen = is_in_studio(commission.robot, commission.execute) and (rig is None or rig.camera is not None)
        pen = _pen(tool, canvas_size_m) if has_pen else None
        saved = saved_files(folder, tool, canvas_size_m, rig)
        served = None if page is None else Page(folder, control, pen, saved, listen, sorted(bundle.hands))
        try:
            if page is not None and served is not None:
                page(served.address)
            graphs = Graphs(bundle, _threads())
            envelope = _envelope(bundle, commission.setting, canvas_size_m, rig)
            context = _paint_context(graphs, commission, canvas_size_m, envelope.max_speed_m_s)
            goals_for = _goals_for(
                graphs, context, setting=commission.setting, seed=commission.seed, in_turns=turns.in_turns,
                standing=partial(_standing, folder),
            )  # fmt: skip
            first_goal = _first_goal(commission, context, partial(goals_for, count=1), folder, in_turns=turns.in_turns)
            ended: PaintingState | None = None
            while ended is None or ended.phase == "undoing":
                if has_state(folder) and load_state(folder).phase == "undoing":
                    take_back(folder)
                opened = open_robot(
                    commission.robot, tool, canvas_size_m, folder=folder, seed=commission.seed,
                    execute=commission.execute, calibration=calibration, ask=ask,
                )  # fmt: skip
                with closing(opened):
                    session = PaintingSession(
                        robot=GuardedRobot(opened.robot, envelope),
                        traits=opened.traits, context=context, strokes=commission.strokes,
                        replan_every=commission.replan_every, folder=folder, control=control,
                        on_state=_on_state(served, progress), goals_for=partial(goals_for, count=turns.choices),
                        in_turns=turns.in_turns,
                    )  # fmt: skip
                    if not has_state(folder):
                        drawn = None
                        if commission.wanted.kind == "drawing":
                            drawn = drawn_plan(Path(commission.wanted.value), tool, canvas_size_m, envelope)
                        log = _planning_log(progress, context.in_hand(control.hand).planner)
                        planned = begin(session, first_goal, log=log, drawn=drawn)
                        if tool.dips:
                            progress.message(planned.message)
                    ended = resume_session(session, wish if ended is None else "", expression)
            for message in write_drawings(folder, tool, canvas_size_m, rig):
                progress.message(message)
            if ended.phase == "done":
                _write_summary(folder, context, ended)
            return ended
        finally:
            if served is not None:
                served.close()


def _on_state(page: Page | None, progress: Progress) -> Callable[[PaintingState], None]:
    def on_state(state: PaintingState) -> None:
        if page is not None:
            page.show(state)
        progress.step("stroke", state.executed, state.executed + len(state.remaining), state.phase)
        if state.phase in ("paused", "your turn", "choosing"):
            progress.message(state.message)

    return on_state


def _paint_context(
    graphs: Graphs, commission: Commission, canvas_size_m: tuple[float, float], max_speed_m_s: float
) -> PaintContext:
    setting = graphs.bundle.setting(commission.setting)
    planner = replace(setting.planner, seed=commission.seed)
    wanted = planner.objectives.style
    style = None if wanted is None else PictureStyle(graphs, load_photograph(wanted.picture), planner.seed)
    tool = graphs.bundle.tools[commission.setting]
    meaning = GraphMeaning(graphs, planner.seed)
    own = PaintContext(
        tool, GraphBrush(graphs, setting.brush), canvas_size_m, planner, style, meaning, _threads(), commission.weights,
        max_speed_m_s,
    )  # fmt: skip
    if setting.path_brush is None:
        return own
    brush = GraphPathBrush(graphs, setting.path_brush, tool)
    in_hand = graphs.bundle.manifest.hand_planner.of(planner, brush.path_points)
    hands = {
        name: replace(own, brush=brush, planner=in_hand, shapes=decoder)
        for name, decoder in graphs.bundle.hands.items()
    }
    return replace(own, hands=hands)


def _first_goal(
    commission: Commission,
    context: PaintContext,
    goals_for: Callable[[Picture, str], Proposal],
    folder: Path,
    *,
    in_turns: bool,
) -> Callable[[Picture], Picture]:
    """A function from the canvas to the first goal, uint8 sRGB [H, W, 3] both, which is written down as turn 0."""
    wanted, expression = commission.wanted, commission.expression
    if wanted.kind == "picture":
        picture = read_image(Path(wanted.value))
        return lambda canvas: goal_from_picture(picture, canvas, context.tool)
    if wanted.kind == "drawing" or (in_turns and not wanted.value):
        return lambda canvas: canvas  # the person begins

    def first(canvas: Picture) -> Picture:
        proposal = goals_for(canvas, wanted.value)
        write_turn(folder, Turn(0, wanted.value, 0, 0, tuple(proposal.things[0]), expression))
        return expression.goal(proposal.goals[0], canvas)

    return first


def _standing(folder: Path) -> Standing:
    return standing_in(folder, load_state(folder).executed) if has_state(folder) else {}


def _goals_for(
    graphs: Graphs,
    context: PaintContext,
    *,
    setting: str,
    seed: int,
    in_turns: bool,
    standing: Callable[[], Standing],
) -> Callable[..., Proposal]:
    """A function from the canvas, a person's words and a `count` to so many goals, uint8 sRGB [H, W, 3], each with
    another seed and in another place, as far as there is room.

    Args:
        standing: gives the things that stand on the canvas.
    """
    bundle: Bundle = graphs.bundle
    facts = bundle.manifest.goal
    sampling = GoalSampling(
        facts.side_px, facts.latent_channels, facts.latent_step_px, facts.steps, facts.image_guidance,
        facts.text_guidance, seed,
    )  # fmt: skip
    by_window = bundle.vocabulary is not None and bundle.vocabulary.by_window

    def goals(canvas: Picture, words: str, count: int) -> Proposal:
        request = understand(words, bundle.vocabulary) if words else Understood("")
        here = standing() if by_window else {}
        known = known_things(request, here)
        new = sum(thing.number for thing in request.things) - sum(thing.number for thing in known)
        largest = min(1.0, _ROOM * math.sqrt(max(new, 1))) if in_turns else 1.0
        found, things, taken = list[Picture](), list[list[Wish]](), canvas.copy()
        for number in range(count):
            square = taken[centred_square(taken)]
            places = list[Wish]()
            if known:
                places = beside_standing(request, square, here, largest=largest)
            elif by_window and request.things:
                places = placed(request, square, largest=largest)
            goal = goal_from_words(
                in_medium(places or [Wish(request.text, WHOLE)], bundle.setting(setting).words), canvas,
                goal_networks(graphs), has_ink=context.tool.color_srgb is not None,
                schedule=noise_schedule(bundle), tokenizer=tokenizer(bundle, facts.words),
                sampling=replace(sampling, seed=seed + MAX_THINGS * number),
            )  # fmt: skip
            found.append(goal)
            things.append(places)
            taken = np.where(goal == canvas, taken, goal)
        return Proposal(found, [*request.messages(), *sentences(request, here)], things)

    return goals


def _pen(tool: Tool, canvas_size_m: tuple[float, float]) -> Pen:
    """What a person draws with on the page: the robot's tool."""
    color = None if tool.color_srgb is None else "#" + "".join(f"{round(255 * c):02x}" for c in tool.color_srgb)
    return Pen(tool.nominal_width_m / canvas_size_m[0], color)


def _envelope(bundle: Bundle, setting: str, canvas_size_m: tuple[float, float], rig: Rig | None) -> SafetyEnvelope:
    """The limits of the bundle, of the tool and of the rig."""
    envelope = bundle.setting(setting).envelope.tightened(envelope_for(bundle.tools[setting], canvas_size_m))
    return envelope if rig is None else envelope.narrowed(rig.limits)


def _canvas_size_m(setting_m: tuple[float, float], rig: Rig | None) -> tuple[float, float]:
    """The painted part of a rig's sheet: its lower left part, at most as large as the setting's canvas."""
    if rig is None:
        return setting_m
    (width, height), (max_width, max_height) = rig.canvas_size_m, setting_m
    return min(width, max_width), min(height, max_height)


def _planning_log(progress: Progress, planner: PlanConfig) -> Callable[[str, float, int], None]:
    after_rounds = planner.iterations_free if isinstance(planner, PlannerConfig) else planner.iterations
    steps = planner.rounds * planner.iterations_per_round + after_rounds + planner.iterations_palette

    def log(_name: str, value: float, step: int) -> None:
        progress.step("planning", step + 1, steps, f"error {value:.4f}")

    return log


def _write_summary(folder: Path, context: PaintContext, state: PaintingState) -> None:
    goal, start = read_image(folder / GOAL), Start(state.memory, state.clock_s, state.executed)
    context = context.about(words_in(folder))
    errors: dict[str, Any] = {
        name: objective_value(context, as_linear(picture), goal, start)
        for name, picture in (("plan", read_image(folder / PLAN)), ("canvas", state.canvas))
    }
    summary = {
        "strokes": state.executed, "dips": state.memory.reload_id, "sessions": state.sessions, "turns": state.turns,
        "error": errors,
    }  # fmt: skip
    atomic_write(folder / SUMMARY, (json.dumps(summary, indent=2) + "\n").encode())


def _threads() -> int:
    return min(_THREADS, os.cpu_count() or 1)
