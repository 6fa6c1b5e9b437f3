"""A painting session beside a person: the closed loop with checkpoints, recording, photo checks and commands.

The state is on disk after every stroke (``checkpoint.py``). So a session can be resumed wherever the last one ended:
by a fault, by a person, or by a computer that failed during a stroke.
"""

from __future__ import annotations

import json
import shutil
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.atomic import atomic_write
from pentimento.contracts.covariates import StrokeEvent, advance, fresh_memory
from pentimento.contracts.errors import ConfigError, PentimentoError
from pentimento.contracts.frames import image_shape
from pentimento.contracts.images import write_png
from pentimento.contracts.observations import Photo
from pentimento.contracts.plan import PlannedStroke
from pentimento.control.camera import PATIENCE_S, Camera, PaintingFault, visible_mark, visible_share
from pentimento.control.checkpoint import PaintingState, Phase, load_state, save_state
from pentimento.control.drawn import drawn_strokes
from pentimento.control.execute import Session, execute_stroke
from pentimento.control.guard import GuardedRobot, Watchdog
from pentimento.control.loop import Hooks, Interrupt, run_loop
from pentimento.control.open_robot import RobotTraits
from pentimento.control.painter import (
    PaintContext,
    add_persons_paint,
    as_picture,
    due_for_dip,
    first_plan,
    predict_canvas,
    replanned,
    replanned_and_pruned,
)
from pentimento.control.person import Control, Order
from pentimento.control.pictures import GOALS, PLAN, write_pictures
from pentimento.control.recording import StrokeRecording
from pentimento.planning.strokes.bezier import Strokes, to_planned
from pentimento.planning.strokes.config import no_log
from pentimento.planning.strokes.memory import Start
from pentimento.robots.tools import needs_dip

FloatArray = NDArray[np.float64]
Picture = NDArray[np.uint8]

RECORD = "record"
TURNS = "turns"
"""Folder of the canvas at each of the person's turns, with what the person asked for and the goal of it."""

_FOR_A_TURN = ("choose", "draw")
"""Orders that mean something at a person's turn only."""
_OBSERVE_S = 30.0
"""Maximum duration of an observation; the tool is up."""
_PLAN_S = 300.0
"""Maximum duration of a replanning; the tool is up."""
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


@dataclass(frozen=True, eq=False)
class Proposal:
    """Goals to choose from."""

    goals: Sequence[Picture]
    """uint8 sRGB [H, W, 3] each."""
    messages: Sequence[str] = ()
    """What the person must know, such as "a poodle: drawn as a dog"."""


@dataclass(frozen=True, eq=False)
class PaintingSession:
    """A painting session's robot, plan context, folder, and connections to the person."""

    robot: GuardedRobot
    traits: RobotTraits
    context: PaintContext
    strokes: int
    """Maximum number of strokes of a plan."""
    replan_every: int
    """Strokes between two replannings."""
    folder: Path
    control: Control
    on_state: Callable[[PaintingState], None]
    """Called with every new state."""
    goals_for: Callable[[Picture, str], Proposal]
    """Goals for a canvas, uint8 sRGB [H, W, 3], and what a person asks for; ConfigError with a sentence for the person
    where that is not understood."""
    in_turns: bool = False
    """After the last stroke it is the person's turn; the painting is done when the person stops it."""


def begin(
    session: PaintingSession,
    goal_for: Callable[[Picture], Picture],
    *,
    log: Callable[[str, float, int], None],
) -> PaintingState:
    """Observe the canvas, compute the goal, plan, and save the first state. Nothing moves.

    Args:
        goal_for: the goal for a canvas, uint8 sRGB [H, W, 3] both.
        log: called with the objective at every iteration of the planner.
    """
    robot, context = session.robot, session.context
    robot.change_tool(context.tool)
    scale = context.planner.pixels_per_m
    canvas = np.full((*image_shape((0.0, 0.0, *context.canvas_size_m), scale), 3), _PAPER, np.uint8)
    if session.traits.has_camera:
        calibrated = session.traits.calibrated
        canvas = Camera(robot, context.canvas_size_m, scale, calibrated=calibrated).observe().picture
    goal = goal_for(canvas)
    start = Start(fresh_memory(context.canvas_size_m, context.tool.nominal_width_m), 0.0, 0)
    remaining, palette = first_plan(context, canvas, goal, count=session.strokes, start=start, log=log)
    state = PaintingState(
        remaining=remaining, pending=False, palette_srgb=palette, memory=start.memory, canvas=canvas, goal=goal,
        executed=0, sessions=0, shard=0, turns=0, lines=0, clock_s=0.0, robot_clock_s=robot.clock_s, unix_s=time.time(),
        phase="painting", message=f"{len(remaining)} strokes are planned.",
    )  # fmt: skip
    write_png(session.folder / PLAN, as_picture(predict_canvas(context, remaining, canvas, start)))
    write_pictures(session.folder, session.context, state, session.replan_every)
    save_state(session.folder, state)
    session.on_state(state)
    return state


