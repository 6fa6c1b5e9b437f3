"""Pushes by machines: the commanded motion is the push, nothing leaves the reach, and a stop raises the tool."""

import math
import threading
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from pentimento.contracts.errors import EnvelopeViolation
from pentimento.contracts.observations import Scan
from pentimento.control.push_safety import GuardedSculptingRobot, push_envelope_for
from pentimento.robots.arm import pose_from
from pentimento.robots.driver import MissingAbilityError, Place, Push
from pentimento.robots.journey import path_of, poses_of
from pentimento.robots.kinematics import hand_pose
from pentimento.robots.lerobot import LeRobotArm
from pentimento.robots.machine import HaltedError, Machine, MachineError
from pentimento.robots.rig import Rig, load_rig
from pentimento.robots.sculpting import CLEARANCE_M, HardwareSculptor, check_push_reach, push_path
from pentimento.robots.tools import load_end_effector
from pentimento.robots.xarm import XArm
from tests.robots.machines import FakeMachine, in_thread, make_rig
from tests.robots.test_lerobot import ARM, TIP, MockConfig, MockRobot
from tests.robots.test_xarm import FakeXArmApi

BALL = load_end_effector("ball")
RIG = make_rig(travel_height_m=0.06, palette=None)
EXACT_M = 1e-6
HEIGHT_M = 0.03


class FlatScanner:
    """A slab that is level, with a hole."""

    def __init__(self, area_m: tuple[float, float], height_m: float = HEIGHT_M) -> None:
        self.area_m, self.height_m, self.closed = area_m, height_m, False

    def scan(self) -> Scan:
        heights = np.full((20, 30), self.height_m)
        heights[0, 0] = np.nan
        return Scan(heights, np.array([0.0, 0.0, *self.area_m]), np.full(3, np.nan), "flat", math.nan)

    def close(self) -> None:
        self.closed = True


def push(
    x_m: float = 0.1, y_m: float = 0.1, theta: float = 2.2, length_m: float = 0.03, depth_m: float = 0.006
) -> Push:
    return Push("push", np.array([x_m, y_m, theta, length_m, depth_m]), HEIGHT_M, 0.02, 0.2, 0.03)


def sculpting(machine: Machine, rig: Rig, height_m: float = HEIGHT_M) -> GuardedSculptingRobot:
    """A machine as a guarded robot that holds the ball and has scanned."""
    robot = HardwareSculptor(machine, rig, FlatScanner(rig.canvas_size_m, height_m), lambda _: None)
    guard = GuardedSculptingRobot(robot, push_envelope_for(BALL, rig.canvas_size_m))
    guard.change_tool(BALL)
    guard.scan()
    return guard


def on_bench(rig: Rig = RIG, height_m: float = HEIGHT_M) -> tuple[FakeMachine, GuardedSculptingRobot]:
    machine = FakeMachine(poses_of(np.array([[0, 0.2, 0.15, 0.06, 0.0]]), rig)[0])
    guard = sculpting(machine, rig, height_m)
    machine.ways.clear()
    return machine, guard


def check_is_the_push(path: np.ndarray, commanded: Push, exact_m: float = EXACT_M) -> None:
    """Whether places [N, 3] of the canvas frame, z above the table, are those of a push: line, ramp, both ends."""
    x, y, theta, length, depth = commanded.action
    begin = np.array([x, y, commanded.surface_m])
    along = np.array([math.cos(theta) * length, math.sin(theta) * length, -depth])
    share = (path - begin) @ along / (along @ along)
    assert np.abs(path - begin - share[:, None] * along).max() < exact_m
    assert share.min() > -1e-3 * exact_m / 1e-6 and share.max() < 1 + 1e-3 * exact_m / 1e-6
    assert np.linalg.norm(path - begin - along, axis=1).min() < exact_m
    assert (np.diff(share) > -1e-6 * exact_m / 1e-6).all()


