"""A painting session beside a person: the closed loop with checkpoints, recording, photo checks and commands.

The state is on disk after every stroke (``checkpoint.py``). So a session can be resumed wherever the last one ended:
by a fault, by a person, or by a computer that failed during a stroke.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.covariates import StrokeEvent, advance, fresh_memory
from pentimento.contracts.errors import PentimentoError
from pentimento.contracts.frames import image_shape
from pentimento.contracts.images import write_png
from pentimento.contracts.plan import PlannedStroke
from pentimento.control.camera import Camera, PaintingFault, visible_mark, visible_share
from pentimento.control.checkpoint import PaintingState, Phase, load_state, save_state
from pentimento.control.drawing import DrawnPlan
from pentimento.control.execute import execute_stroke
from pentimento.control.expression import PLAIN, Expression
from pentimento.control.guard import Watchdog
from pentimento.control.loop import Hooks, Interrupt, run_loop
from pentimento.control.painter import (
    PaintContext,
    add_persons_paint,
    as_picture,
    commands,
    dips_of,
    due_for_dip,
    first_plan,
    predict_canvas,
    replanned,
    replanned_and_pruned,
)
from pentimento.control.person import Order
from pentimento.control.pictures import PLAN, write_pictures
from pentimento.control.turn import FOR_A_TURN, expression_in, note_turn, take_turn, words_in
from pentimento.control.undo import remember
from pentimento.control.workplace import OBSERVE_S, PLAN_S, PaintingSession, Workplace
from pentimento.planning.strokes.memory import Start
from pentimento.planning.strokes.paths import PlannedPaths
from pentimento.robots.refill import needs_dip

Picture = NDArray[np.uint8]

_PAPER = 245
"""sRGB value of the blank sheet that is assumed for a robot without a camera."""
_MAX_SLOWDOWN = 1.5
"""A stroke may take its commanded duration times this."""
_DRY_AFTER = 5
"""The tool counts as dry after so many strokes in a row that left no mark."""
_MIN_VISIBLE = 0.1
"""A stroke that shows less than this share of its predicted darkening left no mark."""
_NEW_SHARE = 0.35
"""Strokes of which less than this share was to darken the canvas tell nothing of the tool."""
_EXECUTED = 0.5
"""A pending stroke that shows more than this share of its predicted change was executed."""
_WAITING = ("your turn", "choosing", "undoing", "undone")
"""Phases in which the robot paints nothing before a person has answered, also after a fault."""


def begin(
    session: PaintingSession,
    goal_for: Callable[[Picture], Picture],
    *,
    log: Callable[[str, float, int], None],
    drawn: DrawnPlan | None = None,
) -> PaintingState:
    """Observe the canvas, compute the goal, plan, and save the first state. Nothing moves.

    Args:
        goal_for: the goal for a canvas, uint8 sRGB [H, W, 3] both.
        log: called with the objective at every iteration of the planner.
        drawn: a drawing that is the plan; the goal is then what it leaves on the canvas.
    """
    robot, context = session.robot, session.context
    robot.change_tool(context.tool)
    scale = context.planner.pixels_per_m
    canvas = np.full((*image_shape((0.0, 0.0, *context.canvas_size_m), scale), 3), _PAPER, np.uint8)
    if session.traits.has_camera:
        calibrated = session.traits.calibrated
        canvas = Camera(robot, context.canvas_size_m, scale, calibrated=calibrated).observe().picture
    start = Start(fresh_memory(context.canvas_size_m, context.tool.nominal_width_m), 0.0, 0)
    remaining: PlannedPaths
    if drawn is None:
        goal = goal_for(canvas)
        remaining, palette = first_plan(
            _asked(session).in_hand(session.control.hand), canvas, goal, count=session.strokes, start=start, log=log
        )
    else:
        remaining, palette = drawn.strokes, drawn.palette_srgb
        goal = as_picture(predict_canvas(context, remaining, canvas, start))
    state = PaintingState(
        remaining=remaining, pending=False, palette_srgb=palette, memory=start.memory, canvas=canvas, goal=goal,
        executed=0, sessions=0, shard=0, turns=0, lines=0, clock_s=0.0, robot_clock_s=robot.clock_s, unix_s=time.time(),
        phase="painting", hand=session.control.hand,
        message=" ".join([f"{len(remaining)} strokes are planned.", *dips_of(context, remaining, start.memory)]),
    )  # fmt: skip
    write_png(session.folder / PLAN, as_picture(predict_canvas(context, remaining, canvas, start)))
    write_pictures(session.folder, session.context, state, session.replan_every)
    save_state(session.folder, state)
    session.on_state(state)
    return state


def resume(session: PaintingSession, wish: str = "", expression: Expression = PLAIN) -> PaintingState:
    """Paint the remaining strokes of the painting in the folder; the final state: done, or stopped by a person. In the
    phase "undoing", the robot is to be closed, and the painting resumed after `undo.take_back`.

    Args:
        wish: what a person asks for instead, on the canvas as it is now; "" for nothing new.
        expression: how the wish is painted.

    Raises:
        PaintingFault: a person is needed.
        PentimentoError, OSError: the robot or the computer failed.

    On any error the tool was lifted before, or a LiftError says that it could not be. The robot accepts no further
    command, and the state on disk can be resumed.
    """
    watchdog = Watchdog(session.robot.stop)
    try:
        state, interrupt, outcome = load_state(session.folder), None, None
        waits = state.phase == "undone" or (session.in_turns and state.phase in ("your turn", "choosing"))
        first = Order("your turn", state.message if state.phase == "undone" else "")
        first = Order("wish", wish, expression) if wish else first
        at = Workplace(session, watchdog, state)
        task = _StrokeByStroke(at)
        hooks = Hooks(interrupt=task.interrupt, checkpoint=at.checkpoint, on_action=task.check_marks)
        state = task.start(state, state.phase if waits else "painting")
        if wish or waits:
            state, interrupt = task.turn(state, first)
            if interrupt == "changed" and len(state.remaining):
                state = at.checkpoint(task.replan(state, changed=True))
        if interrupt != "stop":
            state, outcome = run_loop(task, state, hooks)
        at.keep_photograph(state)
        if state.phase == "undoing":
            return state
        if outcome is None:
            return at.checkpoint(replace(state, phase="stopped", message="Stopped by a person; resume to go on."))
        return at.checkpoint(replace(state, phase="done", message=outcome))
    except BaseException as error:
        reason = str(error) or "Interrupted."
        if watchdog.failure is not None:
            error.add_note(str(watchdog.failure))
        try:
            session.robot.stop(reason)
        finally:
            _save_reason(session, reason, error)
        raise
    finally:
        watchdog.close()


class _StrokeByStroke:
    """``control.loop.Task`` of one session, whose actions are single strokes; and the loop's hooks."""

    def __init__(self, at: Workplace) -> None:
        self.at, self.session, self.context, self.tool = at, at.session, at.context, at.tool
        self.over = False
        """The person stopped a painting in turns after its last stroke."""
        self.unseen: list[PlannedPaths] = []
        """The last strokes, if they left no mark."""
        self.last_visible: tuple[PlannedPaths, float] | None = None
        """The last stroke and the share of its predicted darkening that was visible, where it is known."""

    def start(self, state: PaintingState, phase: Phase) -> PaintingState:
        """The state from which this session continues, on the canvas as it is now."""
        canvas = self.at.canvas
        resumed = self._resumed(state, canvas) if state.sessions else replace(state, canvas=canvas)
        if not state.sessions:
            note_turn(self.at, resumed)
        # Why the last session ended is no news; that strokes were undone is.
        message = "The painting is resumed." if state.sessions and phase != "undone" else state.message
        return self.at.checkpoint(replace(resumed, phase=phase, message=message, sessions=state.sessions + 1))

    def outcome(self, state: PaintingState) -> str | None:
        """See ``control.loop.Task``: the final message."""
        if len(state.remaining) or (self.session.in_turns and not self.over):
            return None
        if state.executed or self.session.in_turns:
            return f"{state.executed} strokes are made."
        return "No stroke was made: none that the plan may use brings the canvas nearer to its goal."

    def batch(self, state: PaintingState) -> Sequence[PlannedStroke]:
        """See ``control.loop.Task``."""
        if self.session.traits.in_studio:
            remember(self.session.folder, state.executed, self.at.recording.shard)
        return commands(_asked(self.session), state.remaining.pick(slice(0, self.session.replan_every)))

    def mark_pending(self, state: PaintingState) -> PaintingState:
        """See ``control.loop.Task``."""
        message = f"Stroke {state.executed + 1} of {state.executed + len(state.remaining)}."
        return replace(state, pending=True, phase="painting", message=message)

    def execute(self, state: PaintingState, action: PlannedStroke) -> PaintingState:
        """See ``control.loop.Task``: paint, observe and record one stroke."""
        number = state.executed + 1
        stroke, remaining = state.remaining.pick(slice(0, 1)), state.remaining.pick(slice(1, None))
        expected = predict_canvas(self.context, stroke, state.canvas, self.at.start_of(state))
        depletion = self.context.of(stroke).brush.depletion
        travels = 3 if needs_dip(self.tool, action, state.memory, depletion) else 1
        duration_s = travels * self.session.traits.reach_s + _MAX_SLOWDOWN * float(action.path[-1, 0])
        self.at.watchdog.beat(duration_s, f"stroke {number}")
        memory, executed = execute_stroke(
            self.at.robot, self.tool, action, palette_srgb=state.palette_srgb, memory=state.memory,
            session=self.at.recorded, depletion=depletion,
        )  # fmt: skip
        self.at.watchdog.beat(OBSERVE_S, f"the look after stroke {number}")
        canvas, self.last_visible = as_picture(expected), None
        if self.at.camera is not None:
            assert self.at.photo is not None
            seen = self.at.camera.observe_strokes(state.canvas, [action.path], self.tool.nominal_width_m)
            self.at.recording.add(
                state.executed, executed, before=self.at.photo, after=seen.photo, camera=self.at.camera.calibration
            )
            canvas, self.at.photo = seen.picture, seen.photo
            length_m = float(np.linalg.norm(np.diff(action.path[:, 1:3], axis=0), axis=1).sum())
            area_px = length_m * self.tool.nominal_width_m * self.context.planner.pixels_per_m**2
            share = visible_mark(state.canvas, canvas, expected, pixels=_NEW_SHARE * area_px)
            self.last_visible = None if share is None else (stroke, share)
        return replace(state, remaining=remaining, pending=False, memory=memory, canvas=canvas, executed=number)

    def replan(self, state: PaintingState, changed: bool) -> PaintingState:
        """See ``control.loop.Task``. On a canvas that a person changed, strokes may be removed."""
        self.at.recording.next_batch()
        if self.session.in_turns and not len(state.remaining):
            write_pictures(self.session.folder, self.context, state, self.session.replan_every)
            state, interrupt = self.turn(state, Order("your turn"))
            if state.phase == "undoing":
                self.over = True
                return state
            self.over, state = interrupt == "stop", replace(state, phase="painting")
        return self._with_new_plan(state, changed)

    def interrupt(self, state: PaintingState) -> tuple[PaintingState, Interrupt | None]:
        """``control.loop.Hooks``: obey the person's command before the next stroke."""
        order = self.session.control.poll()
        while order is not None and order.command in FOR_A_TURN:
            order = self.session.control.poll()
        if order is not None and order.command == "pause":
            state = self.at.rest(state, "paused", "Paused; the tool is up.")
            while (order := self.session.control.wait()).command in ("pause", *FOR_A_TURN):
                pass
        if order is None or order.command == "go on":
            return state, None
        return self.turn(state, order)

    def turn(self, state: PaintingState, order: Order) -> tuple[PaintingState, Interrupt]:
        """See ``turn.take_turn``."""
        self.unseen, self.last_visible = [], None
        return take_turn(self.at, state, order)

    def check_marks(self, state: PaintingState) -> None:
        """``control.loop.Hooks``: raise PaintingFault, and restore the strokes, when the last ones left no mark."""
        if self.last_visible is not None:
            stroke, share = self.last_visible
            self.unseen = [*self.unseen, stroke] if share < _MIN_VISIBLE else []
        if len(self.unseen) == _DRY_AFTER:
            remaining = reduce(PlannedPaths.joined, [*self.unseen, state.remaining])
            self.at.checkpoint(replace(state, remaining=remaining, executed=state.executed - _DRY_AFTER))
            raise PaintingFault(
                "no mark",
                f"The last {_DRY_AFTER} strokes left no mark: fill the paint or change the pen, see that the tool "
                "touches the canvas, and resume; they are made again.",
            )

    def _with_new_plan(self, state: PaintingState, changed: bool) -> PaintingState:
        self.at.watchdog.beat(PLAN_S, "replanning")
        adapt = replanned_and_pruned if changed else replanned
        remaining = adapt(
            _asked(self.session), state.remaining, state.canvas, goal=state.goal, start=self.at.start_of(state),
            palette_srgb=state.palette_srgb,
        )  # fmt: skip
        state = replace(state, remaining=remaining, clock_s=self.at.clock_s)
        write_pictures(self.session.folder, self.context, state, self.session.replan_every)
        self.at.keep_photograph(state)
        return state

    def _resumed(self, state: PaintingState, canvas: Picture) -> PaintingState:
        """The state of an earlier session, continued on the canvas as it is now."""
        if state.pending and self._was_executed(state, canvas):
            pending = state.remaining.pick(slice(0, 1))
            (stroke,) = commands(_asked(self.session), pending)
            dip = needs_dip(self.tool, stroke, state.memory, self.context.of(pending).brush.depletion)
            started_s = state.clock_s + self.context.brush.timing.reach_s
            memory = advance(state.memory, StrokeEvent(stroke.path, started_s, dip, stroke.color_srgb))
            remaining = state.remaining.pick(slice(1, None))
            state = replace(state, remaining=remaining, executed=state.executed + 1, memory=memory)
        memory = due_for_dip(add_persons_paint(state.memory, state.canvas, canvas, self.at.clock_s), self.tool)
        # The goal stays: light that changed, paint that dried or a stroke cut short is nothing that a person asked for.
        state = replace(state, pending=False, canvas=canvas, memory=memory)
        return self._with_new_plan(state, changed=True)

    def _was_executed(self, state: PaintingState, canvas: Picture) -> bool:
        """Whether the pending stroke is visible. A robot without a camera paints it again."""
        if self.at.camera is None:
            return False
        expected = predict_canvas(
            self.context, state.remaining.pick(slice(0, 1)), state.canvas, self.at.start_of(state)
        )
        share = visible_share(state.canvas, canvas, expected)
        return share is not None and share > _EXECUTED


def _asked(session: PaintingSession) -> PaintContext:
    """The context for plans of what a person asked for last."""
    return session.context.about(words_in(session.folder), expression_in(session.folder))


def _save_reason(session: PaintingSession, reason: str, error: BaseException) -> None:
    """Save why the session stopped. Where that fails, the last state stays as it is.

    What waits for a person, or for an undo, still does so when the painting is resumed.
    """
    try:
        state = load_state(session.folder)
        phase: Phase = state.phase if state.phase in _WAITING else "stopped"
        save_state(session.folder, replace(state, phase=phase, message=reason))
    except (PentimentoError, OSError) as failure:
        error.add_note(f"That it stopped could not be written down ({failure}); the last state is still there.")
    else:
        session.on_state(replace(state, phase="stopped", message=reason))
