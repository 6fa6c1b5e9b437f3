"""Planning and painting strokes: the first plan, replanning on a photograph, and ``paint`` (thesis 4.3.5)."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from pentimento.calibration.observe import CameraCalibration, calibrate_camera, rectify
from pentimento.contracts.colour import linear_to_srgb, srgb_to_linear, to_float, to_uint8
from pentimento.contracts.covariates import Memory, fresh_memory
from pentimento.contracts.markers import markers_around
from pentimento.contracts.plan import PlannedStroke
from pentimento.control.commission import Weights
from pentimento.control.execute import Session, execute
from pentimento.control.expression import PLAIN, Expression
from pentimento.control.loop import Hooks, run_loop
from pentimento.planning.strokes.bezier import no_strokes
from pentimento.planning.strokes.brush import Brush
from pentimento.planning.strokes.config import Log, PlanConfig, TextConfig
from pentimento.planning.strokes.descent import optimise
from pentimento.planning.strokes.latent import StyleDecoder
from pentimento.planning.strokes.memory import Start
from pentimento.planning.strokes.paths import PlannedPaths
from pentimento.planning.strokes.planner import plan_strokes, relocated
from pentimento.planning.strokes.relocate import without_useless
from pentimento.planning.strokes.render_plan import render_plan
from pentimento.planning.strokes.scene import Meaning, Scene, Style, objective_for
from pentimento.planning.strokes.shapes import ShapedStrokes, Shapes
from pentimento.robots.driver import Robot
from pentimento.robots.refill import too_long, with_dips
from pentimento.robots.tools import Tool

Array = NDArray[np.float32]
FloatArray = NDArray[np.float64]
Image = NDArray[np.uint8]
S = TypeVar("S", bound=PlannedPaths)

_CHANGED = 0.06
"""Change of a pixel's sRGB value (0 to 1) that exceeds a camera's noise."""


@dataclass(frozen=True)
class Painting:
    """The result of executing a plan."""

    executed: list[PlannedStroke]
    measured: list[FloatArray]
    """[N, 5] of each stroke: its path as the robot measured it, NaN where it did not."""
    photos: list[Image]
    """The canvas, sRGB [H, W, 3], before the first stroke and after every batch."""
    deviation: list[float]
    """Mean squared difference (sRGB) between the finished painting as predicted at the start and as predicted after
    each batch (thesis Figure 4.11); 0 at first, as long as ``photos``."""
    predicted: Image
    """The finished painting as predicted by the first plan, sRGB [H, W, 3]."""


def paint(
    robot: Robot,
    scene: Scene,
    strokes: PlannedPaths,
    *,
    palette_srgb: FloatArray,
    replan_every: int,
    replan: bool,
    config: PlanConfig,
    log: Log,
) -> Painting:
    """Execute a plan in batches and photograph the canvas after each.

    Args:
        palette_srgb: the paints, sRGB [K, 3].
        replan_every: strokes between two photographs.
        replan: optimise the remaining strokes on each photograph; otherwise the plan stays as it is.
        log: called as ``log("deviation", value, strokes executed)`` after each batch.
    """
    calibration = calibrate_camera(robot.photo(), markers_around(robot.canvas_size_m))
    session = Session("painting", robot.clock_s)
    memory = fresh_memory(robot.canvas_size_m, scene.tool.nominal_width_m)
    photo = observe(robot, calibration, config.pixels_per_m)
    remaining = _copy(strokes)
    first = predict(remaining, photo, scene)
    task = _BatchByBatch(robot, calibration, session, palette_srgb, replan_every, replan, config, first, log)
    start = _BatchProgress((), (), (photo,), (0.0,), remaining, memory, scene)
    state, _ = run_loop(task, start, Hooks())
    return Painting(
        list(state.executed), list(state.measured), list(state.photos), list(state.deviation), to_uint8(first)
    )


@dataclass(frozen=True)
class _BatchProgress:
    """What has been painted, and what remains."""

    executed: tuple[PlannedStroke, ...]
    measured: tuple[FloatArray, ...]
    photos: tuple[Image, ...]
    deviation: tuple[float, ...]
    remaining: PlannedPaths
    memory: Memory
    scene: Scene


@dataclass(frozen=True)
class _BatchByBatch:
    """``control.loop.Task``: an action is a whole batch of strokes, observed by one photograph."""

    robot: Robot
    calibration: CameraCalibration
    session: Session
    palette_srgb: FloatArray
    replan_every: int
    replans: bool
    config: PlanConfig
    first: Array
    """The finished painting as predicted by the first plan, sRGB [H, W, 3]."""
    log: Log

    def outcome(self, state: _BatchProgress) -> str | None:
        return None if len(state.remaining) else "all strokes were executed"

    def batch(self, state: _BatchProgress) -> Sequence[list[PlannedStroke]]:
        scene = state.scene
        return [state.remaining.pick(slice(0, self.replan_every)).planned(scene.tool, scene.brush.path_points)]

    def mark_pending(self, state: _BatchProgress) -> _BatchProgress:
        return state

    def execute(self, state: _BatchProgress, action: list[PlannedStroke]) -> _BatchProgress:
        memory, measured = execute(
            self.robot, state.scene.tool, action, palette_srgb=self.palette_srgb, memory=state.memory,
            session=self.session, depletion=state.scene.brush.depletion,
        )  # fmt: skip
        executed = (*state.executed, *action)
        scene = replace(
            state.scene, start=Start(memory, self.robot.clock_s - self.session.started_s, len(executed))
        )  # fmt: skip
        remaining = _copy(state.remaining.pick(slice(self.replan_every, None)))
        photo = observe(self.robot, self.calibration, self.config.pixels_per_m)
        measured_paths = (*state.measured, *measured)
        photos = (*state.photos, photo)
        return _BatchProgress(executed, measured_paths, photos, state.deviation, remaining, memory, scene)

    def replan(self, state: _BatchProgress, changed: bool) -> _BatchProgress:
        remaining, photo = _copy(state.remaining), state.photos[-1]
        if self.replans and len(remaining) > 0:
            remaining = replan_rest(remaining, photo, state.scene, self.config, palette_srgb=self.palette_srgb)
        deviation = float(np.square(predict(remaining, photo, state.scene) - self.first).mean())
        self.log("deviation", deviation, len(state.executed))
        return replace(state, remaining=remaining, deviation=(*state.deviation, deviation))


def observe(robot: Robot, calibration: CameraCalibration, pixels_per_m: float) -> Image:
    """A photograph of the whole canvas, sRGB [H, W, 3]."""
    return rectify(robot.photo(), calibration, (0.0, 0.0, *robot.canvas_size_m), pixels_per_m)


def as_linear(photo: Image) -> Array:
    """A photograph uint8 sRGB [H, W, 3] in linear light."""
    return srgb_to_linear(to_float(photo))


def as_picture(light: Array) -> Image:
    """Linear light [H, W, 3] as a picture uint8 sRGB."""
    return to_uint8(linear_to_srgb(np.clip(light, 0, 1)))


def predict(strokes: PlannedPaths, photo: Image, scene: Scene) -> Array:
    """The canvas after the strokes, sRGB [H, W, 3], predicted from a photograph [H, W, 3]."""
    return linear_to_srgb(render_plan(strokes, as_linear(photo), scene))


def replan_rest(remaining: S, photo: Image, scene: Scene, config: PlanConfig, *, palette_srgb: FloatArray) -> S:
    """As many strokes as remain, optimised on the canvas as photographed, sRGB [H, W, 3].

    A brush leaves gaps where its paint runs low, and no gradient moves a stroke to a gap that it does not touch. With
    paints, sRGB [K, 3], useless strokes are therefore first relocated to where the photograph differs from the target.
    """
    canvas, strokes = as_linear(photo), _copy(remaining)
    if scene.tool.color_srgb is None and config.relocate_share > 0 and config.objectives.print_weight > 0:
        strokes = relocated(strokes, canvas, scene, config, palette_srgb=palette_srgb)
    optimise(
        strokes, canvas, scene, config, iterations=config.iterations_replan, free_color=False,
        rate=config.replan_rate, log=_ignore,
    )  # fmt: skip
    strokes.inherited = None
    return strokes


@dataclass(frozen=True, eq=False)
class PaintContext:
    """What the robot plans a painting with: tool, stroke model, canvas and planner."""

    tool: Tool
    brush: Brush
    canvas_size_m: tuple[float, float]
    planner: PlanConfig
    style: Style | None = None
    """For planners whose objectives include a style."""
    meaning: Meaning | None = None
    """For planners whose objectives include words or what is seen in the target."""
    threads: int = 1
    weights: Weights | None = None
    """Of the objectives, in place of the planner's."""
    max_speed_m_s: float = math.inf
    """That the robot allows."""
    shapes: Shapes | None = None
    """Of its strokes; None for Bézier strokes."""
    hands: Mapping[str, PaintContext] = field(default_factory=dict)
    """By the name of a person's hand, what is planned in it with."""

    def in_hand(self, hand: str | None) -> PaintContext:
        """The context for plans in a person's hand; None for the robot's own strokes."""
        return self if hand is None else self.hands[hand]

    def of(self, strokes: PlannedPaths) -> PaintContext:
        """The context in which these strokes were planned."""
        return self.hands.get(hand_of(strokes) or "", self)

    def about(self, words: str, expression: Expression = PLAIN) -> PaintContext:
        """The context for plans of what these words ask for, in this expression; "" for none."""
        tool = expression.tool(self.tool, self.max_speed_m_s)
        if self.weights is None and tool is self.tool:
            return self
        hands = {hand: context.about(words, expression) for hand, context in self.hands.items()}
        if self.weights is None:
            return replace(self, tool=tool, hands=hands)
        text = TextConfig(self.weights.text, words) if self.weights.text > 0 and words else None
        is_weighed = text is not None or self.weights.print + self.weights.semantic > 0
        objectives = replace(
            self.planner.objectives, print_weight=self.weights.print if is_weighed else 1.0,
            semantic_weight=self.weights.semantic, text=text,
        )  # fmt: skip
        return replace(self, tool=tool, planner=replace(self.planner, objectives=objectives), hands=hands)

    def scene(self, target: Array, start: Start) -> Scene:
        """A target [H, W, 3] (linear light) on a canvas in the state ``start``."""
        return Scene(self.tool, self.brush, self.canvas_size_m, target, start, self.style, self.meaning, self.threads)


