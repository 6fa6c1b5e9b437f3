"""The driver of LeRobot's robots against a mock with the interface of its `Robot`, and the kinematics of the SO-101."""

import sys
import threading
from dataclasses import dataclass, replace
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

from pentimento.contracts.errors import ConfigError
from pentimento.control.guard import GuardedRobot, LiftError
from pentimento.robots.arm import pose_from, tool_of
from pentimento.robots.journey import poses_of
from pentimento.robots.kinematics import _twist, hand_pose, load_arm, miss, solve
from pentimento.robots.lerobot import LEAP_RAD, LeRobotArm, connect
from pentimento.robots.machine import HaltedError, MachineError
from pentimento.robots.motion import timed_path
from pentimento.robots.rig import Rig, load_rig
from tests.robots.machines import guarded, in_thread

RIG = load_rig("so101")
ARM = load_arm("so101")
TIP = pose_from(*tool_of(RIG))
UPRIGHT = np.radians([0.0, 20.0, 10.0, 60.0, 0.0])
"""Angles from which the hand can be brought to point into the table."""


def angles_at(x_m: float, y_m: float, z_m: float, yaw_rad: float = 0.0) -> np.ndarray:
    """Joint angles at which the tip is at a place of the canvas, reached in steps from above its middle."""
    angles, goal = UPRIGHT, np.array([0, x_m, y_m, z_m, yaw_rad])
    for share in np.linspace(0, 1, 8):
        place = (1 - share) * np.array([0, 0.08, 0.06, 0.02, 0]) + share * goal
        angles = solve(ARM, poses_of(place[None], RIG)[0], TIP, angles)
    return angles


@dataclass
class MockConfig:
    port: str
    id: str
    use_degrees: bool


class MockRobot:
    """LeRobot's `Robot`: exact servos, in degrees. An action may have some of the joints."""

    config_class = MockConfig
    name = "mock_follower"

    def __init__(self, config: MockConfig) -> None:
        assert config.use_degrees
        self.config = config
        self.is_connected, self.is_calibrated = False, True
        self.degrees = {joint.name: 0.0 for joint in ARM.joints} | {"gripper": 50.0}
        self.actions: list[dict[str, float]] = []
        self.on_action = lambda number: None
        self.greatest_step = np.inf
        self.stuck = False
        for joint, angle in zip(ARM.joints, angles_at(0.08, 0.06, 0.03), strict=True):
            self.degrees[joint.name] = float(np.degrees(angle))

    @property
    def action_features(self) -> dict[str, type]:
        return {f"{name}.pos": float for name in self.degrees}

    @property
    def observation_features(self) -> dict[str, object]:
        return {**self.action_features, "front": (480, 640, 3)}

    def connect(self, calibrate: bool = True) -> None:
        assert not calibrate, "a calibration asks at the terminal"
        self.is_connected = True

    def disconnect(self) -> None:
        self.is_connected = False

    def get_observation(self) -> dict[str, object]:
        if not self.is_connected:
            raise RuntimeError(f"{self.name} is not connected.")
        return {f"{name}.pos": value for name, value in self.degrees.items()} | {"front": np.zeros((480, 640, 3))}

    def send_action(self, action: dict[str, float]) -> dict[str, float]:
        """Returns what was sent to the servos, which a limit may have changed."""
        assert set(action) <= set(self.action_features) and all(type(value) is float for value in action.values())
        self.on_action(len(self.actions))
        present = self.degrees
        sent = {
            key: float(np.clip(value, present[key[:-4]] - self.greatest_step, present[key[:-4]] + self.greatest_step))
            for key, value in action.items()
        }
        self.actions.append(sent)
        if not self.stuck:
            self.degrees |= {key[:-4]: value for key, value in sent.items()}
        return sent


