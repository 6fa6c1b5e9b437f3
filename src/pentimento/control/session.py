"""Painting beside a person: execute some strokes, look, replan the rest, until all are made, whatever happens.

What is known is on disk after every stroke (``state.py``), so that ``resume`` goes on from wherever a painting ended:
stopped by a fault, by a person, or by a computer that went down in the middle of a stroke.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from pentimento.calibration.observe import CameraCalibration
from pentimento.contracts.covariates import StrokeEvent, advance, fresh_memory
from pentimento.contracts.errors import PentimentoError
from pentimento.contracts.frames import image_shape
from pentimento.contracts.images import read_image, write_png
from pentimento.contracts.photo import Photo
from pentimento.contracts.plan import PlannedStroke
from pentimento.control.commands import Control, Word
from pentimento.control.execute import Session, execute_stroke
from pentimento.control.faults import PaintingFault
from pentimento.control.next_strokes import drawn_over
from pentimento.control.paint_context import (
    PaintContext,
    as_picture,
    first_plan,
    painted_by_a_person,
    predicted,
    replanned,
    still_wanted,
    to_be_dipped,
)
from pentimento.control.painting_state import Phase, State, load_state, save_state
from pentimento.control.photo_checks import PATIENCE_S, Eyes
from pentimento.control.recording import Recording
from pentimento.control.visible_marks import share_seen
from pentimento.control.watchdog import Watchdog
from pentimento.planning.strokes.bezier import Strokes, to_planned
from pentimento.planning.strokes.memory import Start
from pentimento.robots.dipping import needs_dip
from pentimento.robots.driver import Robot

FloatArray = NDArray[np.float64]
Picture = NDArray[np.uint8]

GOAL, PLAN, CANVAS, PREVIEW, NEXT = "goal.png", "plan.png", "canvas.png", "preview.png", "next.png"
"""Pictures in a painting's folder: what is aimed at; what was foretold at first; the canvas now; what is foretold now;
what comes next."""
RECORD = "record"

_LOOK_S, _PLAN_S = 30.0, 300.0
"""So long a look and a replanning may take; the tool is up in both."""
_PAPER = 245
"""The blank sheet that a robot without a camera is taken to stand before, sRGB."""
_SLOWER = 1.5
"""Times its commanded duration, a stroke may take."""
_UNSEEN, _MIN_SEEN, _MADE = 3, 0.2, 0.5
"""So many strokes in a row of which less than this share shows, and the tool is dry; of more than the last share, a
stroke was made."""


class StoppableRobot(Robot, Protocol):
    """A Robot that can be stopped for good from any thread, as ``control.safety.GuardedRobot``."""

    def stop(self, reason: str) -> None:
        """Stop, lift the tool, and refuse every later command."""


@dataclass(frozen=True)
class LoopTiming:
    """How a painting is made."""

    batch: int
    """Strokes between two replannings."""
    reach_s: float
    """So long the robot may take to a stroke's start; as long again for each wipe and dip. Later, it is stopped."""
    sees: bool
    """Whether the robot has a camera; without one, the canvas is taken to be what was foretold."""
    clock_goes_on: bool
    """Whether the robot's clock counts on when its process ends."""


Tell = Callable[[State], None]
"""Told of every new state."""


@dataclass(frozen=True, eq=False)
class Sitting:
    """Who paints, with what, where it is kept, and who may say a word."""

    robot: StoppableRobot
    paint_context: PaintContext
    timing: LoopTiming
    folder: Path
    control: Control
    tell: Tell
    calibrated: CameraCalibration | None = None
    """Of the rig's camera and canvas, where there is one."""


