"""The Franka's driver against a fake that records calls, with the names and units of franky-control 2.0."""

import importlib.util
import math
import sys
import threading
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pentimento.contracts.errors import ConfigError, EnvelopeViolation
from pentimento.control.guard import GuardedRobot, LiftError
from pentimento.robots.arm import pose_from
from pentimento.robots.franka import Franka, connect
from pentimento.robots.journey import poses_of
from pentimento.robots.machine import HaltedError, MachineError
from pentimento.robots.rig import load_rig
from tests.robots.machines import guarded, in_thread
from tests.robots.machines import stroke_at as stroke

RIG = load_rig("franka")
TIP = np.eye(4)
TIP[2, 3] = 0.12


class Affine:
    """A place in metres and a quaternion x, y, z, w."""

    def __init__(self, translation: Any, rotation: Any = (0.0, 0.0, 0.0, 1.0)) -> None:
        self.translation, self.quaternion = np.array(translation, float), np.array(rotation, float)
        assert self.translation.shape == (3,) and np.linalg.norm(self.quaternion) == pytest.approx(1)

    @property
    def matrix(self) -> np.ndarray:
        x, y, z, w = self.quaternion
        cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        pose = np.eye(4)
        pose[:3, :3] = np.eye(3) + 2 * w * cross + 2 * cross @ cross
        pose[:3, 3] = self.translation
        return pose


@dataclass
class Waypoint:
    target: Any
    reference_type: str
    minimum_time: Any


class FakeException(Exception):
    pass


FRANKY = SimpleNamespace(
    Affine=Affine,
    RobotPose=lambda pose: SimpleNamespace(end_effector_pose=pose),
    Twist=lambda linear, angular: SimpleNamespace(linear=np.array(linear), angular=np.array(angular)),
    RobotVelocity=lambda twist: twist,
    CartesianState=lambda pose, velocity: SimpleNamespace(pose=pose, velocity=velocity),
    ReferenceType=SimpleNamespace(Absolute="absolute"),
    Duration=lambda ms: ms if isinstance(ms, int) and ms >= 1 else pytest.fail(f"Duration({ms!r})"),
    CartesianWaypoint=lambda target, reference_type, minimum_time: Waypoint(target, reference_type, minimum_time),
    CartesianWaypointMotion=lambda waypoints, ee_frame: SimpleNamespace(waypoints=waypoints, ee_frame=ee_frame),
    Exception=FakeException,
)


class FakeRobot:
    """Executes one waypoint a poll; keeps the hand's pose."""

    def __init__(self) -> None:
        tip = poses_of(np.array([[0, 0.1, 0.1, 0.03, 0.0]]), RIG)[0]
        self.hand = tip @ np.linalg.inv(TIP)
        self.relative_dynamics_factor = 1.0
        self.limits: tuple[float, float] | None = None
        self.has_errors = False
        self.motions: list[Any] = []
        self.todo: list[Waypoint] = []
        self.on_poll = lambda left: None
        self.stops = 0

    @property
    def current_pose(self) -> Any:
        return SimpleNamespace(end_effector_pose=SimpleNamespace(matrix=self.hand))

    def set_collision_behavior(self, torque_thresholds: float, force_thresholds: float) -> None:
        self.limits = (torque_thresholds, force_thresholds)

    def move(self, motion: Any, asynchronous: bool = False) -> None:
        assert asynchronous
        self.motions.append(motion)
        self.todo = list(motion.waypoints)
        self.tip = motion.ee_frame.matrix

    def poll_motion(self) -> bool:
        self.on_poll(len(self.todo))
        if self.todo:
            self.hand = self.todo.pop(0).target.pose.end_effector_pose.matrix @ np.linalg.inv(self.tip)
        return bool(self.todo)

    def stop(self) -> None:
        self.stops += 1
        self.todo = []


