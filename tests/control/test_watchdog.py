"""The heartbeat: in time nothing happens, late the robot is stopped, once."""

import threading
import time

from pentimento.control.guard import LiftError, Watchdog


class Clock:
    """A clock that a test sets."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


def test_beats_in_time_stop_nothing() -> None:
    stops: list[str] = []
    clock = Clock()
    watchdog = Watchdog(stops.append, clock, poll_s=60)
    for _ in range(5):
        watchdog.beat(2.0, "a stroke")
        clock.now += 1.9
        assert not watchdog.check()
    watchdog.close()
    assert stops == []


def test_a_late_beat_stops_once_with_a_sentence() -> None:
    stops: list[str] = []
    clock = Clock()
    watchdog = Watchdog(stops.append, clock, poll_s=60)
    watchdog.beat(2.0, "stroke 7")
    clock.now = 2.1
    assert watchdog.check() and not watchdog.check()
    watchdog.close()
    assert stops == ["stroke 7 took longer than the 2 s that it may take"]


def test_at_rest_any_time_may_pass() -> None:
    stops: list[str] = []
    clock = Clock()
    watchdog = Watchdog(stops.append, clock, poll_s=60)
    watchdog.beat(2.0, "a stroke")
    watchdog.rest()
    clock.now = 1e6
    assert not watchdog.check()
    watchdog.close()
    assert stops == []


def test_its_own_thread_stops_a_loop_that_hangs() -> None:
    stopped = threading.Event()
    watchdog = Watchdog(lambda _: stopped.set(), poll_s=0.005)
    started_s = time.monotonic()
    watchdog.beat(0.05, "a stroke")
    assert stopped.wait(5)
    assert 0.05 <= time.monotonic() - started_s < 0.5
    watchdog.close()


def test_a_lift_that_fails_is_kept_to_be_told() -> None:
    def stop(_reason: str) -> None:
        raise LiftError("the tool may still rest on the canvas.")

    clock = Clock()
    watchdog = Watchdog(stop, clock, poll_s=60)
    watchdog.beat(1.0, "a stroke")
    clock.now = 2.0
    assert watchdog.check()
    assert isinstance(watchdog.failure, LiftError)
    watchdog.close()
