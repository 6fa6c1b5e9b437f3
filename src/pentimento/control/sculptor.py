"""Sculpting: execute a batch of actions, scan the clay, replan the rest, until no action helps (thesis 7.3.5).

Actions are pushes [5]; with a ``Placer`` also pellets [3]. A batch is of one kind.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.observations import Scan
from pentimento.control.execute import Session
from pentimento.control.execute_place import execute_place, record_place
from pentimento.control.execute_push import execute_push, levelled_m, record_push
from pentimento.control.loop import Hooks, run_loop
from pentimento.control.placing import Placer, as_columns, better_plan, is_place
from pentimento.control.sculpting_settings import Execution
from pentimento.planning.objectives import ClayObjective
from pentimento.planning.pushes.config import Reach, SculptorConfig
from pentimento.planning.pushes.holes import fill_holes
from pentimento.planning.pushes.memory import PushMemory
from pentimento.planning.pushes.plan import PushPlan
from pentimento.planning.pushes.rollout import EnsembleRollout, PushModel, Unexplained
from pentimento.planning.pushes.scales import plan_for_scan
from pentimento.robots.driver import SculptingRobot
from pentimento.robots.tools import EndEffector

Array = NDArray[np.float32]
FloatArray = NDArray[np.float64]

Outcome = Literal["all actions were made", "the models know of no action that helps", "acting no longer helped"]


@dataclass(frozen=True)
class Sculpture:
    """The result of sculpting towards a goal."""

    rows: list[dict[str, Any]]
    """Of the ``pushes`` contract, one for each action."""
    actions: FloatArray
    """[N, 5] of the contract; a pellet's are its place and zeros."""
    volumes_m3: FloatArray
    """[N] of the pellets, NaN of pushes."""
    heights_m: Array
    """[N + 1, H, W], levelled and without holes: before the first and after each action."""
    values: FloatArray
    """[N + 1]: the objective of each height map."""
    first: PushPlan
    """The first plan."""
    predicted_m: Array
    """[N, H, W]: the heights after each action as predicted by the plan that contained it."""
    stopped: Outcome
    holes: int
    """Pixels of all scans that were not measured and were filled."""

    @property
    def pushes(self) -> FloatArray:
        """[P, 5]: the actions that are not pellets."""
        return self.actions[np.isnan(self.volumes_m3)]

    @property
    def helped(self) -> bool:
        """Whether the objective is lower than before the first action."""
        return bool(self.values[-1] < self.values[0])


@dataclass(frozen=True)
class SculptureProgress:
    """A sculpture between two actions, or with one action pending."""

    scan: Scan
    """The last."""
    actions: tuple[FloatArray, ...]
    """Executed pushes [5] and pellets [3]."""
    heights_m: tuple[Array, ...]
    """[H, W] each, levelled and without holes: before the first and after each action; once resumed from a checkpoint,
    before the first, after the last then, and after each since."""
    values: tuple[float, ...]
    """The objective of each height map."""
    expected_m: tuple[Array, ...]
    """[H, W] each: the heights after each action since the last resumption, as predicted by the plan that contained it.
    """
    remaining: FloatArray
    """[K, 5] pushes or [K, 3] pellets: planned actions to execute."""
    predicted_m: Array
    """[K, H, W]: the heights after each of them."""
    due: int
    """Number of remaining actions to execute before the next replanning."""
    holes: int
    """Pixels of all scans that were not measured and were filled."""
    pending: bool
    """The first remaining action was sent to the robot, which has not confirmed it."""


def _pushes(actions: tuple[FloatArray, ...]) -> tuple[FloatArray, ...]:
    return tuple(action for action in actions if not is_place(action))


def reach_for(end_effector: EndEffector, area_m: tuple[float, float], edge_m: float) -> Reach:
    """The actions that are allowed for an end-effector on a slab, ``edge_m`` from its edge.

    An action's place is the middle of a pinch, whose open fingers must be on the slab in any direction.
    """
    edge_m = max(edge_m, end_effector.opening_m / 2)
    return Reach(
        (edge_m, edge_m, area_m[0] - edge_m, area_m[1] - edge_m),
        end_effector.travel_m,
        end_effector.depth_m,
        end_effector.nominal_width_m,
        travels=end_effector.kind == "push",
    )


def seen_m(scan: Scan) -> tuple[Array, int]:
    """The heights [H, W] to plan on, levelled, and the number of holes that were filled."""
    heights, holes = fill_holes(levelled_m(scan))
    return heights.astype(np.float32), holes


