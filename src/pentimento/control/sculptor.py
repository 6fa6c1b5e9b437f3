"""Sculpting: push a few times, look at the clay, replan the rest, until nothing helps any more (thesis 7.3.5)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.ranges import above_zero, at_least
from pentimento.contracts.scan import Scan
from pentimento.control.execute import Session
from pentimento.control.execute_push import execute_push, levelled_m, record_push
from pentimento.planning.objectives import ClayObjective
from pentimento.planning.pushes.config import Reach, SculptorConfig
from pentimento.planning.pushes.holes import fill_holes
from pentimento.planning.pushes.plan import PushPlan, plan
from pentimento.planning.pushes.rollout import Foresight, PushModel
from pentimento.robots.end_effectors import EndEffector
from pentimento.robots.sculpting import SculptingRobot

Array = NDArray[np.float32]
FloatArray = NDArray[np.float64]

Stopped = Literal["all actions were made", "the models know of no action that helps", "acting no longer helped"]


@dataclass(frozen=True)
class Execution:
    """How a plan is carried out."""

    batch: int
    """Actions between two plans."""
    patience: int
    """So many actions may pass without a new least of the measured objective."""
    dwell_s: float
    retract_speed_m_s: float

    def __post_init__(self) -> None:
        at_least(self, 1, "batch", "patience")
        at_least(self, 0, "dwell_s")
        above_zero(self, "retract_speed_m_s")


@dataclass(frozen=True)
class Sculpture:
    """What came of a goal."""

    rows: list[dict[str, Any]]
    """Of the ``pushes`` contract, one for each action."""
    actions: FloatArray
    """[N, 5]."""
    heights_m: Array
    """[N + 1, H, W], levelled and without holes: before the first and after each action."""
    values: FloatArray
    """[N + 1]: the objective of each of these."""
    first: PushPlan
    """The plan that it began with."""
    foreseen_m: Array
    """[N, H, W]: what the plan of the time expected after each action."""
    stopped: Stopped
    holes: int
    """Pixels of all scans that were not measured, and filled."""

    @property
    def helped(self) -> bool:
        """Whether the clay is nearer to the goal than if nothing had been done."""
        return bool(self.values[-1] < self.values[0])


def reach_for(end_effector: EndEffector, area_m: tuple[float, float], edge_m: float) -> Reach:
    """The actions that an end-effector may be asked for on a slab, ``edge_m`` from its edge."""
    return Reach(
        (edge_m, edge_m, area_m[0] - edge_m, area_m[1] - edge_m),
        end_effector.travel_m,
        end_effector.depth_m,
        end_effector.nominal_width_m,
        travels=end_effector.kind == "push",
    )


def seen_m(scan: Scan) -> tuple[Array, int]:
    """The heights [H, W] to plan on, levelled, and how many holes were filled."""
    heights, holes = fill_holes(levelled_m(scan))
    return heights.astype(np.float32), holes


@dataclass(frozen=True)
class Progress:
    """A sculpture between two pushes, or with one on its way."""

    scan: Scan
    """The last."""
    actions: tuple[FloatArray, ...]
    """That were made."""
    heights_m: tuple[Array, ...]
    """Levelled and without holes: before the first and after each action."""
    values: tuple[float, ...]
    expected_m: tuple[Array, ...]
    """What the plan of the time expected after each action."""
    left: FloatArray
    """[K, 5]: planned, and still to be made."""
    foreseen_m: Array
    """[K, H, W] after each of them."""
    due: int
    """So many of them are made before it is planned again."""
    holes: int
    pushing: bool
    """The first of ``left`` was sent to the robot, which has not said that it is made."""


Keep = Callable[[Progress, dict[str, Any] | None], None]
"""Told of every new progress, with the row of the action that was just made, if one was."""


@dataclass(frozen=True)
class Sculptor:
    """Who sculpts what, with what."""

    robot: SculptingRobot
    """Guarded, with whatever end-effector in its hand."""
    end_effector: EndEffector
    material: str
    goal_m: Array
    """[H, W]"""
    members: Sequence[PushModel]
    config: SculptorConfig
    execution: Execution
    count: int
    """Actions, at most."""
    session: Session
    item: int
    """The goal's number in the session; its rows' order goes on from ``1000 · item``."""

    def begin(self) -> tuple[Progress, PushPlan]:
        """Look and plan; nothing moves."""
        self.robot.change_tool(self.end_effector)
        scan = self.robot.scan()
        height, holes = seen_m(scan)
        first = plan(height, self.foresight, self._reach, self.config, self.count, (self.item, 0))
        value = float(self.foresight.objective.values(height))
        due = min(self.execution.batch, len(first.actions))
        return (
            Progress(scan, (), (height,), (value,), (), first.actions, first.foreseen_m[1:], due, holes, False), first
        )  # fmt: skip

    def look_again(self, progress: Progress) -> Progress:
        """After a push of which nobody knows how far it went: the clay as it is now, and a new plan.

        No action and no row is counted for that push.
        """
        self.robot.change_tool(self.end_effector)
        scan = self.robot.scan()
        height, holes = seen_m(scan)
        heights = (*progress.heights_m[:-1], height)
        values = (*progress.values[:-1], float(self.foresight.objective.values(height)))
        seen = replace(
            progress, scan=scan, heights_m=heights, values=values, holes=progress.holes + holes, pushing=False
        )  # fmt: skip
        return self._replanned(seen)

    def carry_on(self, progress: Progress, keep: Keep) -> tuple[Progress, Stopped]:
        """Go on until all actions are made, or nothing helps any more.

        Raises:
            PentimentoError: the robot failed, or the guard refused a push; ``progress`` as it was kept last goes on
                from there.
        """
        self.robot.change_tool(self.end_effector)
        while len(progress.actions) < self.count:
            if len(progress.left) == 0:
                return progress, "the models know of no action that helps"
            keep(replace(progress, pushing=True), None)
            progress, row = self._pushed(progress)
            keep(progress, row)
            if progress.due == 0:
                if len(progress.values) - 1 - int(np.argmin(progress.values)) >= self.execution.patience:
                    return progress, "acting no longer helped"
                if len(progress.actions) < self.count:
                    progress = self._replanned(progress)
                    keep(progress, None)
        return progress, "all actions were made"

    @cached_property
    def foresight(self) -> Foresight:
        """What the models expect, judged by the goal."""
        objective = ClayObjective(self.goal_m, self.members[0].window_m, self.config.weights)
        return Foresight(self.members, objective, self.config.caution)

    @property
    def _reach(self) -> Reach:
        return reach_for(self.end_effector, self.robot.area_m, self.config.edge_m)

    def _pushed(self, progress: Progress) -> tuple[Progress, dict[str, Any]]:
        action, execution = progress.left[0], self.execution
        made = execute_push(
            self.robot, self.end_effector, action, progress.scan,
            self.end_effector.speed_m_s, execution.dwell_s, execution.retract_speed_m_s,
        )  # fmt: skip
        order = 1000 * self.item + len(progress.actions)
        row = record_push(self.session, order, order, self.end_effector, self.material, made)
        height, holes = seen_m(made.after)
        value = float(self.foresight.objective.values(height))
        after = Progress(
            made.after, (*progress.actions, action), (*progress.heights_m, height), (*progress.values, value),
            (*progress.expected_m, progress.foreseen_m[0]), progress.left[1:], progress.foreseen_m[1:],
            progress.due - 1, progress.holes + holes, False,
        )  # fmt: skip
        return after, row

    def _replanned(self, progress: Progress) -> Progress:
        made = len(progress.actions)
        now = plan(
            progress.heights_m[-1], self.foresight, self._reach, self.config, self.count - made, (self.item, made),
            progress.left if made else None,
        )  # fmt: skip
        due = min(self.execution.batch, len(now.actions))
        return replace(progress, left=now.actions, foreseen_m=now.foreseen_m[1:], due=due)


def sculpt(
    robot: SculptingRobot,
    end_effector: EndEffector,
    material: str,
    goal_m: Array,
    members: Sequence[PushModel],
    config: SculptorConfig,
    execution: Execution,
    count: int,
    session: Session,
    item: int,
    log: Callable[[str, float, int], None],
) -> Sculpture:
    """Bring the clay nearer to a goal [H, W] with up to ``count`` actions, ``execution.batch`` of them a plan.

    It ends early where no action is expected to help, and where the last ones did not: a model that is wrong in the
    state that it has got into goes on making it worse.

    Args:
        robot: guarded, with whatever end-effector in its hand.
        item: the goal's number in the session; its rows' order goes on from ``1000 · item``.
        log: called as ``log("value", objective, actions made)``.
    """
    sculptor = Sculptor(
        robot, end_effector, material, goal_m, members, config, execution, count, session, item
    )  # fmt: skip
    begun, first = sculptor.begin()
    log("value", begun.values[0], 0)
    rows: list[dict[str, Any]] = []

    def keep(progress: Progress, row: dict[str, Any] | None) -> None:
        if row is not None:
            rows.append(row)
            log("value", progress.values[-1], len(progress.actions))

    progress, stopped = sculptor.carry_on(begun, keep)
    height = progress.heights_m[0]
    return Sculpture(
        rows, np.array(progress.actions).reshape(-1, 5), np.stack(progress.heights_m), np.array(progress.values), first,
        np.array(progress.expected_m, np.float32).reshape(-1, *height.shape), stopped, progress.holes,
    )  # fmt: skip
