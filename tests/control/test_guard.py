"""Guarded robots: stops are latched, envelopes narrow, and the watchdog stops a late loop."""

import dataclasses
import math
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pentimento.contracts.errors import ConfigError, EnvelopeViolation
from pentimento.control.guard import GuardedRobot, LiftError, StoppedError, Watchdog
from pentimento.control.safety import SafetyEnvelope, envelope_for
from pentimento.robots.driver import MissingAbilityError, Robot
from pentimento.robots.tools import load_tool
from tests.control.test_safety import BRUSH, CANVAS_M, FakeRobot, good_path
from tests.robots.machines import in_thread

TOOL = load_tool("round_brush")
PROPERTY = settings(max_examples=80, deadline=None, derandomize=True, database=None)


class Breaking(FakeRobot):
    """Raises `error` at the call named `at`; a move sets an event when it begins and ends at a lift."""

    def __init__(self, at: str = "", error: BaseException | None = None) -> None:
        super().__init__()
        self.at, self.error = at, error
        self.moving, self.up = threading.Event(), threading.Event()

    def __getattribute__(self, name: str):
        if name == object.__getattribute__(self, "__dict__").get("at"):
            raise_it = object.__getattribute__(self, "error")

            def broken(*_: object) -> None:
                raise raise_it

            return broken
        return super().__getattribute__(name)

    def lift(self) -> None:
        self.calls.append(("lift", None))
        self.up.set()


class Slow(Breaking):
    """A move lasts until the tool is lifted."""

    def move(self, path: np.ndarray) -> np.ndarray:
        self.calls.append(("move", None))
        self.moving.set()
        assert self.up.wait(5)
        raise OSError("halted")


def guarded(fake: FakeRobot) -> GuardedRobot:
    robot = GuardedRobot(fake, BRUSH)
    robot.change_tool(TOOL)
    robot.load_palette(np.array([[1.0, 0, 0]]))
    fake.calls.clear()
    return robot


COMMANDS: dict[str, Callable[[GuardedRobot], object]] = {
    "change_tool": lambda robot: robot.change_tool(TOOL),
    "load_palette": lambda robot: robot.load_palette(np.array([[1.0, 0, 0]])),
    "dip": lambda robot: robot.dip(0),
    "wipe": lambda robot: robot.wipe(),
    "move": lambda robot: robot.move(good_path()),
    "new_sheet": lambda robot: robot.new_sheet(),
    "wait": lambda robot: robot.wait(1.0),
}


def test_guard_refuses_photos_while_stopped() -> None:
    """An arm would have to move out of the picture."""
    robot = guarded(Breaking())
    assert robot.photo().frame.shape == (2, 2, 3)
    robot.stop("the person pressed stop")
    with pytest.raises(StoppedError, match="photo is refused"):
        robot.photo()


@pytest.mark.parametrize("command", COMMANDS)
def test_guard_refuses_every_command_after_a_stop_until_release(command: str) -> None:
    fake = Breaking()
    robot = guarded(fake)
    robot.stop("the person pressed stop")
    robot.stop("another reason, later")
    assert robot.stopped == "the person pressed stop"
    with pytest.raises(StoppedError, match=r"stopped \(the person pressed stop\).* release it by hand"):
        COMMANDS[command](robot)
    assert {name for name, _ in fake.calls} == {"lift"}
    assert robot.clock_s == 0.0
    robot.release()
    COMMANDS[command](robot)
    assert fake.calls[-1][0] == command and robot.stopped is None


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("error", [OSError("the link is lost"), RuntimeError("joint 3"), KeyboardInterrupt()])
def test_guard_lifts_and_latches_on_any_driver_error(command: str, error: BaseException) -> None:
    fake = Breaking()
    robot = guarded(fake)
    fake.at, fake.error = command, error
    with pytest.raises(type(error)):
        COMMANDS[command](robot)
    assert [name for name, _ in fake.calls] == ["lift"]
    assert robot.stopped is not None
    fake.at = ""
    with pytest.raises(StoppedError):
        robot.move(good_path())


