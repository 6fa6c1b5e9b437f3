"""Executing planned strokes: dips and moves of the robot, and the memory of tool and canvas after them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.covariates import Memory, StrokeEvent, advance, covariates
from pentimento.contracts.errors import ContractError, PentimentoError
from pentimento.contracts.plan import PlannedStroke
from pentimento.robots.driver import Robot
from pentimento.robots.refill import Depletion, needs_dip
from pentimento.robots.tools import Tool, same_colour

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Session:
    """One uninterrupted recording with the same tool, paint and camera pose."""

    name: str
    started_s: float
    """The robot's clock at the session's start; times in tables count from here."""


@dataclass(frozen=True, eq=False)
class ExecutedStroke:
    """One executed stroke."""

    event: StrokeEvent
    covariates: dict[str, int | float | list[float]]
    """The strokes contract's columns that depend on the memory, before the stroke."""
    measured_path: FloatArray
    """[N, 5] as the robot measured it; NaN where it did not."""
    force_n: FloatArray
    """Normal force at the path's points, [N]; [0] where the robot does not measure it."""


class ExecutionError(PentimentoError):
    """A stroke failed. `__cause__` is the error of the driver or the guard.

    The strokes before `stroke` were executed and are in `memory` and `measured`. Continuing from `memory` is safe: a
    tool that was dipped for the failed stroke is dipped for it again.
    """

    def __init__(self, message: str, stroke: int, memory: Memory, measured: list[FloatArray]) -> None:
        super().__init__(message)
        self.stroke = stroke
        self.memory = memory
        self.measured = measured


def execute(
    robot: Robot,
    tool: Tool,
    strokes: Sequence[PlannedStroke],
    *,
    palette_srgb: FloatArray,
    memory: Memory,
    session: Session,
    depletion: Depletion | None = None,
) -> tuple[Memory, list[FloatArray]]:
    """Execute the strokes in order; returns the memory after them and the measured path of each [N, 5].

    The robot first changes to `tool` and loads `palette_srgb` [K, 3]; both do nothing if that is already the case. A
    tool that dips is dipped where the stroke asks for it, where its colour changes (then it is washed and wiped first)
    and where its load has faded by the diagnosed ``depletion`` (`robots.refill.needs_dip`); without one, after
    `tool.strokes_per_dip` strokes. A tool with its own ink is never dipped.

    Raises ContractError, before anything moves, if a colour is not on the palette; ExecutionError when a
    stroke fails.
    """
    for index, stroke in enumerate(strokes):
        _paint_of(stroke, tool, palette_srgb, index)
    robot.change_tool(tool)
    if tool.dips:
        robot.load_palette(palette_srgb)
    measured: list[FloatArray] = []
    for index, stroke in enumerate(strokes):
        try:
            memory, executed = execute_stroke(
                robot, tool, stroke, palette_srgb=palette_srgb, memory=memory, session=session,
                depletion=depletion,
            )  # fmt: skip
        except (PentimentoError, OSError, RuntimeError) as error:
            raise ExecutionError(
                f"Stroke {index} of {len(strokes)} failed: {error} The {index} strokes before it were made; "
                "look at the canvas, then go on from this error's memory.",
                index,
                memory,
                measured,
            ) from error
        measured.append(executed.measured_path)
    return memory, measured


def execute_stroke(
    robot: Robot,
    tool: Tool,
    stroke: PlannedStroke,
    *,
    palette_srgb: FloatArray,
    memory: Memory,
    session: Session,
    depletion: Depletion | None = None,
) -> tuple[Memory, ExecutedStroke]:
    """Execute one stroke, after the dip that it needs, with a robot that holds `tool` and has the palette loaded.

    Errors of the robot pass through. `memory` is a value; it still describes the canvas then, unless the driver failed
    during the stroke.
    """
    paint = _paint_of(stroke, tool, palette_srgb, 0)
    dip = needs_dip(tool, stroke, memory, depletion)
    if dip:
        if not same_colour(memory.last_color_srgb, stroke.color_srgb):
            robot.wipe()
        robot.dip(paint)
    measured = robot.move(stroke.path)
    # The travel to the stroke's start takes time, too, so the start time follows from the end time.
    started_s = robot.clock_s - float(stroke.path[-1, 0]) - session.started_s
    event = StrokeEvent(path=stroke.path, t_start_s=started_s, dip=dip, color_srgb=stroke.color_srgb)
    return advance(memory, event), ExecutedStroke(event, covariates(memory, event), measured, robot.force_n())


def _paint_of(stroke: PlannedStroke, tool: Tool, palette_srgb: FloatArray, index: int) -> int:
    """Index of the stroke's colour on the palette (0 for a tool with its own ink)."""
    available = np.array([tool.color_srgb]) if tool.color_srgb is not None else np.asarray(palette_srgb)
    for paint, color in enumerate(available):
        if same_colour(color, stroke.color_srgb):
            return paint
    place = f"the {tool.name}'s own" if tool.color_srgb is not None else "on the palette"
    raise ContractError(
        f"Stroke {index}'s colour {np.round(stroke.color_srgb, 3).tolist()} is not {place} "
        f"({np.round(available, 3).tolist()}); plan with the palette that is painted with."
    )
