"""A painting session's parts: what it is given, and the robot at the canvas with its camera, recording and state.

``session.py`` executes strokes there, ``turn.py`` takes a person's turn there.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from pentimento.calibration.observe import rectify
from pentimento.contracts.images import write_png
from pentimento.contracts.observations import Photo
from pentimento.control.camera import PATIENCE_S, Camera
from pentimento.control.checkpoint import PaintingState, Phase, save_state
from pentimento.control.execute import Session
from pentimento.control.guard import GuardedRobot, Watchdog
from pentimento.control.layout import Wish
from pentimento.control.open_robot import RobotTraits
from pentimento.control.painter import PaintContext, add_persons_paint, due_for_dip, keep_persons_paint
from pentimento.control.person import Control
from pentimento.control.pictures import PHOTOGRAPH, enlarged
from pentimento.control.recording import RECORD, StrokeRecording
from pentimento.planning.strokes.memory import Start

FloatArray = NDArray[np.float64]
Picture = NDArray[np.uint8]

OBSERVE_S: Final = 30.0 + PATIENCE_S
"""Maximum duration of an observation, with a hand in the picture; the tool is up."""
PLAN_S: Final = 300.0
"""Maximum duration of a planning; the tool is up."""


@dataclass(frozen=True, eq=False)
class Proposal:
    """Goals to choose from."""

    goals: Sequence[Picture]
    """uint8 sRGB [H, W, 3] each."""
    messages: Sequence[str] = ()
    """What the person must know, such as "a poodle: drawn as a dog"."""
    things: Sequence[Sequence[Wish]] = ()
    """What is drawn in each goal, and where on the largest centred square of the canvas; none where not known."""


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


class Workplace:
    """The robot at the canvas during one session."""

    camera: Camera | None
    """None for a robot without one: the canvas is then assumed to be as predicted."""
    photo: Photo | None
    """The last photograph."""

    def __init__(self, session: PaintingSession, watchdog: Watchdog, state: PaintingState) -> None:
        """Prepare robot, camera and recording to go on from a state; ``canvas`` is the first look."""
        self.session, self.watchdog = session, watchdog
        self.robot, self.context = session.robot, session.context
        self.tool = session.context.tool
        self.camera, self.photo, self.canvas = None, None, state.canvas
        traits = session.traits
        watchdog.beat(traits.reach_s, "lifting the tool")
        self.robot.lift()
        watchdog.rest()  # a person may have to mount the tool and fill the paints
        self.robot.change_tool(self.tool)
        self.load(state.palette_srgb)
        watchdog.beat(OBSERVE_S, "the first look")
        if traits.has_camera:
            scale = self.context.planner.pixels_per_m
            self.camera = Camera(self.robot, self.context.canvas_size_m, scale, calibrated=traits.calibrated)
            seen = self.camera.observe()
            self.photo, self.canvas = seen.photo, seen.picture
        # A real robot's clock may have restarted; the computer's clock then tells how much time has passed.
        passed_s = self.robot.clock_s - state.robot_clock_s if traits.clock_persists else time.time() - state.unix_s
        started_s = self.robot.clock_s - state.clock_s - max(passed_s, 0.0)
        self.recorded = Session(f"painting-{state.sessions}", started_s)
        self.recording = StrokeRecording(
            session.folder / RECORD, state.shard, self.recorded, tool=self.tool,
            canvas_size_m=self.context.canvas_size_m,
        )  # fmt: skip

    @property
    def clock_s(self) -> float:
        """The time since the painting's start."""
        return self.robot.clock_s - self.recorded.started_s

    def start_of(self, state: PaintingState) -> Start:
        """What a plan of the state's remaining strokes starts from, now."""
        return Start(state.memory, self.clock_s, state.executed)

    def checkpoint(self, state: PaintingState) -> PaintingState:
        """Save and show the state, with the clocks of this moment."""
        state = replace(
            state, clock_s=self.clock_s, robot_clock_s=self.robot.clock_s, unix_s=time.time(),
            shard=self.recording.shard + 1, hand=self.session.control.hand,
        )  # fmt: skip
        save_state(self.session.folder, state)
        self.session.on_state(state)
        return state

    def photograph(self, state: PaintingState, pixels_per_m: float) -> Picture:
        """The canvas as photographed last, at a resolution; without a camera, the canvas as predicted."""
        if self.camera is None or self.photo is None:
            return state.canvas
        return rectify(self.photo, self.camera.calibration, (0.0, 0.0, *self.context.canvas_size_m), pixels_per_m)

    def keep_photograph(self, state: PaintingState) -> None:
        """Write the canvas as photographed last, at the camera's own resolution and enlarged."""
        width_m = self.context.canvas_size_m[0]
        scale = state.canvas.shape[1] / width_m
        if self.camera is not None:
            corners_px = self.camera.calibration.to_camera(np.array([[0.0, 0.0], [width_m, 0.0]]))
            scale = float(np.linalg.norm(corners_px[1] - corners_px[0])) / width_m
        write_png(self.session.folder / PHOTOGRAPH, enlarged(self.photograph(state, scale)))

    def rest(self, state: PaintingState, phase: Phase, message: str) -> PaintingState:
        """Lift the tool and wait for a person without a time limit."""
        self.robot.lift()
        self.watchdog.rest()
        self.keep_photograph(state)
        memory = due_for_dip(state.memory, self.tool)
        return self.checkpoint(replace(state, memory=memory, phase=phase, message=message))

    def look(self, state: PaintingState, what: str) -> PaintingState:
        """The state with the canvas as the camera sees it now; what a person painted there becomes part of the goal."""
        self.watchdog.beat(OBSERVE_S, what)
        if self.camera is None:
            return state
        seen = self.camera.observe()
        memory = add_persons_paint(state.memory, state.canvas, seen.picture, self.clock_s)
        goal = keep_persons_paint(state.goal, state.canvas, seen.picture)
        self.photo = seen.photo
        return replace(state, memory=due_for_dip(memory, self.tool), canvas=seen.picture, goal=goal)

    def load(self, palette_srgb: FloatArray) -> None:
        """Load the paints of a plan, if the tool takes any and the plan has any."""
        if self.tool.dips and len(palette_srgb):
            self.robot.load_palette(palette_srgb)