def resume(session: PaintingSession, wish: str = "") -> PaintingState:
    """Paint the remaining strokes of the painting in the folder; the final state: done, or stopped by a person.

    Args:
        wish: what a person asks for instead, on the canvas as it is now; "" for nothing new.

    Raises:
        PaintingFault: a person is needed.
        PentimentoError, OSError: the robot or the computer failed.

    On any error the tool was lifted before, or a LiftError says that it could not be. The robot accepts no further
    command, and the state on disk can be resumed.
    """
    watchdog = Watchdog(session.robot.stop)
    try:
        task = _StrokeByStroke(session, watchdog)
        hooks = Hooks(interrupt=task.interrupt, checkpoint=task.checkpoint, on_action=task.check_marks)
        waited = session.in_turns and load_state(session.folder).phase in ("your turn", "choosing")
        state, interrupt, outcome = task.start(), None, None
        if wish or waited:
            state, interrupt = task.turn(state, Order("wish", wish) if wish else Order("your turn"))
        if interrupt != "stop":
            state, outcome = run_loop(task, state, hooks)
        if outcome is None:
            return task.checkpoint(replace(state, phase="stopped", message="Stopped by a person; resume to go on."))
        return task.checkpoint(replace(state, phase="done", message=outcome))
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

    recorded: Session
    recording: StrokeRecording
    """Both are set by ``start``."""

    def __init__(self, session: PaintingSession, watchdog: Watchdog) -> None:
        self.session, self.watchdog = session, watchdog
        self.robot, self.context = session.robot, session.context
        self.tool = session.context.tool
        self.over = False
        """The person stopped a painting in turns after its last stroke."""
        self.camera: Camera | None = None
        self.photo: Photo | None = None
        self.unseen: list[Strokes] = []
        """The last strokes, if they left no mark."""
        self.last_visible: tuple[Strokes, float] | None = None
        """The last stroke and the share of its predicted darkening that was visible, where it is known."""

    def start(self) -> PaintingState:
        """Prepare robot, camera and recording; the state from which this session continues."""
        state = load_state(self.session.folder)
        traits = self.session.traits
        self.watchdog.beat(traits.reach_s, "lifting the tool")
        self.robot.lift()
        self.watchdog.rest()  # a person may have to mount the tool and fill the paints
        self.robot.change_tool(self.tool)
        self._load(state.palette_srgb)
        self.watchdog.beat(_OBSERVE_S + PATIENCE_S, "the first look")
        canvas = state.canvas
        if traits.has_camera:
            scale = self.context.planner.pixels_per_m
            self.camera = Camera(self.robot, self.context.canvas_size_m, scale, calibrated=traits.calibrated)
            seen = self.camera.observe()
            self.photo, canvas = seen.photo, seen.picture
        # A real robot's clock may have restarted; the computer's clock then tells how much time has passed.
        passed_s = self.robot.clock_s - state.robot_clock_s if traits.clock_persists else time.time() - state.unix_s
        started_s = self.robot.clock_s - state.clock_s - max(passed_s, 0.0)
        self.recorded = Session(f"painting-{state.sessions}", started_s)
        self.recording = StrokeRecording(
            self.session.folder / RECORD, state.shard, self.recorded, tool=self.tool,
            canvas_size_m=self.context.canvas_size_m,
        )  # fmt: skip
        resumed = self._resumed(state, canvas) if state.sessions else replace(state, canvas=canvas)
        return self.checkpoint(replace(resumed, sessions=state.sessions + 1))

    def outcome(self, state: PaintingState) -> str | None:
        """See ``control.loop.Task``: the final message."""
        if len(state.remaining) or (self.session.in_turns and not self.over):
            return None
        if state.executed or self.session.in_turns:
            return f"{state.executed} strokes are made."
        return "No stroke was made: none that the plan may use brings the canvas nearer to its goal."

    def batch(self, state: PaintingState) -> Sequence[PlannedStroke]:
        """See ``control.loop.Task``."""
        return self._commands(state.remaining.pick(slice(0, self.session.replan_every)))

    def mark_pending(self, state: PaintingState) -> PaintingState:
        """See ``control.loop.Task``."""
        message = f"Stroke {state.executed + 1} of {state.executed + len(state.remaining)}."
        return replace(state, pending=True, phase="painting", message=message)

    def execute(self, state: PaintingState, action: PlannedStroke) -> PaintingState:
        """See ``control.loop.Task``: paint, observe and record one stroke."""
        number = state.executed + 1
        stroke, remaining = state.remaining.pick(slice(0, 1)), state.remaining.pick(slice(1, None))
        expected = predict_canvas(self.context, stroke, state.canvas, self._now(state))
        travels = 3 if needs_dip(self.tool, action, state.memory) else 1
        duration_s = travels * self.session.traits.reach_s + _MAX_SLOWDOWN * float(action.path[-1, 0])
        self.watchdog.beat(duration_s, f"stroke {number}")
        memory, executed = execute_stroke(
            self.robot, self.tool, action, palette_srgb=state.palette_srgb, memory=state.memory, session=self.recorded
        )
        self.watchdog.beat(_OBSERVE_S + PATIENCE_S, f"the look after stroke {number}")
        canvas, self.last_visible = as_picture(expected), None
        if self.camera is not None:
            assert self.photo is not None
            seen = self.camera.observe_strokes(state.canvas, [action.path], self.tool.nominal_width_m)
            self.recording.add(
                state.executed, executed, before=self.photo, after=seen.photo, camera=self.camera.calibration
            )
            canvas, self.photo = seen.picture, seen.photo
            length_m = float(np.linalg.norm(np.diff(action.path[:, 1:3], axis=0), axis=1).sum())
            area_px = length_m * self.tool.nominal_width_m * self.context.planner.pixels_per_m**2
            share = visible_mark(state.canvas, canvas, expected, pixels=_NEW_SHARE * area_px)
            self.last_visible = None if share is None else (stroke, share)
        return replace(state, remaining=remaining, pending=False, memory=memory, canvas=canvas, executed=number)

    def replan(self, state: PaintingState, changed: bool) -> PaintingState:
        """See ``control.loop.Task``. On a canvas that a person changed, strokes may be removed."""
        self.recording.next_batch()
        if self.session.in_turns and not len(state.remaining):
            write_pictures(self.session.folder, self.context, state, self.session.replan_every)
            state, interrupt = self.turn(state, Order("your turn"))
            self.over, state = interrupt == "stop", replace(state, phase="painting")
        return self._with_new_plan(state, changed)

    def interrupt(self, state: PaintingState) -> tuple[PaintingState, Interrupt | None]:
        """``control.loop.Hooks``: obey the person's command before the next stroke."""
        order = self.session.control.poll()
        while order is not None and order.command in _FOR_A_TURN:
            order = self.session.control.poll()
        if order is not None and order.command == "pause":
            state = self._wait_at_rest(state, "paused", "Paused; the tool is up.")
            while (order := self.session.control.wait()).command in ("pause", *_FOR_A_TURN):
                pass
        if order is None or order.command == "go on":
            return state, None
        return self.turn(state, order)

    def turn(self, state: PaintingState, order: Order) -> tuple[PaintingState, Interrupt]:
        """A person's turn, until the person goes on, stops, or asks for something that is understood."""
        if order.command == "your turn":
            state = self._wait_at_rest(state, "your turn", self._your_turn(state))
        while True:
            try:
                match order.command:
                    case "stop":
                        return state, "stop"
                    case "go on":
                        return self._after_turn(state), "changed"
                    case "wish":
                        return self.wished(state, order.value), "changed"
                    case "draw":
                        # Counted even if it is refused: the page then no longer shows it.
                        state = replace(state, lines=state.lines + 1)
                        state = self._wait_at_rest(self._drawn(state, order.value), "your turn", self._your_turn(state))
            except ConfigError as error:
                state = self._wait_at_rest(state, "your turn", f"{error} {self._your_turn(state)}")
            order = self.session.control.wait()

    def _your_turn(self, state: PaintingState) -> str:
        if len(state.remaining):
            return "It is your turn: draw, then say go on or what to add. The robot does not move."
        return "It is your turn: draw, or say what to add. Stop ends the painting."

    def wished(self, state: PaintingState, words: str) -> PaintingState:
        """A new goal for what a person asks for, on the canvas as it is now, and a plan in place of the old one.

        Raises:
            ConfigError: the words are not understood, or the person does not choose any of the goals.
        """
        self.robot.lift()
        state = self._after_turn(state)
        self.watchdog.beat(_PLAN_S, "a new goal")
        proposal = self.session.goals_for(state.canvas, words)
        state, goal = self._chosen(state, proposal)
        self.watchdog.beat(_PLAN_S, "a new plan")
        remaining, palette = first_plan(
            self.context, state.canvas, goal, count=self.session.strokes, start=self._now(state), log=no_log
        )
        self.watchdog.rest()  # a person may have to fill the paints
        self._load(palette)
        write_png(self.session.folder / TURNS / f"{state.turns:03d}_goal.png", goal)
        record = {"words": words, "executed_before": state.executed, "planned": len(remaining)}
        atomic_write(
            self.session.folder / TURNS / f"{state.turns:03d}.json", (json.dumps(record, indent=1) + "\n").encode()
        )
        message = " ".join([f"{len(remaining)} strokes are planned for: {words}.", *_sentences(proposal)])
        write_png(
            self.session.folder / PLAN,
            as_picture(predict_canvas(self.context, remaining, state.canvas, self._now(state))),
        )
        state = replace(state, remaining=remaining, palette_srgb=palette, goal=goal, phase="painting", message=message)
        write_pictures(self.session.folder, self.context, state, self.session.replan_every)
        return self.checkpoint(state)

    def _drawn(self, state: PaintingState, line: str) -> PaintingState:
        """Draw a line of the person's in the studio, with the robot's tool.

        Raises:
            ConfigError: the line cannot be read, or the robot is not the studio's.
        """
        if not self.session.traits.person_draws:
            raise ConfigError("Lines can be drawn on the page in the studio only; draw on the sheet.")
        for stroke in drawn_strokes(line, self.tool, self.context.canvas_size_m):
            self.watchdog.beat(3 * self.session.traits.reach_s + 2 * float(stroke.path[-1, 0]), "your stroke")
            if self.tool.dips:
                self.robot.wipe()
                self.robot.load_palette(stroke.color_srgb[None])
                self.robot.dip(0)
            self.robot.move(stroke.path)
        if self.tool.dips:
            self.robot.wipe()
        self._load(state.palette_srgb)
        self.watchdog.beat(_OBSERVE_S + PATIENCE_S, "the look after your stroke")
        return self._looked(state)

    def _load(self, palette_srgb: FloatArray) -> None:
        """Load the paints of a plan, if the tool takes any and the plan has any."""
        if self.tool.dips and len(palette_srgb):
            self.robot.load_palette(palette_srgb)

    def _chosen(self, state: PaintingState, proposal: Proposal) -> tuple[PaintingState, Picture]:
        """The goal that the person chooses, on the canvas as it is then; the only one at once.

        Raises:
            ConfigError: the person says something else, which is sent again.
        """
        goals = proposal.goals
        if len(goals) == 1:
            return state, goals[0]
        shutil.rmtree(self.session.folder / GOALS, ignore_errors=True)  # of an earlier turn
        for number, goal in enumerate(goals, 1):
            write_png(self.session.folder / GOALS / f"{number}.png", goal)
        message = f"Choose one of the goals: click it, or type its number, 1 to {len(goals)} (folder {GOALS})."
        self.session.control.forget("choose")  # among other goals
        state = self._wait_at_rest(state, "choosing", " ".join([message, *_sentences(proposal)]))
        order = self.session.control.wait()
        while order.command != "choose" or not (order.value.isdecimal() and 1 <= int(order.value) <= len(goals)):
            if order.command not in _FOR_A_TURN:
                self.session.control.send(order.command, order.value)
                raise ConfigError("None of the goals was chosen.")
            order = self.session.control.wait()
        self.watchdog.beat(_OBSERVE_S + PATIENCE_S, "the look after your choice")
        return self._looked(state), goals[int(order.value) - 1]

    def checkpoint(self, state: PaintingState) -> PaintingState:
        """``control.loop.Hooks``: save the state with the clocks of this moment."""
        state = replace(
            state, clock_s=self._clock_s(), robot_clock_s=self.robot.clock_s, unix_s=time.time(),
            shard=self.recording.shard + 1,
        )  # fmt: skip
        save_state(self.session.folder, state)
        self.session.on_state(state)
        return state

    def check_marks(self, state: PaintingState) -> None:
        """``control.loop.Hooks``: raise PaintingFault, and restore the strokes, when the last ones left no mark."""
        if self.last_visible is not None:
            stroke, share = self.last_visible
            self.unseen = [*self.unseen, stroke] if share < _MIN_VISIBLE else []
        if len(self.unseen) == _DRY_AFTER:
            remaining = reduce(Strokes.joined, [*self.unseen, state.remaining])
            self.checkpoint(replace(state, remaining=remaining, executed=state.executed - _DRY_AFTER))
            raise PaintingFault(
                "no mark",
                f"The last {_DRY_AFTER} strokes left no mark: fill the paint or change the pen, see that the tool "
                "touches the canvas, and resume; they are made again.",
            )

    def _with_new_plan(self, state: PaintingState, changed: bool) -> PaintingState:
        self.watchdog.beat(_PLAN_S, "replanning")
        adapt = replanned_and_pruned if changed else replanned
        remaining = adapt(self.context, state.remaining, state.canvas, goal=state.goal, start=self._now(state))
        state = replace(state, remaining=remaining, clock_s=self._clock_s())
        write_pictures(self.session.folder, self.context, state, self.session.replan_every)
        return state

    def _after_turn(self, state: PaintingState) -> PaintingState:
        """Observe what the person painted."""
        self.watchdog.beat(_OBSERVE_S + PATIENCE_S, "the look after your turn")
        message = "The robot goes on." if self.camera is None else "The robot looks at what you painted."
        self.unseen, self.last_visible = [], None
        state = self.checkpoint(replace(state, turns=state.turns + 1, phase="painting", message=message))
        state = self.checkpoint(self._looked(state))
        if self.camera is not None:
            write_png(self.session.folder / TURNS / f"{state.turns:03d}.png", state.canvas)
        return state

    def _looked(self, state: PaintingState) -> PaintingState:
        """The state with the canvas as the camera sees it now, and what a person painted there."""
        if self.camera is None:
            return state
        seen = self.camera.observe()
        memory = add_persons_paint(state.memory, state.canvas, seen.picture, self._clock_s())
        self.photo = seen.photo
        return replace(state, memory=due_for_dip(memory, self.tool), canvas=seen.picture)

    def _resumed(self, state: PaintingState, canvas: Picture) -> PaintingState:
        """The state of an earlier session, continued on the canvas as it is now."""
        if state.pending and self._was_executed(state, canvas):
            (stroke,) = self._commands(state.remaining.pick(slice(0, 1)))
            dip = needs_dip(self.tool, stroke, state.memory)
            started_s = state.clock_s + self.context.brush.timing.reach_s
            memory = advance(state.memory, StrokeEvent(stroke.path, started_s, dip, stroke.color_srgb))
            remaining = state.remaining.pick(slice(1, None))
            state = replace(state, remaining=remaining, executed=state.executed + 1, memory=memory)
        memory = due_for_dip(add_persons_paint(state.memory, state.canvas, canvas, self._clock_s()), self.tool)
        state = replace(state, pending=False, canvas=canvas, memory=memory, phase="painting")
        return self._with_new_plan(state, changed=True)

    def _was_executed(self, state: PaintingState, canvas: Picture) -> bool:
        """Whether the pending stroke is visible. A robot without a camera paints it again."""
        if self.camera is None:
            return False
        expected = predict_canvas(self.context, state.remaining.pick(slice(0, 1)), state.canvas, self._now(state))
        share = visible_share(state.canvas, canvas, expected)
        return share is not None and share > _EXECUTED

    def _wait_at_rest(self, state: PaintingState, phase: Phase, message: str) -> PaintingState:
        self.robot.lift()
        self.watchdog.rest()
        memory = due_for_dip(state.memory, self.tool)
        return self.checkpoint(replace(state, memory=memory, phase=phase, message=message))

    def _commands(self, strokes: Strokes) -> list[PlannedStroke]:
        return to_planned(strokes, self.tool, self.context.brush.path_points)

    def _now(self, state: PaintingState) -> Start:
        return Start(state.memory, self._clock_s(), state.executed)

    def _clock_s(self) -> float:
        return self.robot.clock_s - self.recorded.started_s


def _save_reason(session: PaintingSession, reason: str, error: BaseException) -> None:
    """Save why the session stopped. Where that fails, the last state stays as it is."""
    try:
        state = replace(load_state(session.folder), phase="stopped", message=reason)
        save_state(session.folder, state)
    except (PentimentoError, OSError) as failure:
        error.add_note(f"That it stopped could not be written down ({failure}); the last state is still there.")
    else:
        session.on_state(state)


def _sentences(proposal: Proposal) -> list[str]:
    return [f"{message[0].upper()}{message[1:]}." for message in proposal.messages]
