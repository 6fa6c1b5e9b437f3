"""From a bundle and a wish to a painting: the command ``pentimento run``."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pentimento.bundle.graphs import GraphBrush, Graphs, PictureStyle, goal_networks, noise_schedule, tokenizer
from pentimento.bundle.reader import Bundle, Setting, open_bundle
from pentimento.contracts.atomic import atomic_write
from pentimento.contracts.errors import ConfigError
from pentimento.contracts.images import read_image
from pentimento.control.commands import Control
from pentimento.control.commission import Commission, Wanted, alone_in, write_commission
from pentimento.control.goal import goal_from_picture, goal_from_words
from pentimento.control.open_robot import open_robot, rig_named
from pentimento.control.page import Page
from pentimento.control.paint_context import PaintContext, error
from pentimento.control.painter import as_linear
from pentimento.control.painting_state import State, has_state, load_state
from pentimento.control.progress import Progress
from pentimento.control.safety import GuardedRobot, envelope_for
from pentimento.control.session import GOAL, PLAN, LoopTiming, Sitting, begin, carry_on
from pentimento.planning.strokes.config import PlannerConfig
from pentimento.planning.strokes.memory import Start
from pentimento.planning.strokes.target import load_photograph
from pentimento.robots.rig import Rig

Picture = NDArray[np.uint8]

SUMMARY = "painting.json"
"""In a finished painting's folder: strokes, and errors as the planner counts them."""

_THREADS = 2
"""Cores that plan, at most: plans come out the same on any number."""


def commission_of(
    bundle: Path,
    setting: str | None,
    robot: str,
    execute: bool,
    wanted: Wanted,
    strokes: int | None,
    batch: int | None,
    seed: int | None,
) -> Commission:
    """What a command asks for; where it says nothing, as the bundle's setting has it.

    Raises:
        BundleError: the bundle is refused, or has no such setting.
        ConfigError: it has several that one could begin with, and none is named.
        ImageError: the picture that is wanted cannot be read.
    """
    opened = open_bundle(bundle)
    if wanted.kind == "picture":
        read_image(Path(wanted.value))  # a slip in its name leaves no folder behind
    # A tool with its own ink needs no paints laid out, so it is what one begins with.
    names = sorted(name for name, tool in opened.tools.items() if tool.color_srgb is not None) or sorted(opened.tools)
    if setting is None and len(names) > 1:
        raise ConfigError(f"The bundle has the settings {', '.join(sorted(opened.tools))}; choose one with --setting.")
    name = names[0] if setting is None else setting
    known = opened.setting(name)
    return Commission(
        bundle=str(bundle.resolve()),
        digest=opened.digest,
        setting=name,
        robot=robot,
        execute=execute,
        wanted=wanted,
        strokes=known.strokes if strokes is None else strokes,
        batch=known.batch if batch is None else batch,
        seed=known.planner.seed if seed is None else seed,
    )


def run(
    commission: Commission,
    folder: Path,
    resume: bool,
    calibration: Path,
    ask: Callable[[str], None],
    page: Callable[[str], None] | None,
    control: Control,
    progress: Progress,
) -> State:
    """Begin a painting in a folder, or go on with it; the state in which it ends.

    Args:
        calibration: folder of the rig's calibrations, for hardware that is to move.
        ask: puts a request to the person and returns when it is done.
        page: serve the page for the person at the easel, and tell its address here.

    Raises:
        PentimentoError, OSError: as ``session.carry_on``; and before anything moves, what does not fit together.
    """
    bundle = open_bundle(Path(commission.bundle), commission.digest)
    setting, tool = bundle.setting(commission.setting), bundle.tools[commission.setting]
    rig = rig_named(commission.robot)
    canvas_size_m = _size_within(setting, rig)
    if resume and has_state(folder) and (state := load_state(folder)).phase == "done":
        return state
    if not resume:
        write_commission(folder, commission)
    with alone_in(folder):
        opened = open_robot(
            commission.robot, tool, canvas_size_m, folder, commission.seed, commission.execute, calibration, ask
        )
        served = None if page is None else Page(folder, control)
        try:
            if page is not None and served is not None:
                page(served.address)
            graphs = Graphs(bundle, _threads())
            paint_context = _paint_context(graphs, setting, commission, canvas_size_m)
            envelope = setting.envelope.tightened(envelope_for(tool, canvas_size_m))
            guarded = GuardedRobot(opened.robot, envelope if rig is None else envelope.narrowed(rig.limits))
            timing = LoopTiming(commission.batch, opened.reach_s, opened.sees, opened.clock_goes_on)
            sitting = Sitting(
                guarded, paint_context, timing, folder, control, _tell(served, progress), opened.calibrated
            )
            if not has_state(folder):
                begin(sitting, _goal_for(commission.wanted, graphs, paint_context, commission.seed), commission.strokes,
                      _told(progress, paint_context.planner))  # fmt: skip
            state = carry_on(sitting)
            _sum_up(folder, paint_context, state)
            return state
        finally:
            if served is not None:
                served.close()
            opened.close()