def hand_of(strokes: PlannedPaths) -> str | None:
    """Whose hand strokes are in; None for the robot's own."""
    if isinstance(strokes, ShapedStrokes) and isinstance(strokes.shapes, StyleDecoder):
        return strokes.shapes.hand
    return None


def first_plan(
    context: PaintContext,
    canvas: Image,
    goal: Image,
    *,
    count: int,
    start: Start,
    log: Callable[[str, float, int], None],
) -> tuple[PlannedPaths, FloatArray]:
    """Up to ``count`` strokes from a canvas to a goal, uint8 sRGB [H, W, 3] both, and their palette, sRGB [K, 3].

    In a person's hand, ``count`` stands for a length of line; see ``plan_strokes``. Strokes that increase the objective
    are removed. A goal that equals the canvas needs none.
    """
    if np.array_equal(goal, canvas):
        return no_strokes(), np.zeros((0, 3))
    scene = context.scene(as_linear(goal), start)
    strokes, palette = plan_strokes(
        as_linear(canvas), scene, count, config=context.planner, shapes=context.shapes, log=log
    )
    return without_useless(strokes, as_linear(canvas), scene, context.planner), palette


def replanned(
    context: PaintContext, remaining: S, canvas: Image, *, goal: Image, start: Start, palette_srgb: FloatArray
) -> S:
    """The remaining strokes, replanned on the canvas as it is now (thesis 4.3.5); see ``replan_rest``. Fixed strokes
    stay as they are."""
    if not len(remaining) or remaining.is_fixed:
        return _copy(remaining)
    context = context.of(remaining)
    scene = context.scene(as_linear(goal), start)
    return replan_rest(remaining, canvas, scene, context.planner, palette_srgb=palette_srgb)