def test_a_push_is_over_down_along_rest_and_straight_up() -> None:
    machine, guard = on_bench()
    commanded = push()
    measured = guard.push(commanded)
    ways = [path_of(*way, RIG) for way in machine.ways]
    across, down, along, up = ways
    assert across[:, 3] == pytest.approx(np.full(len(across), 0.06))
    assert down[0, 3] == pytest.approx(0.06) and np.ptp(down[:, 1:3], axis=0).max() < 1e-9
    assert np.linalg.norm(along[0, 1:4] - [0.1, 0.1, HEIGHT_M]) < EXACT_M
    check_is_the_push(along[:, 1:4], commanded)
    assert along[-1, 0] - along[-2, 0] == pytest.approx(0.2) and np.ptp(along[-2:, 1:4], axis=0).max() < 1e-12
    assert np.ptp(up[:, 1:3], axis=0).max() < 1e-9 and up[-1, 3] == pytest.approx(0.06)
    speed = {name: np.linalg.norm(np.diff(way[:, 1:4], axis=0), axis=1) / np.diff(way[:, 0]) for name, way in
             {"along": along[:-1], "up": up}.items()}  # fmt: skip
    assert speed["along"].max() == pytest.approx(0.02, rel=0.02) and speed["up"].max() == pytest.approx(0.03, rel=0.02)
    assert measured[:, 1:4] == pytest.approx(along[:, 1:4], abs=1e-9)
    assert math.cos(2 * (along[0, 4] - 2.2)) == pytest.approx(1) and abs(along[0, 4]) <= math.pi / 2


def test_no_motion_leaves_the_slab_the_clearance_or_the_reach() -> None:
    rng, pushed = np.random.default_rng(3), 0
    machine, guard = on_bench()
    for _ in range(150):
        action = rng.uniform([-0.02, -0.02, -7, 0, 0], [0.32, 0.22, 7, 0.045, 0.014])
        before = len(machine.ways)
        try:
            guard.push(replace(push(), action=action, surface_m=float(rng.uniform(0.005, 0.05))))
        except EnvelopeViolation:
            assert len(machine.ways) == before
            continue
        pushed += 1
        points = np.concatenate([path_of(*way, RIG) for way in machine.ways[before:]])
        low = points[points[:, 3] < RIG.travel_height_m - 1e-6]  # between park and slab it travels above all
        assert (low[:, 1:3] > -1e-6).all() and (low[:, 1:3] < np.array(RIG.canvas_size_m) + 1e-6).all()
        assert low[:, 3].min() > 0.005 - 1e-6
    assert 30 < pushed < 120


def test_measured_table_s_plane_moves_the_push_with_it() -> None:
    tilted = RIG.with_surface((0.002, 0.05, -0.02))
    machine, guard = on_bench(tilted)
    commanded = push()
    measured = guard.push(commanded)
    along = path_of(*machine.ways[-2], tilted)
    places = along[:, 1:4] - np.column_stack([0 * along[:, :2], 0.002 + 0.05 * along[:, 1] - 0.02 * along[:, 2]])
    check_is_the_push(places, commanded)
    check_is_the_push(measured[:, 1:4], commanded)


@pytest.mark.parametrize(
    ("rig", "words"),
    [
        (replace(RIG, reach_m=((0.1, 0.0, 0.076), (0.5, 0.6, 0.3))), "out of the reach"),  # the end lies at z = .074
        (replace(RIG, travel_height_m=HEIGHT_M + CLEARANCE_M - 1e-4), r"35 mm|34.9 mm above the table, and the slab"),
    ],
)
def test_a_push_out_of_reach_or_through_the_slab_is_refused_before_anything_moves(rig: Rig, words: str) -> None:
    machine, guard = on_bench(rig)
    with pytest.raises(EnvelopeViolation, match=words):
        guard.push(push())
    assert not machine.ways


