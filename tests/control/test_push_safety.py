from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from pentimento.contracts.errors import ConfigError, EnvelopeViolation
from pentimento.contracts.observations import Scan
from pentimento.control.guard import LiftError, StoppedError
from pentimento.control.push_safety import GuardedSculptingRobot, push_envelope_for
from pentimento.control.sculptor import reach_for
from pentimento.robots.driver import Push
from pentimento.robots.tools import EndEffector, load_end_effector

BALL = load_end_effector("ball")
ENVELOPE = push_envelope_for(BALL, (0.2, 0.2))
FINE = Push("push", np.array([0.1, 0.1, 0.5, 0.03, 0.008]), 0.04, 0.02, 0.5, 0.05)


def changed(**action: float) -> Push:
    names = ("x", "y", "theta", "length", "depth")
    numbers = [action.get(name, value) for name, value in zip(names, FINE.action, strict=True)]
    return replace(FINE, action=np.array(numbers))


class Recorder:
    """A robot that records its pushes, and fails on demand."""

    area_m = (0.2, 0.2)
    clock_s = 0.0

    def __init__(self) -> None:
        self.pushes: list[Push] = []
        self.broken = self.stuck = False
        self.lifts = 0

    def lift(self) -> None:
        if self.stuck:
            raise OSError("the axis jams")
        self.lifts += 1

    def change_tool(self, end_effector: EndEffector) -> None: ...

    def push(self, push: Push) -> NDArray[np.float64]:
        if self.broken:
            raise OSError("the drive tripped")
        self.pushes.append(push)
        return np.zeros((2, 5))

    def scan(self) -> Scan:
        raise NotImplementedError

    def smooth(self) -> None: ...

    def ambient(self) -> dict[str, float]:
        return {}

    def wait(self, seconds: float) -> None: ...


def test_push_envelope_accepts_and_copies_an_inner_push() -> None:
    passed = ENVELOPE.checked_copy(FINE)
    assert passed.action is not FINE.action
    np.testing.assert_array_equal(passed.action, FINE.action)
    ENVELOPE.check(replace(FINE, action=FINE.action.astype(np.float32)))


def test_push_envelope_accepts_limits_in_single_precision() -> None:
    limits = np.array([0.0, 0.2, 0.0, 0.04, 0.012], dtype=np.float32)
    ENVELOPE.check(Push("push", limits, 0.04, float(np.float32(0.06)), 4.0, float(np.float32(0.12))))


@pytest.mark.parametrize("name", ["ball", "gripper"])
def test_the_planner_cannot_choose_what_the_envelope_refuses(name: str) -> None:
    end_effector = load_end_effector(name)
    envelope = push_envelope_for(end_effector, (0.2, 0.2))
    reach = reach_for(end_effector, (0.2, 0.2), 0.002)
    for action in reach.draw(200, np.random.default_rng(0)):
        envelope.check(replace(FINE, kind=end_effector.kind, action=action))


@pytest.mark.parametrize(
    ("push", "words"),
    [
        (changed(x=-0.01), "start .* off the slab"),
        (changed(x=0.19, theta=0.0), "end .* off the slab"),
        (changed(y=0.19, theta=np.pi / 2), "end .* off the slab"),
        (changed(depth=0.02), "depth is 0.02 m; the push envelope allows 0 to 0.012 m"),
        (changed(depth=-0.001), "depth is -0.001"),
        (changed(length=0.05), "length is 0.05"),
        (changed(length=-0.01), "length"),
        (changed(theta=90.0), "looks like degrees"),
        (changed(x=np.nan), "x is nan"),
        (changed(depth=np.inf), "depth is inf"),
        (changed(x=100.0, y=100.0, length=30.0, depth=8.0), "look like millimetres"),
        (changed(depth=8.0), "depth is 8 m"),
        (replace(FINE, surface_m=0.012), "not enough material"),
        (replace(FINE, surface_m=40.0), "metres above the table"),
        (replace(FINE, surface_m=float("nan")), "surface_m is nan"),
        (replace(FINE, speed_m_s=20.0), "looks like millimetres"),
        (replace(FINE, speed_m_s=0.0), "above 0"),
        (replace(FINE, retract_speed_m_s=0.5), "retract speed is 0.5"),
        (replace(FINE, dwell_s=500.0), "Times are in seconds"),
        (replace(FINE, dwell_s=-1.0), "dwell is -1"),
        (replace(FINE, kind="pinch"), "makes a push"),
        (replace(FINE, action=np.zeros(4)), "five real numbers"),
        (replace(FINE, action=np.array(["a"] * 5)), "five real numbers"),
        (replace(FINE, speed_m_s="fast"), "must be a finite number"),  # type: ignore[arg-type]
    ],
)
def test_push_outside_the_envelope_never_reaches_the_driver(push: Push, words: str) -> None:
    recorder = Recorder()
    robot = GuardedSculptingRobot(recorder, ENVELOPE)
    robot.change_tool(BALL)
    with pytest.raises(EnvelopeViolation, match=words):
        robot.push(push)
    assert recorder.pushes == []
    robot.push(FINE)  # a refusal does not stop the robot


