"""The stop: it latches, it lifts whatever goes wrong, and limits can only be tightened."""

import dataclasses
import threading
import time
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pentimento.contracts.errors import ConfigError, EnvelopeViolation
from pentimento.control.guard import GuardedRobot, LiftError, StoppedError
from pentimento.control.safety import SafetyEnvelope, envelope_for
from pentimento.robots.tools import load_tool
from tests.control.test_safety import BRUSH, CANVAS_M, FakeRobot, good_path

TOOL = load_tool("round_brush")
PROPERTY = settings(max_examples=80, deadline=None, derandomize=True, database=None)


class Breaking(FakeRobot):
    """Raises `error` at the call named `at`; says when a move has begun and ends it when it is lifted."""

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


def test_no_photo_is_taken_while_stopped() -> None:
    """An arm would have to move out of the picture."""
    robot = guarded(Breaking())
    assert robot.photo().frame.shape == (2, 2, 3)
    robot.stop("the person pressed stop")
    with pytest.raises(StoppedError, match="photo is refused"):
        robot.photo()


@pytest.mark.parametrize("command", COMMANDS)
def test_after_a_stop_every_command_is_refused_until_a_person_releases_it(command: str) -> None:
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
def test_whatever_goes_wrong_in_the_driver_lifts_the_tool_and_latches(command: str, error: BaseException) -> None:
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


def test_a_refusal_by_the_envelope_neither_lifts_nor_latches() -> None:
    fake = Breaking()
    robot = guarded(fake)
    with pytest.raises(EnvelopeViolation):
        robot.move(good_path() + 10)
    assert fake.calls == [] and robot.stopped is None


def test_a_tool_that_cannot_be_lifted_is_said_and_latches() -> None:
    fake = Breaking("lift", OSError("the link is lost"))
    robot = GuardedRobot(fake, BRUSH)
    with pytest.raises(LiftError, match=r"may still rest on the canvas.*the link is lost.*emergency stop"):
        robot.stop("late heartbeat")
    assert robot.stopped == "late heartbeat"
    other = GuardedRobot(Breaking("lift", OSError("gone")), BRUSH)
    with pytest.raises(LiftError):
        other.lift()
    assert other.stopped is not None


def test_a_stop_from_another_thread_breaks_a_move_off() -> None:
    fake = Slow()
    robot = guarded(fake)
    errors: list[BaseException] = []

    def paint() -> None:
        try:
            robot.move(good_path())
        except BaseException as error:
            errors.append(error)

    painter = threading.Thread(target=paint)
    painter.start()
    assert fake.moving.wait(5)
    begun_s = time.perf_counter()
    robot.stop("late heartbeat")
    assert time.perf_counter() - begun_s < 1
    painter.join(5)
    assert isinstance(errors[0], OSError) and robot.stopped == "late heartbeat"


def test_a_move_that_ends_although_it_was_stopped_does_not_count_as_made() -> None:
    """Its driver could not be interrupted; how much of the stroke was made nobody knows."""

    class Deaf(Breaking):
        def move(self, path: np.ndarray) -> np.ndarray:
            robot.stop("meanwhile")
            return path

    robot = guarded(Deaf())
    with pytest.raises(StoppedError, match="meanwhile"):
        robot.move(good_path())


# Limits


@st.composite
def envelopes(draw: st.DrawFn) -> SafetyEnvelope:
    """Envelopes about the middle of the canvas, so that any two of them overlap."""
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
def test_tightening_is_an_intersection(bundle: SafetyEnvelope, local: SafetyEnvelope, more: SafetyEnvelope) -> None:
    """Commutative, associative, idempotent, and never wider than either side."""
    joint = bundle.tightened(local)
    assert joint == local.tightened(bundle)
    assert joint.tightened(more) == bundle.tightened(local.tightened(more))
    assert bundle.tightened(bundle) == bundle and bundle.wider_than(bundle) == ()
    assert joint.wider_than(bundle) == () and joint.wider_than(local) == ()


@pytest.mark.parametrize("field", [field.name for field in dataclasses.fields(SafetyEnvelope)])
def test_each_limit_is_tightened_and_its_widening_found(field: str) -> None:
    inward = 1e-3 if field in ("x_min_m", "y_min_m") else -1e-3
    narrow = dataclasses.replace(BRUSH, **{field: getattr(BRUSH, field) + inward})
    assert BRUSH.tightened(narrow) == narrow == narrow.tightened(BRUSH)
    assert BRUSH.wider_than(narrow) == (field,) and narrow.wider_than(BRUSH) == ()


@PROPERTY
@given(local=envelopes(), seed=st.integers(0, 2**31))
def test_what_passes_the_tightened_envelope_passes_both(local: SafetyEnvelope, seed: int) -> None:
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


def test_a_rig_s_own_limits_narrow_and_never_widen() -> None:
    assert BRUSH.narrowed({}) == BRUSH
    assert BRUSH.narrowed({"max_speed_m_s": 0.05, "x_min_m": 0.1}) == dataclasses.replace(
        BRUSH, max_speed_m_s=0.05, x_min_m=0.1
    )
    assert BRUSH.narrowed({"max_speed_m_s": 5.0, "x_min_m": -1.0, "max_press_depth_m": 1.0}) == BRUSH
    with pytest.raises(ConfigError, match=r"no limit named \['max_force_n'\]"):
        BRUSH.narrowed({"max_force_n": 1.0})
    with pytest.raises(ConfigError, match="empty"):
        BRUSH.narrowed({"x_max_m": -0.1})


def test_envelopes_without_a_common_place_are_refused() -> None:
    left = dataclasses.replace(BRUSH, x_max_m=0.1)
    right = dataclasses.replace(BRUSH, x_min_m=0.2)
    with pytest.raises(ConfigError, match="empty"):
        left.tightened(right)


def test_the_envelope_of_a_tool_is_its_own_tightening() -> None:
    marker = envelope_for(load_tool("marker"), CANVAS_M)
    assert marker.tightened(BRUSH) == marker and BRUSH.wider_than(marker) == ("max_press_depth_m",)