def test_rehearsal_checks_the_reach_without_a_machine() -> None:
    check_push_reach(push(), RIG)
    with pytest.raises(EnvelopeViolation, match="out of the reach"):
        check_push_reach(push(), replace(RIG, reach_m=((0.1, 0.0, 0.076), (0.5, 0.6, 0.3))))
    with pytest.raises(EnvelopeViolation, match=r"travels 30 mm above the table, and the slab is 30 mm high"):
        check_push_reach(push(), replace(RIG, travel_height_m=0.03))


def test_what_the_robot_cannot_do_is_said() -> None:
    robot = HardwareSculptor(FakeMachine(np.eye(4)), RIG, FlatScanner(RIG.canvas_size_m), lambda _: None)
    with pytest.raises(EnvelopeViolation, match="not scanned yet"):
        robot.push(push())
    with pytest.raises(MissingAbilityError, match="has no feeder"):
        robot.place(Place(0.1, 0.1, 1e-7, 0.03, 0.002))
    with pytest.raises(MissingAbilityError, match="gripper"):
        push_path(replace(push(), kind="pinch"))
    with pytest.raises(EnvelopeViolation, match="neither length nor depth"):
        push_path(push(length_m=0.0, depth_m=0.0))
    assert robot.ambient() == {}


def test_a_poke_goes_straight_down() -> None:
    path = push_path(replace(push(length_m=0.0), dwell_s=0.0))
    assert path[0, 1:4] == pytest.approx([0.1, 0.1, 0.03]) and path[-1, 1:4] == pytest.approx([0.1, 0.1, 0.024])


def test_people_are_asked_with_the_tool_up_and_closing_lets_go_of_both() -> None:
    asked: list[tuple[str, float]] = []
    machine = FakeMachine(poses_of(np.array([[0, 0.1, 0.1, 0.02, 0.0]]), RIG)[0])
    scanner = FlatScanner(RIG.canvas_size_m)
    robot = HardwareSculptor(machine, RIG, scanner, lambda request: asked.append((request, machine.pose[2, 3] - 0.05)))
    robot.change_tool(BALL)
    robot.change_tool(BALL)
    robot.smooth()
    assert [words.split()[0] for words, _ in asked] == ["Fit", "Smooth"]
    assert [height for _, height in asked] == pytest.approx([0.06, 0.06])
    scan = robot.scan()
    place = path_of(np.zeros(1), machine.pose[None], RIG)[0, 1:4]
    assert place == pytest.approx([0.1, -0.05, 0.06]) and 0 <= scan.t_s <= robot.clock_s
    robot.close()
    assert machine.closed and scanner.closed


XARM = replace(load_rig("xarm"), travel_height_m=0.05)
SO101 = replace(load_rig("so101"), travel_height_m=0.05)


def of_xarm() -> tuple[FakeXArmApi, GuardedSculptingRobot, Callable[[], np.ndarray]]:
    """A fake arm, and the places [N, 3] that it was sent; the canvas lies at (300, 150, 20) mm, turned by −90°."""
    api = FakeXArmApi()
    api.pose[2] = 80.0

    def places() -> np.ndarray:
        sent = np.array(api.poses)[:, :3] / 1000
        return np.column_stack([0.15 - sent[:, 1], sent[:, 0] - 0.3, sent[:, 2] - 0.02])

    return api, sculpting(XArm(api, XARM, sleep=lambda _: None), XARM), places


@pytest.fixture(autouse=True)
def clock(monkeypatch: pytest.MonkeyPatch) -> None:
    """A clock that no computer is too slow for: it stands still."""
    monkeypatch.setattr("pentimento.robots.lerobot.time.monotonic", lambda: 0.0)
    monkeypatch.setattr("pentimento.robots.xarm.time.monotonic", lambda: 0.0)


def test_xarm_is_sent_exactly_the_push() -> None:
    _, guard, places = of_xarm()
    commanded = push()
    guard.push(commanded)
    sent = places()
    first = np.flatnonzero(np.linalg.norm(sent - [0.1, 0.1, HEIGHT_M], axis=1) < EXACT_M)[0]
    last = np.flatnonzero(np.linalg.norm(sent - sent[sent[:, 2].argmin()], axis=1) < 1e-9)[-1]
    check_is_the_push(sent[first : last + 1], commanded)
    assert np.ptp(sent[last:, :2], axis=0).max() < EXACT_M and sent[-1, 2] == pytest.approx(0.05)
    assert sent[:first, 2].min() > HEIGHT_M - EXACT_M


