"""The xArm's driver against a fake that records calls, with the signatures of xarm-python-sdk 1.18."""

import importlib.util
import inspect
import math
import sys
import threading

import numpy as np
import pytest

from pentimento.contracts.errors import ConfigError, EnvelopeViolation
from pentimento.control.guard import GuardedRobot, LiftError
from pentimento.robots.journey import poses_of
from pentimento.robots.machine import HaltedError, MachineError
from pentimento.robots.rig import Rig, load_rig, rotation_of
from pentimento.robots.xarm import XArm, connect
from tests.robots.machines import guarded, in_thread
from tests.robots.machines import stroke_at as stroke

RIG = load_rig("xarm")
START_MM = [350.0, 0.0, 60.0, 180.0, 0.0, -90.0]


class FakeXArmApi:
    """Millimetres and degrees; moves in servo mode and ready state alone; refuses what the real one would refuse."""

    def __init__(self) -> None:
        self.calls: list[tuple[str, tuple]] = []
        self.pose = list(START_MM)
        self.mode, self.state, self.error, self.enabled = 0, 4, 0, False
        self.code_at: dict[str, int] = {}
        self.reach_mm = 700.0
        self.on_pose = lambda number: None
        self.poses: list[list[float]] = []

    def _note(self, name: str, *values) -> int:
        self.calls.append((name, values))
        return self.code_at.get(name, 0)

    def motion_enable(self, enable=True, servo_id=None) -> int:
        self.enabled = enable
        return self._note("motion_enable", enable)

    def set_mode(self, mode=0, detection_param=0) -> int:
        self.mode, self.state = mode, 5  # a change of mode needs set_state(0)
        return self._note("set_mode", mode)

    def set_state(self, state=0) -> int:
        self.state = state
        return self._note("set_state", state)

    def set_tcp_offset(self, offset, is_radian=None, wait=True, **kwargs) -> int:
        assert is_radian is False
        self.state = 5
        return self._note("set_tcp_offset", *offset)

    def set_tcp_load(self, weight, center_of_gravity, wait=False, **kwargs) -> int:
        return self._note("set_tcp_load", weight, *center_of_gravity)

    def set_collision_sensitivity(self, value, wait=True) -> int:
        assert isinstance(value, int)
        return self._note("set_collision_sensitivity", value)

    def set_reduced_tcp_boundary(self, boundary) -> int:
        return self._note("set_reduced_tcp_boundary", *boundary)

    def set_fence_mode(self, on) -> int:
        return self._note("set_fence_mode", on)

    def get_err_warn_code(self, show=False, lang="en"):
        return 0, [self.error, 0]

    def get_position(self, is_radian=None):
        assert is_radian is False
        return 0, list(self.pose)

    def get_inverse_kinematics(self, pose, input_is_radian=None, return_is_radian=None, limited=True, ref_angles=None):
        assert input_is_radian is False
        within = np.linalg.norm(pose[:3]) < self.reach_mm
        return (0, [0.0] * 6) if within else (10, [])

    def set_servo_cartesian(self, mvpose, speed=None, mvacc=None, mvtime=0, is_radian=None, is_tool_coord=False, **kw):
        assert is_radian is False and is_tool_coord is False
        self.on_pose(len(self.poses))
        if self.mode != 1 or self.state != 0 or not self.enabled:
            return 9
        if self.error:
            return 1
        assert np.linalg.norm(np.subtract(mvpose[:3], self.pose[:3])) < 5, "a jump"
        self.pose = list(mvpose)
        self.poses.append(list(mvpose))
        return self._note("set_servo_cartesian", *mvpose)

    def disconnect(self) -> None:
        self._note("disconnect")


@pytest.mark.skipif(importlib.util.find_spec("xarm") is None, reason="xarm-python-sdk is not installed (extra xarm)")
def test_the_fake_has_the_signatures_of_the_real_one() -> None:
    from xarm.wrapper import XArmAPI

    for name, function in inspect.getmembers(FakeXArmApi, inspect.isfunction):
        if not name.startswith("_"):
            real = [p for p in inspect.signature(getattr(XArmAPI, name)).parameters.values() if p.kind != p.VAR_KEYWORD]
            ours = [p for p in inspect.signature(function).parameters.values() if p.kind != p.VAR_KEYWORD]
            assert [(p.name, p.default) for p in ours] == [(p.name, p.default) for p in real], name


def painting(rig: Rig = RIG) -> tuple[FakeXArmApi, GuardedRobot, XArm]:
    api = FakeXArmApi()
    arm = XArm(api, rig, sleep=lambda _: None)
    return api, guarded(arm, rig), arm


def test_setting_up_is_in_millimetres_degrees_and_kilograms() -> None:
    api, _, _ = painting()
    calls = dict(api.calls[:8])
    assert calls["set_tcp_offset"] == pytest.approx((0, 0, 165, 0, 0, 0))
    assert calls["set_tcp_load"] == pytest.approx((0.2, 0, 0, 60))
    assert calls["set_collision_sensitivity"] == (3,)
    assert calls["set_reduced_tcp_boundary"] == pytest.approx((520, 200, 250, -350, 200, 5), abs=1)
    assert calls["set_fence_mode"] == (True,)
    assert [name for name, _ in api.calls[:8]][-2:] == ["set_mode", "set_state"] and api.mode == 1 and api.state == 0