def begin(
    sitting: Sitting, goal_for: Callable[[Picture], Picture], strokes: int, log: Callable[[str, float, int], None]
) -> State:
    """Look, take the goal that ``goal_for`` gives for the canvas (uint8 sRGB [H, W, 3] both), plan, and show the plan.

    Nothing moves. ``log`` is told the objective at every iteration.
    """
    robot, paint_context = sitting.robot, sitting.paint_context
    robot.change_tool(paint_context.tool)
    scale = paint_context.planner.pixels_per_m
    canvas = np.full((*image_shape((0.0, 0.0, *paint_context.canvas_size_m), scale), 3), _PAPER, np.uint8)
    if sitting.timing.sees:
        canvas = Eyes(robot, paint_context.canvas_size_m, scale, sitting.calibrated).look().picture
    goal = goal_for(canvas)
    start = Start(fresh_memory(paint_context.canvas_size_m, paint_context.tool.nominal_width_m), 0.0, 0)
    left, palette = first_plan(paint_context, canvas, goal, strokes, start, log)
    write_png(sitting.folder / GOAL, goal)
    state = State(
        left=left, begun=False, palette_srgb=palette, memory=start.memory, canvas=canvas, made=0, sessions=0, shard=0,
        turns=0, clock_s=0.0, robot_clock_s=robot.clock_s, unix_s=time.time(), phase="painting",
        sentence=f"{len(left)} strokes are planned.",
    )  # fmt: skip
    write_png(sitting.folder / PLAN, as_picture(predicted(paint_context, left, canvas, start)))
    _show(sitting, state)
    save_state(sitting.folder, state)
    sitting.tell(state)
    return state


def carry_on(sitting: Sitting) -> State:
    """Paint what is left of the painting in the folder; the state in which it ends: done, or stopped by a person.

    Raises:
        PaintingFault: a person has to see to something first.
        PentimentoError, OSError: the robot or the computer failed.

    Whatever is raised, the tool was lifted before, or a LiftError says that it could not be; the robot takes no command
    any more, and the state on disk goes on from there.
    """
    watchdog = Watchdog(sitting.robot.stop)
    try:
        return _Painting(sitting, watchdog).run()
    except BaseException as error:
        reason = str(error) or "Interrupted."
        if watchdog.failure is not None:
            error.add_note(str(watchdog.failure))
        try:
            sitting.robot.stop(reason)
        finally:
            _say_stopped(sitting, reason, error)
        raise
    finally:
        watchdog.close()