def _tell(page: Page | None, progress: Progress) -> Callable[[State], None]:
    def tell(state: State) -> None:
        if page is not None:
            page.tell(state)
        progress.step("stroke", state.made, state.made + len(state.left), state.phase)

    return tell


def _paint_context(
    graphs: Graphs, setting: Setting, commission: Commission, canvas_size_m: tuple[float, float]
) -> PaintContext:
    planner = replace(setting.planner, seed=commission.seed)
    asked = planner.objectives.style
    style = None if asked is None else PictureStyle(graphs, load_photograph(asked.picture), planner.seed)
    tool = graphs.bundle.tools[commission.setting]
    return PaintContext(tool, GraphBrush(graphs, setting.brush), canvas_size_m, planner, style, _threads())


def _goal_for(wanted: Wanted, graphs: Graphs, paint_context: PaintContext, seed: int) -> Callable[[Picture], Picture]:
    """The goal for a canvas."""
    if wanted.kind == "picture":
        picture = read_image(Path(wanted.value))
        return lambda canvas: goal_from_picture(picture, canvas, paint_context.tool)
    bundle: Bundle = graphs.bundle
    facts = bundle.manifest.goal
    return lambda canvas: goal_from_words(
        wanted.value, canvas, goal_networks(graphs), noise_schedule(bundle), tokenizer(bundle, facts.words),
        facts.side_px, (facts.latent_channels, facts.latent_step_px), facts.steps,
        (facts.image_guidance, facts.text_guidance), seed,
    )  # fmt: skip


def _size_within(setting: Setting, rig: Rig | None) -> tuple[float, float]:
    """What is painted of a rig's sheet: its lower left part, as far as the bundle's canvas reaches."""
    if rig is None:
        return setting.canvas_m
    (width, height), (most_width, most_height) = rig.canvas_size_m, setting.canvas_m
    return min(width, most_width), min(height, most_height)


def _told(progress: Progress, planner: PlannerConfig) -> Callable[[str, float, int], None]:
    steps = planner.rounds * planner.iterations_per_round + planner.iterations_free + planner.iterations_palette

    def log(_name: str, value: float, step: int) -> None:
        progress.step("planning", step + 1, steps, f"error {value:.4f}")

    return log


def _sum_up(folder: Path, paint_context: PaintContext, state: State) -> None:
    """Write what came of it, once it is done."""
    if state.phase != "done":
        return
    goal, start = read_image(folder / GOAL), Start(state.memory, state.clock_s, state.made)
    errors: dict[str, Any] = {
        name: error(paint_context, as_linear(picture), goal, start)
        for name, picture in (("plan", read_image(folder / PLAN)), ("canvas", state.canvas))
    }
    told = {"strokes": state.made, "sessions": state.sessions, "turns": state.turns, "error": errors}
    atomic_write(folder / SUMMARY, (json.dumps(told, indent=2) + "\n").encode())


def _threads() -> int:
    return min(_THREADS, os.cpu_count() or 1)