def test_xarm_stopped_in_a_push_goes_straight_up_and_refuses_the_next() -> None:
    api, guard, places = of_xarm()
    reached, stopped = threading.Event(), threading.Event()

    def pause(_number: int) -> None:
        if not reached.is_set() and api.poses and api.pose[2] < 20 + 1000 * HEIGHT_M - 2:
            reached.set()
            stopped.wait(20)

    api.on_pose, original = pause, api.set_state

    def set_state(state: int = 0) -> int:
        code = original(state)
        stopped.set()
        return code

    with in_thread(lambda: guard.push(push())) as errors:
        assert reached.wait(20)
        api.set_state = set_state  # type: ignore[method-assign]
        at = places()[-1]
        guard.stop("the person pressed stop")
    assert isinstance(errors[0], HaltedError)
    assert places()[-1] == pytest.approx([at[0], at[1], 0.05], abs=1e-6)
    with pytest.raises(Exception, match="pressed stop"):
        guard.push(push())


def test_xarm_s_controller_is_asked_before_anything_moves() -> None:
    api, guard, _ = of_xarm()
    sent, api.reach_mm = len(api.poses), 350.0
    with pytest.raises(MachineError, match=r"cannot bring its tip to .*\(code 10\)"):
        guard.push(push(0.2, 0.15))
    assert len(api.poses) == sent


def of_so101() -> tuple[MockRobot, GuardedSculptingRobot, Callable[[], np.ndarray]]:
    robot = MockRobot(MockConfig("here", "arm", True))
    robot.connect(calibrate=False)
    rig = replace(SO101, park_m=(0.08, 0.06))
    keys = [f"{joint.name}.pos" for joint in ARM.joints]

    def places() -> np.ndarray:
        tips = [hand_pose(ARM, np.radians([sent[key] for key in keys])) @ TIP for sent in robot.actions]
        return np.array([tip[:3, 3] for tip in tips]) - rig.origin_m

    return robot, sculpting(LeRobotArm(robot, ARM, rig, sleep=lambda _: None), rig, 0.02), places


def test_so101_s_joints_bring_the_tip_along_the_push() -> None:
    robot, guard, places = of_so101()
    commanded = replace(push(0.07, 0.05, 0.4, 0.02, 0.004), surface_m=0.02)
    robot.actions.clear()
    guard.push(commanded)
    sent = places()
    first = np.flatnonzero(np.linalg.norm(sent - [0.07, 0.05, 0.02], axis=1) < EXACT_M)[0]
    last = np.flatnonzero(sent[:, 2] < sent[:, 2].min() + 1e-9)[-1]
    check_is_the_push(sent[first : last + 1], commanded)
    assert sent[-1, 2] == pytest.approx(0.05, abs=1e-5)


def test_so101_that_cannot_reach_the_end_of_a_push_does_not_begin_it() -> None:
    robot, guard, _ = of_so101()
    robot.actions.clear()
    short = replace(ARM, joints=(*ARM.joints[:-1], replace(ARM.joints[-1], range_rad=(-0.1, 0.1))))
    guard._robot._machine._arm = short  # type: ignore[attr-defined]
    with pytest.raises(MachineError, match="The motion was not begun"):
        guard.push(replace(push(0.07, 0.05, 1.2, 0.02, 0.004), surface_m=0.02))
    assert not robot.actions


def test_tool_frame_of_a_push_points_into_the_slab() -> None:
    poses = poses_of(push_path(push()), RIG)
    assert np.allclose(poses[:, :3, 2], [0, 0, -1]) and np.allclose(pose_from(np.zeros(3), np.zeros(3)), np.eye(4))