def painting() -> tuple[MockRobot, GuardedRobot, LeRobotArm]:
    robot = MockRobot(MockConfig("here", "arm", True))
    robot.connect(calibrate=False)
    arm = LeRobotArm(robot, ARM, RIG, sleep=lambda _: None)
    return robot, guarded(arm, RIG), arm


@pytest.fixture(autouse=True)
def clock(monkeypatch: pytest.MonkeyPatch) -> None:
    """A clock that no computer is too slow for: it stands still."""
    monkeypatch.setattr("pentimento.robots.lerobot.time.monotonic", lambda: 0.0)


def stroke(x_m: float = 0.06) -> np.ndarray:
    """A stroke [24, 5] of 30 mm along x at 50 mm/s, pressed by 2 mm in its middle, with a turning tool."""
    s = np.linspace(0, 1, 24)
    return timed_path(np.column_stack((x_m + 0.03 * s, 0.06 + 0 * s, -0.002 * np.sin(np.pi * s), 0.3 * s)), 0.05)


def test_hand_of_the_so101_reaches_as_far_as_its_links() -> None:
    """At zero the upper arm stands upright, and the forearm and the hand point forward, along -y."""
    jaw = pose_from(np.array([-0.0079, 0.0, -0.0981274]), np.zeros(3))
    tip = hand_pose(ARM, np.zeros(5)) @ jaw
    links_m = (0.0230745, 0.0303992, 0.028, 0.1349, 0.0611, 0.0981274)
    assert tip[1, 3] == pytest.approx(-sum(links_m), abs=1e-6)
    assert tip[0, 3] == pytest.approx(0.0207909, abs=1e-3)
    assert -tip[:3, 2] == pytest.approx([0, -1, 0], abs=1e-9)


def test_inverse_kinematics_is_the_inverse() -> None:
    rng = np.random.default_rng(0)
    low, high = ARM.ranges_rad.T
    for _ in range(20):
        angles = rng.uniform(0.8 * low, 0.8 * high)
        target = hand_pose(ARM, angles) @ TIP
        found = solve(ARM, target, TIP, angles + rng.uniform(-0.1, 0.1, 5))
        assert max(miss(ARM, found, target, TIP)) < 1e-5
        assert (found >= low).all() and (found <= high).all()


def test_jacobian_is_the_derivative() -> None:
    angles, step = np.array([0.3, -0.2, 0.4, 0.5, -0.6]), 1e-6
    target = hand_pose(ARM, angles) @ TIP
    _, jacobian = _twist(ARM, angles, target, TIP)
    for joint in range(5):
        moved = angles + step * np.eye(5)[joint]
        back, _ = _twist(ARM, moved, target, TIP)
        assert -back / step == pytest.approx(jacobian[:, joint], abs=1e-5)


def test_whole_example_canvas_and_its_wells_are_reached() -> None:
    width, height = RIG.canvas_size_m
    assert RIG.palette is not None
    places = [(x, y) for x in (0.0, width) for y in (0.0, height)]
    for x, y in [*places, *RIG.palette.wells_m, RIG.palette.water_m, RIG.palette.cloth_m]:
        for z in (-0.002, RIG.travel_height_m):
            target = poses_of(np.array([[0, x, y, z, 0.0]]), RIG)[0]
            away_m, turned_rad = miss(ARM, angles_at(x, y, z), target, TIP)
            assert away_m < 1e-4 and turned_rad < 1e-3, (x, y, z)


def test_a_stroke_arrives_at_its_place_in_degrees() -> None:
    robot, guard, arm = painting()
    measured = guard.move(stroke())
    assert measured[:, 1:4] == pytest.approx(stroke()[:, 1:4], abs=1e-3)
    assert measured[:, 4] == pytest.approx(stroke()[:, 4], abs=0.02)
    tips = [hand_pose(ARM, np.radians([sent[f"{j.name}.pos"] for j in ARM.joints])) @ TIP for sent in robot.actions]
    lowest = min(tip[2, 3] for tip in tips)
    assert lowest == pytest.approx(RIG.origin_m[2] - 0.002, abs=1e-4)
    assert all(tip[:3, 2] == pytest.approx([0, 0, -1], abs=0.01) for tip in tips)
    assert robot.degrees["gripper"] == 50.0
    assert arm.where()[2, 3] == pytest.approx(RIG.origin_m[2] + RIG.travel_height_m, abs=1e-3)