def test_guard_refusal_neither_lifts_nor_latches() -> None:
    fake = Breaking()
    robot = guarded(fake)
    with pytest.raises(EnvelopeViolation):
        robot.move(good_path() + 10)
    assert fake.calls == [] and robot.stopped is None


def test_guard_failed_lift_raises_lift_error_and_latches() -> None:
    fake = Breaking("lift", OSError("the link is lost"))
    robot = GuardedRobot(fake, BRUSH)
    with pytest.raises(LiftError, match=r"may still rest on the canvas.*the link is lost.*emergency stop"):
        robot.stop("late heartbeat")
    assert robot.stopped == "late heartbeat"
    other = GuardedRobot(Breaking("lift", OSError("gone")), BRUSH)
    with pytest.raises(LiftError):
        other.lift()
    assert other.stopped is not None


def test_guard_stop_from_another_thread_interrupts_a_move() -> None:
    fake = Slow()
    robot = guarded(fake)
    with in_thread(lambda: robot.move(good_path())) as errors:
        assert fake.moving.wait(5)
        begun_s = time.perf_counter()
        robot.stop("late heartbeat")
        assert time.perf_counter() - begun_s < 1
    assert isinstance(errors[0], OSError) and robot.stopped == "late heartbeat"


def test_guard_move_that_ends_after_a_stop_raises() -> None:
    """The driver could not be interrupted, so how much of the stroke was executed is unknown."""

    class Deaf(Breaking):
        def move(self, path: np.ndarray) -> np.ndarray:
            robot.stop("meanwhile")
            return path

    robot = guarded(Deaf())
    with pytest.raises(StoppedError, match="meanwhile"):
        robot.move(good_path())


def recorded() -> tuple[FakeRobot, GuardedRobot]:
    fake = FakeRobot()
    robot = GuardedRobot(fake, BRUSH)
    robot.change_tool(load_tool("round_brush"))
    fake.calls.clear()
    return fake, robot


def test_guard_refuses_moves_before_change_tool() -> None:
    fake = FakeRobot()
    with pytest.raises(EnvelopeViolation, match="call change_tool before the first move"):
        GuardedRobot(fake, BRUSH).move(good_path())
    assert fake.calls == []


def test_guard_refused_path_never_reaches_the_driver() -> None:
    fake, robot = recorded()
    path = good_path()
    path[3, 3] = -0.02
    with pytest.raises(EnvelopeViolation):
        robot.move(path)
    assert fake.calls == []


def test_guard_passes_an_accepted_path_as_a_copy() -> None:
    fake, robot = recorded()
    path = good_path()
    measured = robot.move(path)
    ((name, seen),) = fake.calls
    assert name == "move" and np.array_equal(path, good_path())
    assert np.array_equal(seen, path) and np.array_equal(measured, path)
    assert not np.shares_memory(seen, path)


@pytest.mark.parametrize("paint", [-1, 2, 1.0, True, math.nan, "0", None])
def test_guard_refuses_a_dip_into_a_missing_paint(paint: Any) -> None:
    fake, robot = recorded()
    robot.load_palette(np.array([[0.1, 0.2, 0.3], [1, 1, 1]]))
    with pytest.raises(EnvelopeViolation):
        robot.dip(paint)
    assert [name for name, _ in fake.calls] == ["load_palette"]


def test_guard_passes_dips_into_the_palette() -> None:
    fake, robot = recorded()
    with pytest.raises(EnvelopeViolation, match="palette has 0 paints"):
        robot.dip(0)
    robot.load_palette(np.array([[0.1, 0.2, 0.3], [1, 1, 1]]))
    robot.dip(0)
    robot.dip(np.int64(1))
    assert [call for call in fake.calls if call[0] == "dip"] == [("dip", 0), ("dip", 1)]


@pytest.mark.parametrize(
    ("palette", "sentence"),
    [
        (np.zeros((0, 3)), "at least one paint"),
        (np.zeros((2, 4)), r"\[K, 3\]"),
        (np.array([[0.5, 0.5, math.nan]]), "Paint 0"),
        (np.array([[0, 0, 0], [0, 128, 255]]), "look like 0 to 255"),
        (np.array([[0.0, -0.1, 0.0]]), "from 0 to 1"),
        (np.array([["a", "b", "c"]]), "real numbers"),
    ],
)
def test_guard_refuses_an_invalid_palette(palette: np.ndarray, sentence: str) -> None:
    fake, robot = recorded()
    with pytest.raises(EnvelopeViolation, match=sentence):
        robot.load_palette(palette)
    assert fake.calls == []