@dataclass(frozen=True, kw_only=True)
class Sculptor:
    """A sculpting task: ``control.loop.Task`` whose actions are pushes [5] and pellets [3]."""

    robot: SculptingRobot
    """Guarded."""
    end_effector: EndEffector
    material: str
    goal_m: Array
    """[H, W]"""
    members: Sequence[PushModel]
    grid: tuple[int, int]
    """[h, w] of the members' height maps. Scans may be finer or coarser."""
    config: SculptorConfig
    execution: Execution
    count: int
    """Maximum number of actions."""
    session: Session
    item: int
    """The goal's number in the session; the rows' order begins at ``1000 · item``."""
    record: Callable[[dict[str, Any]], None]
    """Called with the row of each executed action, before the new state is saved."""
    earlier: tuple[FloatArray, ...] = ()
    """[5] each: pushes of earlier goals, since the material was smoothed. Without them, the clay is taken as smooth."""
    placer: Placer | None = None
    """What sets pellets; None for pushes alone."""
    unexplained: Unexplained | None = None
    """What the members leave of pushes that they have not seen, for ``config.count_unexplained``."""

    def begin(self) -> tuple[SculptureProgress, PushPlan]:
        """Scan and plan; nothing moves."""
        self.robot.change_tool(self.end_effector)
        scan = self.robot.scan()
        height, holes = seen_m(scan)
        first = self._plan(height, (), begun=None)
        progress = SculptureProgress(
            scan=scan, actions=(), heights_m=(height,), values=(float(self.foresight.objective.values(height)),),
            expected_m=(), remaining=first.actions, predicted_m=first.predicted_m[1:],
            due=min(self.execution.replan_every, len(first.actions)), holes=holes, pending=False,
        )  # fmt: skip
        return progress, first

    def rescan(self, progress: SculptureProgress) -> SculptureProgress:
        """Scan the clay and plan again, after an action whose result is unknown. That action is not recorded."""
        self.robot.change_tool(self.end_effector)
        scan = self.robot.scan()
        height, holes = seen_m(scan)
        return self._with_new_plan(
            replace(
                progress, scan=scan, heights_m=(*progress.heights_m[:-1], height),
                values=(*progress.values[:-1], float(self.foresight.objective.values(height))),
                holes=progress.holes + holes, pending=False,
            )
        )  # fmt: skip

    def run(
        self, progress: SculptureProgress, hooks: Hooks[SculptureProgress]
    ) -> tuple[SculptureProgress, Outcome | None]:
        """Execute and replan until there is an outcome; None as the outcome where a person stops.

        Raises:
            PentimentoError: the robot failed, or the guard refused a push.
        """
        self.robot.change_tool(self.end_effector)
        return run_loop(self, progress, hooks)

    @cached_property
    def foresight(self) -> EnsembleRollout:
        """The models' predictions with the objective of the goal."""
        objective = ClayObjective(self.goal_m, self.members[0].window_m, self.config.weights)
        unexplained = self.unexplained if self.config.count_unexplained else None
        return EnsembleRollout(self.members, objective, self.config.disagreement_weight, unexplained=unexplained)

    def outcome(self, state: SculptureProgress) -> Outcome | None:
        """See ``control.loop.Task``."""
        if (ended := self._ended(state)) is not None:
            return ended
        return None if len(state.remaining) else "the models know of no action that helps"

    def batch(self, state: SculptureProgress) -> Sequence[FloatArray]:
        """See ``control.loop.Task``."""
        return list(state.remaining[: state.due])

    def mark_pending(self, state: SculptureProgress) -> SculptureProgress:
        """See ``control.loop.Task``."""
        return replace(state, pending=True)

    def execute(self, state: SculptureProgress, action: FloatArray) -> SculptureProgress:
        """See ``control.loop.Task``."""
        row, after = self._executed(state, action)
        self.record(row | {"reset_id": 0, "pushes_since_reset": len(self.earlier) + len(_pushes(state.actions))})
        height, holes = seen_m(after)
        return SculptureProgress(
            scan=after, actions=(*state.actions, action), heights_m=(*state.heights_m, height),
            values=(*state.values, float(self.foresight.objective.values(height))),
            expected_m=(*state.expected_m, state.predicted_m[0]), remaining=state.remaining[1:],
            predicted_m=state.predicted_m[1:], due=state.due - 1, holes=state.holes + holes, pending=False,
        )  # fmt: skip

    def replan(self, state: SculptureProgress, changed: bool) -> SculptureProgress:
        """See ``control.loop.Task``."""
        return state if self._ended(state) is not None else self._with_new_plan(state)

    def _executed(self, state: SculptureProgress, action: FloatArray) -> tuple[dict[str, Any], Scan]:
        """The row of an executed action, and the scan after it."""
        order = 1000 * self.item + len(state.actions)
        if is_place(action):
            assert self.placer is not None  # nothing else plans pellets
            placed = execute_place(self.robot, self.placer.feeder, action, state.scan)
            row = record_place(
                self.session, order, order, feeder=self.placer.feeder, material=self.material, executed=placed
            )
            return row, placed.after
        pushed = execute_push(
            self.robot, self.end_effector, action, state.scan, speed_m_s=self.end_effector.speed_m_s,
            dwell_s=self.execution.dwell_s, retract_speed_m_s=self.execution.retract_speed_m_s,
        )  # fmt: skip
        row = record_push(
            self.session, order, order, end_effector=self.end_effector, material=self.material, executed=pushed
        )
        return row, pushed.after

    def _plan(self, height: Array, executed: tuple[FloatArray, ...], *, begun: FloatArray | None) -> PushPlan:
        """The better of a plan of pushes and a plan of pellets for the clay [H, W] after executed actions.

        begun: [N, 5] pushes to continue from.
        """
        count, item = self.count - len(executed), (self.item, len(executed))
        foresight = self.foresight.remembering(self._memory(executed))
        pushes = plan_for_scan(
            height, foresight, self._reach, grid=self.grid, config=self.config, count=count, item=item, begun=begun
        )
        if self.placer is None:
            return pushes
        places = self.placer.plan(
            height, foresight.objective, self.members[0].window_m, area_m=self.robot.area_m, config=self.config,
            count=count, item=item,
        )  # fmt: skip
        return better_plan(pushes, places, self.execution.replan_every)

    @property
    def _reach(self) -> Reach:
        return reach_for(self.end_effector, self.robot.area_m, self.config.edge_m)

    def _memory(self, actions: tuple[FloatArray, ...]) -> PushMemory:
        """Of the clay after these executed actions, for the next push. Pellets are fresh material without a memory."""
        pushes = _pushes(actions)
        known = {
            "order": float(1000 * self.item + len(actions)),
            "pushes_since_reset": float(len(self.earlier) + len(pushes)),
            "t_start_s": self.robot.clock_s - self.session.started_s,
            "speed_m_s": self.end_effector.speed_m_s,
            "dwell_s": self.execution.dwell_s,
            "retract_speed_m_s": self.execution.retract_speed_m_s,
        }
        return PushMemory((*self.earlier, *pushes), known | self.robot.ambient())

    def _ended(self, progress: SculptureProgress) -> Outcome | None:
        since_minimum = len(progress.values) - 1 - int(np.argmin(progress.values))
        if progress.due == 0 and since_minimum >= self.execution.patience:
            return "acting no longer helped"
        return "all actions were made" if len(progress.actions) >= self.count else None

    def _with_new_plan(self, progress: SculptureProgress) -> SculptureProgress:
        begun = progress.remaining if progress.actions and progress.remaining.shape[1] == 5 else None
        new = self._plan(progress.heights_m[-1], progress.actions, begun=begun)
        due = min(self.execution.replan_every, len(new.actions))
        return replace(progress, remaining=new.actions, predicted_m=new.predicted_m[1:], due=due)