def test_dips_go_to_the_water_the_cloth_and_the_well(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pentimento.robots.hardware.WIPES", 1)
    robot, guard, _ = painting()
    guard.load_palette(np.array([[1.0, 0, 0], [0, 0, 1.0]]))
    guard.wipe()
    guard.dip(1)
    keys = [f"{joint.name}.pos" for joint in ARM.joints]
    tips = np.array([(hand_pose(ARM, np.radians([sent[k] for k in keys])) @ TIP)[:3, 3] for sent in robot.actions])
    low = tips[tips[:, 2] < RIG.origin_m[2]] - RIG.origin_m
    assert RIG.palette is not None
    for place in (RIG.palette.water_m, RIG.palette.cloth_m, RIG.palette.wells_m[1]):
        assert np.linalg.norm(low[:, :2] - place, axis=1).min() < 0.003


def test_a_robot_that_changes_a_command_is_stopped() -> None:
    robot, guard, _ = painting()
    robot.greatest_step = 0.05
    with pytest.raises(MachineError, match=r"changed the command of .*max_relative_target"):
        guard.move(stroke())


def test_a_place_out_of_reach_is_refused_before_anything_moves() -> None:
    robot = MockRobot(MockConfig("here", "arm", True))
    robot.connect(calibrate=False)
    arm = LeRobotArm(robot, ARM, RIG, sleep=lambda _: None)
    far = np.repeat(arm.where()[None], 2, axis=0)
    far[1, :3, 3] += [0.0, -0.3, 0.0]
    with pytest.raises(MachineError, match=r"misses by .* The motion was not begun"):
        arm.follow(np.array([0.0, 5.0]), far)
    assert not robot.actions


def test_an_arm_that_points_sideways_is_not_turned_at_once() -> None:
    robot = MockRobot(MockConfig("here", "arm", True))
    robot.connect(calibrate=False)
    robot.degrees["wrist_flex"] -= np.degrees(LEAP_RAD) + 5
    arm = LeRobotArm(robot, ARM, RIG, sleep=lambda _: None)
    here = arm.where()
    down = poses_of(np.array([[0, 0.0, 0.0, 0.0, 0.0]]), RIG)[0]
    down[:3, 3] = here[:3, 3]
    with pytest.raises(MachineError, match="at once; move the arm by hand"):
        arm.follow(np.array([0.0, 1.0]), np.array([down, down]))
    assert not robot.actions


def test_a_tip_that_was_moved_by_hand_is_noticed() -> None:
    robot, _, arm = painting()
    start, sent = arm.where(), len(robot.actions)
    robot.degrees["shoulder_pan"] += 2.0
    with pytest.raises(MachineError, match="moved by hand"):
        arm.follow(np.array([0.0, 1.0]), np.array([start, start]))
    assert len(robot.actions) == sent


def test_an_arm_that_does_not_arrive_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    robot, _, arm = painting()
    robot.stuck = True
    ticks = iter(np.arange(0.0, 1000.0, 0.01))
    monkeypatch.setattr("pentimento.robots.lerobot.time.monotonic", lambda: float(next(ticks)))
    start = arm.where()
    end = start.copy()
    end[2, 3] += 0.01
    with pytest.raises(MachineError, match="did not arrive"):
        arm.follow(np.array([0.0, 1.0]), np.array([start, end]))


def test_a_stop_in_mid_stroke_lifts_the_tool() -> None:
    robot, guard, arm = painting()
    keys = [f"{joint.name}.pos" for joint in ARM.joints]
    in_stroke, halted = threading.Event(), arm._halted

    def wait_for_the_stop(number: int) -> None:
        low = bool(robot.actions) and hand_pose(ARM, np.radians([robot.actions[-1][key] for key in keys])) @ TIP
        if not in_stroke.is_set() and low is not False and low[2, 3] < RIG.origin_m[2] - 0.001:
            in_stroke.set()
            assert halted.wait(5)

    robot.on_action = wait_for_the_stop
    with in_thread(lambda: guard.move(stroke())) as errors:
        assert in_stroke.wait(60)
        guard.lift()
    assert isinstance(errors[0], HaltedError)
    assert arm.where()[2, 3] == pytest.approx(RIG.origin_m[2] + RIG.travel_height_m, abs=1e-3)


def test_a_lost_cable_is_one_sentence() -> None:
    robot, guard, _ = painting()
    robot.disconnect()
    with pytest.raises(LiftError, match=r"get_observation failed: mock_follower is not connected.* by hand"):
        guard.move(stroke())


def test_an_arm_whose_joints_have_other_names_is_refused() -> None:
    robot = MockRobot(MockConfig("here", "arm", True))
    other = replace(ARM, joints=(replace(ARM.joints[0], name="waist"), *ARM.joints[1:]))
    with pytest.raises(ConfigError, match=r"no action waist\.pos; it has elbow_flex"):
        LeRobotArm(robot, other, RIG)


def rig_of(**machine: object) -> Rig:
    return replace(RIG, machine={**RIG.machine, **machine})


def test_connect_makes_the_class_of_the_rig(monkeypatch: pytest.MonkeyPatch) -> None:
    module = ModuleType("mock_lerobot")
    module.Follower = MockRobot  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "mock_lerobot", module)
    arm = connect(rig_of(robot="mock_lerobot:Follower"))
    assert arm.where().shape == (4, 4)
    arm.close()
    with pytest.raises(MachineError, match="get_observation"):
        arm.where()
    with pytest.raises(ConfigError, match="cannot be made with this config"):
        connect(rig_of(robot="mock_lerobot:Follower", config={"baud": 9600}))
    with pytest.raises(ConfigError, match="cannot be made with this config"):
        connect(rig_of(robot="mock_lerobot:Leader"))