@pytest.fixture(autouse=True)
def no_waiting(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pentimento.robots.franka._LOOK_S", 0.0)


def painting() -> tuple[FakeRobot, GuardedRobot, Franka]:
    robot = FakeRobot()
    arm = Franka(robot, FRANKY, RIG)
    return robot, guarded(arm, RIG), arm


@pytest.mark.skipif(importlib.util.find_spec("franky") is None, reason="franky is not installed (extra franka)")
def test_the_real_package_builds_the_same_motion() -> None:
    import franky

    arm = Franka(FakeRobot(), franky, RIG)
    path = stroke()
    poses = poses_of(path, RIG)
    motion = arm._motion(path[:, 0], poses)
    last = motion.waypoints[-1].target.pose.end_effector_pose
    assert last.matrix == pytest.approx(poses[-1], abs=1e-9) and motion.ee_frame.matrix == pytest.approx(TIP)
    assert sum(w.minimum_time.to_sec() for w in motion.waypoints) == pytest.approx(path[-1, 0], abs=1e-3)
    assert issubclass(franky.Exception, BaseException)
    for name in ("move", "poll_motion", "stop", "set_collision_behavior", "has_errors", "current_pose"):
        assert hasattr(franky.Robot, name)


def test_limits_are_set_before_anything_moves() -> None:
    robot, _, _ = painting()
    assert robot.limits == (10.0, pytest.approx(15.0)) and robot.relative_dynamics_factor == 0.1


def test_where_is_the_tip_and_not_the_hand() -> None:
    robot, _, arm = painting()
    assert arm.where() == pytest.approx(robot.hand @ TIP)
    assert arm.where()[2, 3] == pytest.approx(0.05)
    assert robot.hand[2, 3] == pytest.approx(0.17)  # the hand is 120 mm above its tip, which points down


def test_a_stroke_is_one_motion_of_timed_waypoints_in_metres() -> None:
    """canvas (x, y, z) -> (0.35 + y, 0.15 − x, 0.02 + z)."""
    robot, guard, _ = painting()
    path = stroke()
    measured = guard.move(path)
    (motion,) = [
        m for m in robot.motions if min(w.target.pose.end_effector_pose.translation[2] for w in m.waypoints) < 0.0195
    ]
    places = np.array([w.target.pose.end_effector_pose.translation for w in motion.waypoints])
    assert places[:, 0] == pytest.approx(np.full(len(places), 0.45))
    assert places[-1, 1] == pytest.approx(0.01) and places[:, 2].min() == pytest.approx(0.018, abs=1e-4)
    total_ms = sum(w.minimum_time for w in motion.waypoints)
    assert total_ms == round(1000 * path[-1, 0])
    assert {w.reference_type for w in motion.waypoints} == {"absolute"}
    speeds = [np.linalg.norm(w.target.velocity.linear) for w in motion.waypoints]
    assert max(speeds) <= 0.12 and max(speeds) == pytest.approx(0.06, rel=0.05) and speeds[-1] == 0
    assert measured[:, 2] == pytest.approx(path[:, 2]) and (np.diff(measured[:, 1]) >= 0).all()
    assert measured[-1, 1] == pytest.approx(0.14, abs=1e-3)
    down = motion.waypoints[0].target.pose.end_effector_pose.matrix[:3, 2]
    assert down == pytest.approx([0, 0, -1], abs=1e-9)


def test_rounding_to_milliseconds_does_not_add_up() -> None:
    _, _, arm = painting()
    times_s = np.arange(0, 300) * 0.0203
    poses = np.array([pose_from(np.array([0.4 + 1e-5 * i, 0, 0.1]), np.array([math.pi, 0, 0])) for i in range(300)])
    motion = arm._motion(times_s, poses)
    ends_ms = np.cumsum([w.minimum_time for w in motion.waypoints])
    assert np.abs(ends_ms - 1000 * times_s[1:]).max() <= 0.5


def test_a_refused_command_never_reaches_the_arm() -> None:
    robot, guard, _ = painting()
    for bad in (stroke() * [1, 1000, 1000, 1000, 1], stroke() + np.array([0, 0, 0, -0.01, 0]), stroke(0.29)):
        with pytest.raises(EnvelopeViolation):
            guard.move(bad)
    assert robot.motions == []


def test_franka_reflex_raises_and_is_not_recovered() -> None:
    robot, guard, _ = painting()

    def collide(left: int) -> None:
        if len(robot.motions) == 3:
            robot.has_errors = True
            raise FakeException("cartesian_reflex")

    robot.on_poll = collide
    with pytest.raises(LiftError, match=r"reports an error; look at the arm, recover it in Franka Desk"):
        guard.move(stroke())
    assert guard.stopped is not None and "cartesian_reflex" in guard.stopped
    assert not hasattr(FakeRobot, "recover_from_errors")
    with pytest.raises(MachineError, match="Franka Desk"):
        Franka(robot, FRANKY, RIG)


def test_a_stop_ends_the_motion_and_the_tool_goes_straight_up() -> None:
    robot, guard, arm = painting()
    reached, stopped = threading.Event(), threading.Event()

    def pause(left: int) -> None:
        if len(robot.motions) == 3 and left == 10:
            reached.set()
            stopped.wait(5)

    robot.on_poll = pause
    original = robot.stop

    def stop() -> None:
        original()
        stopped.set()

    robot.stop = stop  # type: ignore[method-assign]
    with in_thread(lambda: guard.move(stroke())) as errors:
        assert reached.wait(5)
        at = arm.where()
        guard.stop("the person pressed stop")
    assert isinstance(errors[0], HaltedError)
    assert arm.where()[:2, 3] == pytest.approx(at[:2, 3]) and arm.where()[2, 3] == pytest.approx(0.05)


def test_an_arm_that_does_not_arrive_or_was_pushed_is_noticed() -> None:
    robot, guard, arm = painting()
    robot.on_poll = lambda left: robot.todo.clear() if len(robot.motions) == 3 and left == 5 else None
    with pytest.raises(MachineError, match="did not arrive"):
        guard.move(stroke())
    robot.hand = robot.hand.copy()
    robot.hand[0, 3] += 0.05
    way = poses_of(np.array([[0, 0.1, 0.1, 0.03, 0], [1, 0.11, 0.1, 0.03, 0]]), RIG)
    with pytest.raises(MachineError, match="was it moved by hand"):
        arm.follow(np.array([0.0, 1.0]), way)


def test_without_the_package_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "franky", None)
    with pytest.raises(ConfigError, match=r"pip install 'pentimento\[franka\]'"):
        connect(RIG)