def test_a_stroke_is_streamed_in_the_base_frame() -> None:
    """The canvas is turned by −90° and lies at (300, 150, 20) mm: canvas (x, y, z) -> (300 + y, 150 − x, 20 + z)."""
    api, guard, _ = painting()
    path = stroke()
    measured = guard.move(path)
    poses = np.array(api.poses)
    low = poses[poses[:, 2] < 20 - 1e-6]
    assert low[:, 0] == pytest.approx(np.full(len(low), 400.0), abs=1e-6)
    assert low[:, 1].max() <= 50 + 1e-6 and low[:, 1].min() >= 10 - 1e-6
    assert poses[:, 2].min() == pytest.approx(18, abs=0.05)
    # The tool points down; its yaw is the stroke's, and the canvas's −90°.
    roll, pitch, yaw = np.radians(low[:, 3:]).T
    for r, p, y in zip(roll, pitch, yaw, strict=True):
        expected = rotation_of(0, 0, 0.5 - math.pi / 2) @ rotation_of(math.pi, 0, 0)
        assert rotation_of(r, p, y) == pytest.approx(expected, abs=1e-6)
    assert np.nanmax(np.abs(measured[:, 1:] - path[:, 1:])) < 1e-3
    assert np.abs(poses[:, 3:]).max() <= 180 + 1e-9  # degrees, not radians: some angle is beyond 3.2
    assert np.abs(poses[:, 3:]).max() > 3.2


def test_speeds_are_those_that_were_checked() -> None:
    """A pose each 10 ms: nothing is faster than the envelope's 120 mm/s, in the air or on the canvas."""
    api, guard, _ = painting()
    guard.move(stroke())
    guard.move(stroke(0.2))
    steps_mm = np.linalg.norm(np.diff(np.array(api.poses)[:, :3], axis=0), axis=1)
    assert steps_mm.max() <= 1.2 * 1.02


def test_a_refused_command_never_reaches_the_arm() -> None:
    api, guard, _ = painting()
    sent = len(api.poses)
    for bad in (stroke() * [1, 1000, 1000, 1000, 1], stroke() + np.array([0, 0, 0, -0.01, 0]), stroke(0.29)):
        with pytest.raises(EnvelopeViolation):
            guard.move(bad)
    assert len(api.poses) == sent


def test_an_arm_that_answers_with_a_code_is_lifted_and_latched() -> None:
    api, guard, _ = painting()
    api.on_pose = lambda number: api.code_at.update({"set_servo_cartesian": 1}) if number == 400 else None
    original = api.set_state

    def set_state(state=0) -> int:
        api.code_at.clear()
        return original(state)

    api.set_state = set_state  # type: ignore[method-assign]
    with pytest.raises(MachineError, match="answered set_servo_cartesian with code 1"):
        guard.move(stroke())
    assert ("set_state", (4,)) in api.calls
    assert api.pose[2] == pytest.approx(50) and guard.stopped is not None


def test_an_error_of_the_controller_is_not_cleared_from_here() -> None:
    api, guard, _ = painting()

    def collide(number: int) -> None:
        if number == 400:
            api.error = 31

    api.on_pose = collide
    with pytest.raises(LiftError, match=r"reports error 31; look at the arm, clear the error in UFACTORY Studio"):
        guard.move(stroke())
    assert not hasattr(FakeXArmApi, "clean_error")  # a driver that called it would have failed
    with pytest.raises(MachineError, match="error 31"):
        XArm(api, RIG)


def test_a_stop_ends_the_stream_at_once_and_the_tool_goes_straight_up() -> None:
    api, guard, _ = painting()
    reached, stopped = threading.Event(), threading.Event()

    def pause(number: int) -> None:
        if number == 420:
            reached.set()
            stopped.wait(5)

    api.on_pose = pause
    original = api.set_state

    def set_state(state=0) -> int:
        code = original(state)
        stopped.set()
        return code

    with in_thread(lambda: guard.move(stroke())) as errors:
        assert reached.wait(5)
        api.set_state = set_state  # type: ignore[method-assign]
        at = list(api.pose)
        guard.stop("the person pressed stop")
    assert isinstance(errors[0], HaltedError)
    assert api.pose[:2] == pytest.approx(at[:2], abs=1e-6) and api.pose[2] == pytest.approx(50)


def test_motion_from_a_displaced_arm_is_rejected() -> None:
    _, _, arm = painting()
    way = poses_of(np.array([[0, 0.1, 0.1, 0.03, 0], [1, 0.11, 0.1, 0.03, 0]]), RIG)
    with pytest.raises(MachineError, match="was it moved by hand"):
        arm.follow(np.array([0.0, 1.0]), way)


def test_late_stream_of_poses_is_broken_off(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its clock stands still but for its sleep and three pauses of 0.2 s; lost time is not made up by haste."""
    now_s = [0.0]
    sent_s: list[float] = []

    def sleep(seconds: float) -> None:
        now_s[0] += seconds

    def pause(number: int) -> None:
        now_s[0] += 0.2 if number in pauses else 0.0
        sent_s.append(now_s[0])

    monkeypatch.setattr("pentimento.robots.xarm.time.monotonic", lambda: now_s[0])
    api, guard, arm = painting()
    arm._sleep = sleep
    api.on_pose, pauses = pause, (300, 310)
    guard.move(stroke())
    assert np.diff(sent_s).min() > 0.0049
    pauses = tuple(len(api.poses) + number for number in (300, 310, 320))
    with pytest.raises(MachineError, match="too busy"):
        guard.move(stroke())


def test_closing_lifts_and_disconnects() -> None:
    api, _, arm = painting()
    arm.close()
    assert api.calls[-1][0] == "disconnect"


def test_without_the_maker_s_package_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "xarm.wrapper", None)
    with pytest.raises(ConfigError, match=r"pip install 'pentimento\[xarm\]'"):
        connect(RIG)
