"""What the runner plans with at the canvas: the first plan, the rest after each look, and what both foretell."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.colour import linear_to_srgb, to_float, to_uint8
from pentimento.contracts.covariates import Memory
from pentimento.control.painter import as_linear, replan_rest
from pentimento.planning.strokes.bezier import Strokes
from pentimento.planning.strokes.brush import Brush
from pentimento.planning.strokes.config import PlannerConfig
from pentimento.planning.strokes.memory import Start
from pentimento.planning.strokes.planner import plan
from pentimento.planning.strokes.relocate import contributions
from pentimento.planning.strokes.render_plan import render_plan
from pentimento.planning.strokes.scene import Scene, Style, objective_for
from pentimento.robots.tools import Tool

Array = NDArray[np.float32]
FloatArray = NDArray[np.float64]
Picture = NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class PaintContext:
    """A tool with what was learned of it, a canvas, and how plans are made."""

    tool: Tool
    brush: Brush
    canvas_size_m: tuple[float, float]
    planner: PlannerConfig
    style: Style | None = None
    """For plans whose objectives ask for one."""
    threads: int = 1

    def scene(self, target: Array, start: Start) -> Scene:
        """A target [H, W, 3] (linear light) on a canvas in a state."""
        return Scene(self.tool, self.brush, self.canvas_size_m, target, start, self.style, self.threads)


def first_plan(
    paint_context: PaintContext,
    canvas: Picture,
    goal: Picture,
    count: int,
    start: Start,
    log: Callable[[str, float, int], None],
) -> tuple[Strokes, FloatArray]:
    """Up to ``count`` strokes from a canvas to a goal, uint8 sRGB [H, W, 3] both, and their palette, sRGB [K, 3].

    Strokes without which the canvas would come nearer to the goal are left out.
    """
    scene = paint_context.scene(as_linear(goal), start)
    strokes, palette = plan(as_linear(canvas), scene, count, paint_context.planner, log)
    return without_harmful(strokes, as_linear(canvas), scene, paint_context.planner), palette


def replanned(paint_context: PaintContext, left: Strokes, canvas: Picture, goal: Picture, start: Start) -> Strokes:
    """The strokes that are left, moved by gradient to where they help most from the canvas as it is now (4.3.5)."""
    moved = _anew(left)
    if len(moved):
        replan_rest(moved, canvas, paint_context.scene(as_linear(goal), start), paint_context.planner)
    return moved


def still_wanted(paint_context: PaintContext, left: Strokes, canvas: Picture, goal: Picture, start: Start) -> Strokes:
    """``replanned`` for a canvas that someone else has changed: strokes that would only do harm now are left out."""
    moved = replanned(paint_context, left, canvas, goal, start)
    return without_harmful(moved, as_linear(canvas), paint_context.scene(as_linear(goal), start), paint_context.planner)


def without_harmful(strokes: Strokes, canvas: Array, scene: Scene, config: PlannerConfig) -> Strokes:
    """The strokes but those whose absence lowers the error.

    A goal that needs few strokes is not spoilt by the many that were allowed. Of strokes that do harm together, each
    round leaves out the worst half, since without them the others may be needed.
    """
    strokes = _anew(strokes)
    while len(strokes):
        worth = contributions(strokes, canvas, scene, config)
        harmful = np.flatnonzero(worth < 0)
        if not len(harmful):
            break
        worst = harmful[np.argsort(worth[harmful], kind="stable")][: (len(harmful) + 1) // 2]
        strokes = _anew(strokes.pick(np.setdiff1d(np.arange(len(strokes)), worst)))
    return strokes


def predicted(paint_context: PaintContext, strokes: Strokes, canvas: Picture, start: Start) -> Array:
    """What the canvas will look like after the strokes, linear light [H, W, 3]."""
    light = as_linear(canvas)
    return np.clip(render_plan(_anew(strokes), light, paint_context.scene(light, start)), 0, 1)


def error(paint_context: PaintContext, image: Array, goal: Picture, start: Start) -> float:
    """The planner's objective for an image [H, W, 3] (linear light)."""
    return objective_for(paint_context.scene(as_linear(goal), start), paint_context.planner)(image)[0]


def painted_by_a_person(memory: Memory, before: Picture, now: Picture, clock_s: float) -> Memory:
    """The memory of tool and canvas after a person has changed the canvas: there is fresh paint where it changed."""
    changed = np.abs(to_float(now) - to_float(before)).max(axis=2) > _TOUCHED
    rows, columns = memory.ink.shape
    share = cv2.resize(changed.astype(np.float32), (columns, rows), interpolation=cv2.INTER_AREA).astype(np.float64)
    painted_at_s = np.where(share > 0, clock_s, memory.painted_at_s)
    return replace(memory, ink=np.maximum(memory.ink, share), painted_at_s=painted_at_s)


def to_be_dipped(memory: Memory, tool: Tool) -> Memory:
    """The memory of a tool that has waited: what paint is on it has dried, and it is dipped before the next stroke."""
    return replace(memory, since_reload=max(memory.since_reload, tool.strokes_per_dip)) if tool.dips else memory


def as_picture(light: Array) -> Picture:
    """Linear light [H, W, 3] as a picture uint8 sRGB."""
    return to_uint8(linear_to_srgb(np.clip(light, 0, 1)))


def _anew(strokes: Strokes) -> Strokes:
    """A copy; what the strokes inherit is to be worked out again."""
    copy = strokes.pick(slice(None))
    copy.inherited = None
    return copy


_TOUCHED = 0.06
"""Change of a pixel, sRGB, that a camera's noise does not make."""