def replanned_and_pruned(
    context: PaintContext, remaining: S, canvas: Image, *, goal: Image, start: Start, palette_srgb: FloatArray
) -> S:
    """``replanned`` on a canvas that a person has changed: strokes that increase the objective now are removed."""
    if remaining.is_fixed:
        return _copy(remaining)
    context = context.of(remaining)
    moved = replanned(context, remaining, canvas, goal=goal, start=start, palette_srgb=palette_srgb)
    return without_useless(moved, as_linear(canvas), context.scene(as_linear(goal), start), context.planner)


def predict_canvas(context: PaintContext, strokes: PlannedPaths, canvas: Image, start: Start) -> Array:
    """The canvas after the strokes, linear light [H, W, 3], predicted from a picture of the canvas [H, W, 3]."""
    light = as_linear(canvas)
    return np.clip(render_plan(_copy(strokes), light, context.of(strokes).scene(light, start)), 0, 1)


def commands(context: PaintContext, strokes: PlannedPaths) -> list[PlannedStroke]:
    """The strokes as paths that the robot executes."""
    context = context.of(strokes)
    return strokes.planned(context.tool, context.brush.path_points)


def dips_of(context: PaintContext, strokes: PlannedPaths, memory: Memory) -> list[str]:
    """Sentences on the dips of a plan that is executed from ``memory`` on; none for a tool with its own ink."""
    tool, depletion = context.tool, context.of(strokes).brush.depletion
    if not tool.dips or not len(strokes):
        return []
    planned = commands(context, strokes)
    count = sum(stroke.dip for stroke in with_dips(planned, tool, memory, depletion))
    times = "once" if count == 1 else f"{count} times"
    long = too_long(planned, tool, depletion)
    return [f"The {tool.name} is dipped {times}.", *([f"{long[0].upper()}{long[1:]}"] if long else [])]