class _Painting:
    """One session of a painting: from its start or resumption to its end."""

    def __init__(self, sitting: Sitting, watchdog: Watchdog) -> None:
        self.sitting, self.watchdog = sitting, watchdog
        self.robot, self.paint_context = sitting.robot, sitting.paint_context
        self.goal: Picture = read_image(sitting.folder / GOAL)
        state = load_state(sitting.folder)
        watchdog.beat(sitting.timing.reach_s, "lifting the tool")
        self.robot.lift()
        watchdog.rest()  # a person may have to fit the tool and fill the paints
        self.robot.change_tool(self.paint_context.tool)
        if self.paint_context.tool.dips:
            self.robot.load_palette(state.palette_srgb)
        watchdog.beat(_LOOK_S + PATIENCE_S, "the first look")
        self.eyes: Eyes | None = None
        self.photo: Photo | None = None
        canvas = state.canvas
        if sitting.timing.sees:
            self.eyes = Eyes(
                self.robot,
                self.paint_context.canvas_size_m,
                self.paint_context.planner.pixels_per_m,
                sitting.calibrated,
            )
            seen = self.eyes.look()
            self.photo, canvas = seen.photo, seen.picture
        # A real robot's clock may have begun anew, and the computer's then says how long nothing was done.
        since = self.robot.clock_s - state.robot_clock_s if sitting.timing.clock_goes_on else time.time() - state.unix_s
        began_s = self.robot.clock_s - state.clock_s - max(since, 0.0)
        self.session = Session(f"painting-{state.sessions}", began_s)
        self.recording = Recording(
            sitting.folder / RECORD,
            state.shard,
            self.session,
            self.paint_context.tool,
            self.paint_context.canvas_size_m,
        )
        self.unseen: list[Strokes] = []
        """The last strokes, as far as they left no mark."""
        self.state = state
        if state.sessions:
            self._take_up(canvas)
        else:
            self.state = replace(state, canvas=canvas)
        self._keep(sessions=state.sessions + 1)

    def run(self) -> State:
        """Batch by batch, to the end or until a person says stop."""
        while len(self.state.left):
            word = self._batch()
            if word == "stop":
                self._keep(phase="stopped", sentence="Stopped by a person; resume to go on.")
                return self.state
            self.recording.next_batch()
            self._replan(touched=word == "your turn")
        made = f"{self.state.made} strokes are made."
        none = "No stroke was made: none that the plan may use brings the canvas nearer to its goal."
        self._keep(phase="done", sentence=made if self.state.made else none)
        return self.state

    def _batch(self) -> Word | None:
        """A batch of strokes; the word that ended it early."""
        first = self.state.left.pick(slice(0, self.sitting.timing.batch))
        for planned in to_planned(first, self.paint_context.tool, self.paint_context.brush.path_points):
            word = self.sitting.control.heard()
            while word == "pause":
                self._rest("paused", "Paused; the tool is up.")
                word = self.sitting.control.wait()
            if word == "your turn":
                word = self._their_turn()
            if word in ("stop", "your turn"):
                return word
            self._stroke(planned)
        return None

    def _stroke(self, planned: PlannedStroke) -> None:
        """Make the first of the strokes that are left, look at it, and note it."""
        before, number = self.state, self.state.made + 1
        one, rest = before.left.pick(slice(0, 1)), before.left.pick(slice(1, None))
        meant = predicted(self.paint_context, one, before.canvas, self._start())
        self._keep(begun=True, phase="painting", sentence=f"Stroke {number} of {before.made + len(before.left)}.")
        travels = 3 if needs_dip(self.paint_context.tool, planned, before.memory) else 1
        self.watchdog.beat(
            travels * self.sitting.timing.reach_s + _SLOWER * float(planned.path[-1, 0]), f"stroke {number}"
        )
        memory, made = execute_stroke(
            self.robot, self.paint_context.tool, planned, before.palette_srgb, before.memory, self.session
        )
        self.watchdog.beat(_LOOK_S + PATIENCE_S, f"the look after stroke {number}")
        canvas, share = as_picture(meant), None
        if self.eyes is not None:
            assert self.photo is not None
            seen = self.eyes.look_after(before.canvas, [planned.path], self.paint_context.tool.nominal_width_m)
            self.recording.add(before.made, made, self.photo, seen.photo, self.eyes.calibration)
            canvas, self.photo = seen.picture, seen.photo
            share = share_seen(before.canvas, canvas, meant)
        self._keep(left=rest, begun=False, memory=memory, canvas=canvas, made=number)
        if share is not None:
            self.unseen = [*self.unseen, one] if share < _MIN_SEEN else []
        if len(self.unseen) == _UNSEEN:
            again = self.unseen[0].joined(self.unseen[1]).joined(self.unseen[2])
            self._keep(left=again.joined(rest), made=number - _UNSEEN)
            raise PaintingFault(
                "no mark",
                f"The last {_UNSEEN} strokes left no mark: fill the paint or change the pen, see that the tool touches "
                "the canvas, and resume; they are made again.",
            )

    def _replan(self, touched: bool) -> None:
        """Adapt the strokes that are left to the canvas; where a person touched it, some may be given up."""
        state = self.state
        self.watchdog.beat(_PLAN_S, "replanning")
        adapt = still_wanted if touched else replanned
        self._keep(left=adapt(self.paint_context, state.left, state.canvas, self.goal, self._start()))
        _show(self.sitting, self.state)

    def _their_turn(self) -> Word:
        """Wait until the person is ready and see what has changed; ``your turn`` again, or the person's ``stop``."""
        self._rest("your turn", "It is your turn: paint, then say go on. The robot does not move.")
        word = self.sitting.control.wait()
        while word not in ("go on", "stop"):
            word = self.sitting.control.wait()
        if word == "go on":
            self.watchdog.beat(_LOOK_S + PATIENCE_S, "the look after your turn")
            self._keep(turns=self.state.turns + 1, phase="painting", sentence="The robot looks at what you painted.")
            self._see_changes()
            return "your turn"
        return "stop"

    def _see_changes(self) -> None:
        """Take the canvas as it is now."""
        if self.eyes is None:
            return
        seen = self.eyes.look()
        memory = painted_by_a_person(self.state.memory, self.state.canvas, seen.picture, self._clock_s())
        self.photo = seen.photo
        self._keep(memory=to_be_dipped(memory, self.paint_context.tool), canvas=seen.picture)
        write_png(self.sitting.folder / "turns" / f"{self.state.turns:03d}.png", seen.picture)

    def _take_up(self, canvas: Picture) -> None:
        """Go on from a state of an earlier session, on the canvas as it is now."""
        state = self.state
        if state.begun and self._was_made(canvas):
            one = to_planned(
                state.left.pick(slice(0, 1)), self.paint_context.tool, self.paint_context.brush.path_points
            )[0]
            dip = needs_dip(self.paint_context.tool, one, state.memory)
            event = StrokeEvent(one.path, state.clock_s + self.paint_context.brush.timing.reach_s, dip, one.color_srgb)
            memory = advance(state.memory, event)
            state = replace(state, left=state.left.pick(slice(1, None)), made=state.made + 1, memory=memory)
        memory = painted_by_a_person(state.memory, state.canvas, canvas, self._clock_s())
        memory = to_be_dipped(memory, self.paint_context.tool)
        self.state = replace(state, begun=False, canvas=canvas, memory=memory, phase="painting")
        self._replan(touched=True)

    def _was_made(self, canvas: Picture) -> bool:
        """Whether the stroke that was on its way is there to see. A robot without a camera makes it again."""
        if self.eyes is None:
            return False
        meant = predicted(self.paint_context, self.state.left.pick(slice(0, 1)), self.state.canvas, self._start())
        share = share_seen(self.state.canvas, canvas, meant)
        return share is not None and share > _MADE

    def _rest(self, phase: Phase, sentence: str) -> None:
        self.robot.lift()
        self.watchdog.rest()
        self._keep(phase=phase, sentence=sentence)

    def _start(self) -> Start:
        return Start(self.state.memory, self._clock_s(), self.state.made)

    def _clock_s(self) -> float:
        return self.robot.clock_s - self.session.started_s

    def _keep(self, **changes: Any) -> None:
        """The state with these changes, on disk before anything else happens."""
        clocks: dict[str, Any] = {
            "clock_s": self._clock_s(),
            "robot_clock_s": self.robot.clock_s,
            "unix_s": time.time(),
        }
        state = replace(self.state, **changes, **clocks, shard=self.recording.shard + 1)
        save_state(self.sitting.folder, state)
        self.state = state
        self.sitting.tell(state)


def _show(sitting: Sitting, state: State) -> None:
    """Write the pictures of the canvas, of what it will look like, and of what comes next."""
    paint_context, start = sitting.paint_context, Start(state.memory, state.clock_s, state.made)
    next_ones = to_planned(
        state.left.pick(slice(0, sitting.timing.batch)), paint_context.tool, paint_context.brush.path_points
    )
    write_png(sitting.folder / CANVAS, state.canvas)
    write_png(sitting.folder / PREVIEW, as_picture(predicted(paint_context, state.left, state.canvas, start)))
    write_png(sitting.folder / NEXT, drawn_over(state.canvas, next_ones, paint_context.canvas_size_m))


def _say_stopped(sitting: Sitting, reason: str, error: BaseException) -> None:
    """Write why it stopped beside the last state. Where the disk takes nothing, that state stays as it is."""
    try:
        state = replace(load_state(sitting.folder), phase="stopped", sentence=reason)
        save_state(sitting.folder, state)
    except (PentimentoError, OSError) as failure:
        error.add_note(f"That it stopped could not be written down ({failure}); the last state is still there.")
    else:
        sitting.tell(state)