def sculpt(
    robot: SculptingRobot,
    end_effector: EndEffector,
    material: str,
    *,
    goal_m: Array,
    members: Sequence[PushModel],
    grid: tuple[int, int],
    config: SculptorConfig,
    execution: Execution,
    count: int,
    session: Session,
    item: int,
    log: Callable[[str, float, int], None],
    earlier: tuple[FloatArray, ...] = (),
    placer: Placer | None = None,
    unexplained: Unexplained | None = None,
) -> Sculpture:
    """Bring the clay closer to a goal [H, W] with up to ``count`` actions, ``execution.replan_every`` of them per plan.

    It ends early where no action is expected to help, and where the last ones did not: a model that is wrong in the
    current state continues to make it worse.

    Args:
        robot: guarded.
        grid: [h, w] of the members' height maps; the goal and the scans may be finer or coarser.
        item: the goal's number in the session; the rows' order begins at ``1000 · item``.
        log: called as ``log("value", objective, actions executed)``.
        earlier: pushes [5] of earlier goals, since the material was smoothed.
        placer: what sets pellets; None for pushes alone.
        unexplained: what the members leave of pushes that they have not seen, for ``config.count_unexplained``.
    """
    rows: list[dict[str, Any]] = []
    sculptor = Sculptor(
        robot=robot, end_effector=end_effector, material=material, goal_m=goal_m, members=members, grid=grid,
        config=config, execution=execution, count=count, session=session, item=item, record=rows.append,
        earlier=earlier, placer=placer, unexplained=unexplained,
    )  # fmt: skip
    begun, first = sculptor.begin()
    log("value", begun.values[0], 0)
    hooks = Hooks[SculptureProgress](on_action=lambda state: log("value", state.values[-1], len(state.actions)))
    progress, stopped = sculptor.run(begun, hooks)
    assert stopped is not None  # nobody interrupts
    height = progress.heights_m[0]
    return Sculpture(
        rows, *as_columns(progress.actions), np.stack(progress.heights_m), np.array(progress.values), first,
        np.array(progress.expected_m, np.float32).reshape(-1, *height.shape), stopped, progress.holes,
    )  # fmt: skip
