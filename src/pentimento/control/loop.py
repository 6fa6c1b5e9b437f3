"""The closed loop of painting and sculpting: execute a batch of actions, observe, replan (thesis 4.3.5, 7.3.5).

One loop serves the workshop and the robot. A painting and a sculpture differ in their ``Task``. The workshop and the
robot differ in the ``Hooks``: checkpoints on disk, progress, and a person's commands.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Generic, Literal, Protocol, TypeVar

State = TypeVar("State")
Action = TypeVar("Action")
Outcome = TypeVar("Outcome", covariant=True)
Result = TypeVar("Result")

Interrupt = Literal["stop", "changed"]
"""Why a batch ends early: a person stops the task, or a person has changed what was observed."""


class Task(Protocol[State, Action, Outcome]):
    """A painting or a sculpture. Each method returns a new state and leaves the one that it gets as it is."""

    def outcome(self, state: State) -> Outcome | None:
        """Why the task has ended; None while there are actions to execute."""

    def batch(self, state: State) -> Sequence[Action]:
        """The actions to execute before the next replanning, in order."""

    def mark_pending(self, state: State) -> State:
        """The state in which the next action has been sent to the robot and has not been confirmed."""

    def execute(self, state: State, action: Action) -> State:
        """Execute the next action and observe its result."""

    def replan(self, state: State, changed: bool) -> State:
        """Plan the remaining actions again from the last observation. ``changed``: a person changed the object."""


def _never_interrupt(state: State) -> tuple[State, Interrupt | None]:
    return state, None


def _keep_nothing(state: State) -> State:
    return state


def _report_nothing(_state: object) -> None:
    return


@dataclass(frozen=True, kw_only=True)
class Hooks(Generic[State]):
    """Calls that the loop makes between its steps; by default they do nothing."""

    interrupt: Callable[[State], tuple[State, Interrupt | None]] = _never_interrupt
    """Called before each action. May wait for a person; returns the state to go on from."""
    checkpoint: Callable[[State], State] = _keep_nothing
    """Called with every new state, before anything else happens. Returns the state as it was saved."""
    on_action: Callable[[State], None] = _report_nothing
    """Called after each executed action, once its state is saved. May raise to end the loop."""


def run_loop(task: Task[State, Action, Result], state: State, hooks: Hooks[State]) -> tuple[State, Result | None]:
    """Repeat batch, observation and replanning until the task has an outcome or a person stops it.

    Returns:
        The last state, and the outcome; None for the outcome where a person stopped the task.
    """
    while (outcome := task.outcome(state)) is None:
        interrupt: Interrupt | None = None
        for action in task.batch(state):
            state, interrupt = hooks.interrupt(state)
            if interrupt is not None:
                break
            state = hooks.checkpoint(task.mark_pending(state))
            state = hooks.checkpoint(task.execute(state, action))
            hooks.on_action(state)
        if interrupt == "stop":
            return state, None
        state = hooks.checkpoint(task.replan(state, interrupt == "changed"))
    return state, outcome