@pytest.mark.parametrize("seconds", [-1.0, math.nan, math.inf, 1e5])
def test_guard_refuses_an_invalid_wait(seconds: float) -> None:
    fake, robot = recorded()
    with pytest.raises(EnvelopeViolation, match="wait"):
        robot.wait(seconds)
    assert fake.calls == []
    robot.wait(600)
    assert fake.calls == [("wait", 600)]


def test_guard_refuses_an_envelope_too_wide_for_the_tool() -> None:
    """The round brush's press of 4 mm would crush a marker."""
    fake, robot = recorded()
    with pytest.raises(EnvelopeViolation, match=r"marker tolerates 0\.001 m"):
        robot.change_tool(load_tool("marker"))
    fast = dataclasses.replace(BRUSH, max_speed_m_s=0.5)
    with pytest.raises(EnvelopeViolation, match=r"tolerates 0\.12 m/s"):
        GuardedRobot(fake, fast).change_tool(load_tool("round_brush"))
    assert fake.calls == []
    robot.change_tool(load_tool("round_brush"))
    assert fake.calls == [("change_tool", "round_brush")]


def test_guard_refuses_an_envelope_beyond_the_canvas() -> None:
    with pytest.raises(EnvelopeViolation, match="beyond the robot's canvas"):
        GuardedRobot(FakeRobot(), envelope_for(load_tool("round_brush"), (0.4, 0.2)))


def test_guard_implements_the_robot_interface() -> None:
    fake, guard = recorded()
    robot: Robot = guard
    assert robot.canvas_size_m == CANVAS_M and robot.clock_s == 0.0
    assert guard.envelope == BRUSH
    assert robot.photo().frame.shape == (2, 2, 3)
    with pytest.raises(MissingAbilityError):
        robot.scan()
    robot.wipe()
    robot.new_sheet()
    assert fake.calls == [("wipe", None), ("new_sheet", None)]


# Limits


@st.composite
def envelopes(draw: st.DrawFn) -> SafetyEnvelope:
    """Envelopes around the middle of the canvas, so that any two overlap."""
    x, y = CANVAS_M
    factor = st.floats(0.1, 1.0)
    names = [field.name for field in dataclasses.fields(SafetyEnvelope) if field.name.startswith("max_")]
    corner = {
        "x_min_m": draw(st.floats(0, 0.4 * x)),
        "x_max_m": draw(st.floats(0.6 * x, x)),
        "y_min_m": draw(st.floats(0, 0.4 * y)),
        "y_max_m": draw(st.floats(0.6 * y, y)),
    }
    return SafetyEnvelope(**corner, **{name: getattr(BRUSH, name) * draw(factor) for name in names})


@PROPERTY
@given(bundle=envelopes(), local=envelopes(), more=envelopes())
def test_envelope_tightening_is_an_intersection(
    bundle: SafetyEnvelope, local: SafetyEnvelope, more: SafetyEnvelope
) -> None:
    """Commutative, associative, idempotent, and never wider than either side."""
    joint = bundle.tightened(local)
    assert joint == local.tightened(bundle)
    assert joint.tightened(more) == bundle.tightened(local.tightened(more))
    assert bundle.tightened(bundle) == bundle and bundle.wider_than(bundle) == ()
    assert joint.wider_than(bundle) == () and joint.wider_than(local) == ()


@pytest.mark.parametrize("field", [field.name for field in dataclasses.fields(SafetyEnvelope)])
def test_envelope_tightening_covers_each_limit(field: str) -> None:
    inward = 1e-3 if field in ("x_min_m", "y_min_m") else -1e-3
    narrow = dataclasses.replace(BRUSH, **{field: getattr(BRUSH, field) + inward})
    assert BRUSH.tightened(narrow) == narrow == narrow.tightened(BRUSH)
    assert BRUSH.wider_than(narrow) == (field,) and narrow.wider_than(BRUSH) == ()