def test_connect_refuses_an_arm_that_was_never_calibrated(monkeypatch: pytest.MonkeyPatch) -> None:
    class Uncalibrated(MockRobot):
        def connect(self, calibrate: bool = True) -> None:
            super().connect(calibrate)
            self.is_calibrated = False

    monkeypatch.setitem(sys.modules, "mock_lerobot", SimpleNamespace(Follower=Uncalibrated))  # type: ignore[arg-type]
    with pytest.raises(MachineError, match="not calibrated; run lerobot-calibrate"):
        connect(rig_of(robot="mock_lerobot:Follower"))


def test_servos_that_do_not_answer_for_their_calibration_are_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    class Silent(MockRobot):
        @property
        def is_calibrated(self) -> bool:
            raise ConnectionError("There is no status packet!")

        @is_calibrated.setter
        def is_calibrated(self, value: bool) -> None:
            pass

    monkeypatch.setitem(sys.modules, "mock_lerobot", SimpleNamespace(Follower=Silent))  # type: ignore[arg-type]
    with pytest.raises(MachineError, match=r"so101 cannot be reached: There is no status packet"):
        connect(rig_of(robot="mock_lerobot:Follower"))


@pytest.mark.parametrize("robot", ["lerobot", "os:system()", 7, "a b:C"])
def test_connect_refuses_what_is_no_class(robot: object) -> None:
    with pytest.raises(ConfigError, match=r'robot is "package\.module:Class"'):
        connect(rig_of(robot=robot))


def test_connect_names_the_extra() -> None:
    with pytest.raises(ConfigError, match=r"not installed .* pip install 'pentimento\[lerobot\]'"):
        connect(rig_of(robot="no_such_package.robots:Follower"))
