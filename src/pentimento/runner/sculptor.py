"""Sculpting: push a few times, look at the clay, replan the rest, until nothing helps any more (thesis 7.3.5)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.ranges import above_zero, at_least
from pentimento.contracts.scan import Scan
from pentimento.planning.sculptor.actions import Reach
from pentimento.planning.sculptor.config import SculptorConfig
from pentimento.planning.sculptor.holes import fill_holes
from pentimento.planning.sculptor.model import PushModel
from pentimento.planning.sculptor.objective import ClayObjective
from pentimento.planning.sculptor.plan import PushPlan, plan
from pentimento.planning.sculptor.rollout import Foresight
from pentimento.robots.end_effectors import EndEffector
from pentimento.robots.sculpting import SculptingRobot
from pentimento.runner.act import Session
from pentimento.runner.push_act import execute_push, levelled_m, record_push

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
    robot.change_tool(end_effector)
    scan = robot.scan()
    height, holes = seen_m(scan)
    foresight = Foresight(members, ClayObjective(goal_m, scan.window_m, config.weights), config.caution)
    reach = reach_for(end_effector, robot.area_m, config.edge_m)
    heights, values = [height], [float(foresight.objective.values(height))]
    rows: list[dict[str, Any]] = []
    actions: list[FloatArray] = []
    expected: list[Array] = []
    log("value", values[0], 0)
    first = now = plan(height, foresight, reach, config, count, (item, 0))
    stopped: Stopped = "all actions were made"
    while len(actions) < count:
        if len(now.actions) == 0:
            stopped = "the models know of no action that helps"
            break
        for action, foreseen in zip(now.actions[: execution.batch], now.foreseen_m[1:], strict=False):
            made = execute_push(
                robot, end_effector, action, scan,
                end_effector.speed_m_s, execution.dwell_s, execution.retract_speed_m_s,
            )  # fmt: skip
            order = 1000 * item + len(actions)
            rows.append(record_push(session, order, order, end_effector, material, made))
            scan = made.after
            height, more = seen_m(scan)
            holes += more
            actions.append(action)
            expected.append(foreseen)
            heights.append(height)
            values.append(float(foresight.objective.values(height)))
            log("value", values[-1], len(actions))
        if len(values) - 1 - int(np.argmin(values)) >= execution.patience:
            stopped = "acting no longer helped"
            break
        left = now.actions[execution.batch :]
        if len(actions) < count:
            now = plan(height, foresight, reach, config, count - len(actions), (item, len(actions)), left)
    return Sculpture(
        rows, np.array(actions).reshape(-1, 5), np.stack(heights), np.array(values), first,
        np.array(expected, np.float32).reshape(-1, *height.shape), stopped, holes,
    )  # fmt: skip