@PROPERTY
@given(local=envelopes(), seed=st.integers(0, 2**31))
def test_envelope_path_inside_the_tightened_one_is_inside_both(local: SafetyEnvelope, seed: int) -> None:
    joint = BRUSH.tightened(local)
    path = good_path()
    path[:, 1:3] += np.random.default_rng(seed).uniform(-0.12, 0.12, 2)
    path[:, 0] *= 1.5
    try:
        joint.check_path(path)
    except EnvelopeViolation:
        with pytest.raises(EnvelopeViolation):
            BRUSH.check_path(path)
            local.check_path(path)
    else:
        BRUSH.check_path(path)
        local.check_path(path)


def test_envelope_narrowed_by_rig_limits_is_never_wider() -> None:
    assert BRUSH.narrowed({}) == BRUSH
    assert BRUSH.narrowed({"max_speed_m_s": 0.05, "x_min_m": 0.1}) == dataclasses.replace(
        BRUSH, max_speed_m_s=0.05, x_min_m=0.1
    )
    assert BRUSH.narrowed({"max_speed_m_s": 5.0, "x_min_m": -1.0, "max_press_depth_m": 1.0}) == BRUSH
    with pytest.raises(ConfigError, match=r"no limit named \['max_force_n'\]"):
        BRUSH.narrowed({"max_force_n": 1.0})
    with pytest.raises(ConfigError, match="empty"):
        BRUSH.narrowed({"x_max_m": -0.1})


def test_envelope_rejects_disjoint_workspaces() -> None:
    left = dataclasses.replace(BRUSH, x_max_m=0.1)
    right = dataclasses.replace(BRUSH, x_min_m=0.2)
    with pytest.raises(ConfigError, match="empty"):
        left.tightened(right)


def test_envelope_tightened_by_itself_is_unchanged() -> None:
    marker = envelope_for(load_tool("marker"), CANVAS_M)
    assert marker.tightened(BRUSH) == marker and BRUSH.wider_than(marker) == ("max_press_depth_m",)


class Clock:
    """A clock that a test sets."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def stops() -> list[str]:
    """Why the watchdog stopped the robot."""
    return []


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def watchdog(stops: list[str], clock: Clock) -> Iterator[Watchdog]:
    """One that looks when it is asked to."""
    dog = Watchdog(stops.append, clock, poll_s=60)
    yield dog
    dog.close()


def test_watchdog_with_beats_in_time_does_not_stop(watchdog: Watchdog, clock: Clock, stops: list[str]) -> None:
    for _ in range(5):
        watchdog.beat(2.0, "a stroke")
        clock.now += 1.9
        assert not watchdog.check()
    assert stops == []


def test_watchdog_late_beat_stops_once_with_a_message(watchdog: Watchdog, clock: Clock, stops: list[str]) -> None:
    watchdog.beat(2.0, "stroke 7")
    clock.now = 2.1
    assert watchdog.check() and not watchdog.check()
    assert stops == ["stroke 7 took longer than the 2 s that it may take"]


def test_watchdog_at_rest_never_stops(watchdog: Watchdog, clock: Clock, stops: list[str]) -> None:
    watchdog.beat(2.0, "a stroke")
    watchdog.rest()
    clock.now = 1e6
    assert not watchdog.check()
    assert stops == []


def test_watchdog_thread_stops_a_hanging_loop() -> None:
    stopped = threading.Event()
    watchdog = Watchdog(lambda _: stopped.set(), poll_s=0.005)
    started_s = time.monotonic()
    watchdog.beat(0.05, "a stroke")
    assert stopped.wait(5)
    assert 0.05 <= time.monotonic() - started_s < 0.5
    watchdog.close()


def test_watchdog_keeps_the_error_of_a_failed_lift() -> None:
    def stop(_reason: str) -> None:
        raise LiftError("the tool may still rest on the canvas.")

    clock = Clock()
    watchdog = Watchdog(stop, clock, poll_s=60)
    watchdog.beat(1.0, "a stroke")
    clock.now = 2.0
    assert watchdog.check()
    assert isinstance(watchdog.failure, LiftError)
    watchdog.close()