def objective_value(context: PaintContext, image: Array, goal: Image, start: Start) -> float:
    """The planner's objective for an image [H, W, 3] (linear light)."""
    return objective_for(context.scene(as_linear(goal), start), context.planner)(image)[0]


def keep_persons_paint(goal: Image, before: Image, now: Image) -> Image:
    """The goal [H, W, 3] with what a person painted between two pictures of the canvas, so that the robot keeps it."""
    rim = np.ones((3, 3), np.uint8)
    painted = cv2.dilate(_changed(before, now).astype(np.uint8), rim).astype(bool)
    return np.where(painted[..., None], now, goal)


def _changed(before: Image, now: Image) -> NDArray[np.bool_]:
    """[H, W] where two pictures of the canvas differ."""
    return np.asarray(np.abs(to_float(now) - to_float(before)).max(axis=2) > _CHANGED)


def add_persons_paint(memory: Memory, before: Image, now: Image, clock_s: float) -> Memory:
    """The memory with fresh paint where a person changed the canvas between two pictures [H, W, 3]."""
    changed = _changed(before, now)
    rows, columns = memory.ink.shape
    share = cv2.resize(changed.astype(np.float32), (columns, rows), interpolation=cv2.INTER_AREA).astype(np.float64)
    painted_at_s = np.where(share > 0, clock_s, memory.painted_at_s)
    return replace(memory, ink=np.maximum(memory.ink, share), painted_at_s=painted_at_s)


def due_for_dip(memory: Memory, tool: Tool) -> Memory:
    """The memory of a tool that has waited: its paint has dried, so the tool is dipped before the next stroke."""
    return replace(memory, since_reload=max(memory.since_reload, tool.most_strokes_per_dip)) if tool.dips else memory


def _copy(strokes: S) -> S:
    """A copy whose inherited state is computed again."""
    copy = strokes.pick(slice(None))
    copy.inherited = None
    return copy


def _ignore(_name: str, _value: float, _step: int) -> None:
    """Curves of single replannings are not logged."""
