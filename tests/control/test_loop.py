"""The closed loop on a task that counts: order of checkpoints, early ends of batches, and outcomes."""

from dataclasses import dataclass, replace

import pytest

from pentimento.control.loop import Hooks, Interrupt, run_loop


@dataclass(frozen=True)
class Counter:
    """A state: remaining actions, with one of them pending or not, and what was done."""

    remaining: int
    pending: bool = False
    log: tuple[str, ...] = ()


class Counting:
    """Executes actions in batches of two."""

    def outcome(self, state: Counter) -> str | None:
        return None if state.remaining else "done"

    def batch(self, state: Counter) -> list[int]:
        return list(range(min(2, state.remaining)))

    def mark_pending(self, state: Counter) -> Counter:
        return replace(state, pending=True)

    def execute(self, state: Counter, action: int) -> Counter:
        assert state.pending
        return Counter(state.remaining - 1, False, (*state.log, f"act {action}"))

    def replan(self, state: Counter, changed: bool) -> Counter:
        return replace(state, log=(*state.log, "replan, changed" if changed else "replan"))


def test_loop_replans_after_each_batch_until_the_outcome() -> None:
    state, outcome = run_loop(Counting(), Counter(3), Hooks())
    assert outcome == "done"
    assert state.log == ("act 0", "act 1", "replan", "act 0", "replan")


def test_loop_saves_the_state_before_and_after_each_action() -> None:
    saved: list[tuple[int, bool]] = []
    reported: list[int] = []

    def checkpoint(state: Counter) -> Counter:
        saved.append((state.remaining, state.pending))
        return state

    run_loop(Counting(), Counter(2), Hooks(checkpoint=checkpoint, on_action=lambda s: reported.append(s.remaining)))
    assert saved == [(2, True), (1, False), (1, True), (0, False), (0, False)]
    assert reported == [1, 0]


def test_loop_continues_from_the_state_that_a_hook_returns() -> None:
    hooks = Hooks[Counter](checkpoint=lambda state: replace(state, log=(*state.log, "saved")))
    state, _ = run_loop(Counting(), Counter(1), hooks)
    assert state.log == ("saved", "act 0", "saved", "replan", "saved")


@pytest.mark.parametrize(
    ("interrupt", "outcome", "log"),
    [
        ("stop", None, ("act 0",)),
        ("changed", "done", ("act 0", "replan, changed", "act 0", "act 1", "replan")),
    ],
)
def test_loop_interrupt_ends_the_batch_early(interrupt: Interrupt, outcome: str | None, log: tuple[str, ...]) -> None:
    commands = iter([None, interrupt])
    hooks = Hooks[Counter](interrupt=lambda state: (state, next(commands, None)))
    assert run_loop(Counting(), Counter(3), hooks) == (Counter(0 if outcome else 2, False, log), outcome)


def test_loop_passes_errors_of_hooks_on() -> None:
    def fail(_state: Counter) -> None:
        raise ValueError("no mark")

    with pytest.raises(ValueError, match="no mark"):
        run_loop(Counting(), Counter(2), Hooks(on_action=fail))