def test_push_envelope_accepts_random_pushes_exactly_when_inside() -> None:
    rng = np.random.default_rng(0)
    passed = 0
    for _ in range(3000):
        x, y, length, depth, surface = rng.uniform([-0.02, -0.02, 0, 0, 0], [0.22, 0.22, 0.05, 0.015, 0.07])
        theta = rng.uniform(-np.pi, np.pi)
        ends = np.array([[x, y], [x + length * np.cos(theta), y + length * np.sin(theta)]])
        inside = ends.min() >= 0 and ends.max() <= 0.2 and length <= 0.04 and depth <= 0.012
        inside = inside and surface <= 0.06 and surface - depth >= 0.005
        try:
            ENVELOPE.check(replace(FINE, action=np.array([x, y, theta, length, depth]), surface_m=surface))
        except EnvelopeViolation:
            assert not inside
        else:
            assert inside
            passed += 1
    assert 300 < passed < 2700


def test_push_envelope_checks_both_fingers_of_a_pinch() -> None:
    envelope = push_envelope_for(load_end_effector("gripper"), (0.2, 0.2))
    across, along = np.array([0.195, 0.1, np.pi / 2, 0.02, 0.008]), np.array([0.195, 0.1, 0.0, 0.02, 0.008])
    envelope.check(Push("pinch", across, 0.04, 0.02, 0.0, 0.05))
    with pytest.raises(EnvelopeViolation, match=r"other finger .* off the slab"):
        envelope.check(Push("pinch", along, 0.04, 0.02, 0.0, 0.05))


def test_push_guard_requires_a_fitting_end_effector() -> None:
    robot = GuardedSculptingRobot(Recorder(), ENVELOPE)
    with pytest.raises(EnvelopeViolation, match="change_tool"):
        robot.push(FINE)
    with pytest.raises(EnvelopeViolation, match="max_depth_m"):
        robot.change_tool(load_end_effector("flat"))
    with pytest.raises(EnvelopeViolation, match="makes a pinch"):
        robot.change_tool(replace(BALL, kind="pinch"))


def test_push_guard_refuses_pushes_after_a_fault_until_release() -> None:
    recorder = Recorder()
    robot = GuardedSculptingRobot(recorder, ENVELOPE)
    robot.change_tool(BALL)
    recorder.broken = True
    with pytest.raises(OSError, match="tripped"):
        robot.push(FINE)
    recorder.broken = False
    assert robot.stopped == "a push failed: the drive tripped"
    assert recorder.lifts >= 1
    for command in (lambda: robot.push(FINE), robot.scan, robot.smooth):
        with pytest.raises(StoppedError, match="drive tripped"):
            command()
    assert recorder.pushes == []
    robot.release()
    robot.push(FINE)
    assert len(recorder.pushes) == 1


def test_push_guard_says_when_the_tool_could_not_be_lifted() -> None:
    recorder = Recorder()
    robot = GuardedSculptingRobot(recorder, ENVELOPE)
    robot.change_tool(BALL)
    recorder.broken = recorder.stuck = True
    with pytest.raises(LiftError, match=r"may still rest in the material.*axis jams"):
        robot.push(FINE)
    assert robot.stopped is not None


def test_push_envelope_rejects_infinite_limits_and_excess_width() -> None:
    with pytest.raises(EnvelopeViolation, match="beyond the robot's slab"):
        GuardedSculptingRobot(Recorder(), replace(ENVELOPE, x_max_m=0.3))
    with pytest.raises(ConfigError, match="finite"):
        replace(ENVELOPE, max_depth_m=np.inf)
    with pytest.raises(ConfigError, match="below zero"):
        replace(ENVELOPE, max_depth_m=-1.0)
    with pytest.raises(ConfigError, match="empty"):
        replace(ENVELOPE, x_max_m=0.0)


def test_push_guard_rejects_invalid_waits() -> None:
    robot = GuardedSculptingRobot(Recorder(), ENVELOPE)
    robot.wait(10.0)
    for seconds in (-1.0, 1e6, np.nan):
        with pytest.raises(EnvelopeViolation, match="wait"):
            robot.wait(seconds)
