"""A robot on a machine that follows exactly: what reaches the machine, and when it is lifted."""

from itertools import pairwise

import numpy as np
import pytest

from pentimento.contracts.errors import ContractError, EnvelopeViolation
from pentimento.contracts.observations import Photo
from pentimento.robots.driver import MissingAbilityError, Robot
from pentimento.robots.hardware import HardwareRobot
from pentimento.robots.journey import path_of, poses_of
from pentimento.robots.machine import HaltedError
from pentimento.robots.motion import timed_path
from pentimento.robots.rig import Rig
from pentimento.robots.tools import load_tool
from tests.robots.machines import FakeMachine, make_rig

RED_BLUE = np.array([[1.0, 0, 0], [0, 0, 1.0]])


def stroke(z_m: float = -0.002, x_m: float = 0.1) -> np.ndarray:
    s = np.linspace(0, 1, 16)
    return timed_path(np.column_stack((x_m + 0.03 * s, 0.1 + 0 * s, z_m * np.sin(np.pi * s), 0.4 + 0 * s)), 0.06)


def robot(rig: Rig | None = None, camera=None) -> tuple[HardwareRobot, FakeMachine, list[str]]:
    rig = rig or make_rig()
    asked: list[str] = []
    machine = FakeMachine(poses_of(np.array([[0, 0.05, 0.05, rig.travel_height_m, 0.0]]), rig)[0])
    return HardwareRobot(machine, rig, asked.append, camera), machine, asked


def test_the_machine_gets_the_stroke_with_its_times_in_its_own_frame() -> None:
    bot, machine, _ = robot()
    path = stroke()
    measured = bot.move(path)
    sent = [way for way in machine.ways if np.array_equal(way[0], path[:, 0])]
    ((times_s, poses),) = sent
    assert poses == pytest.approx(poses_of(path, bot.rig))
    assert measured == pytest.approx(path, abs=1e-9)
    assert np.array_equal(times_s, path[:, 0])
    assert machine.pose[2, 3] == pytest.approx(0.05 + 0.03)  # up again


def test_the_way_is_unbroken() -> None:
    bot, machine, _ = robot()
    for x_m in (0.1, 0.2, 0.05):
        bot.move(stroke(x_m=x_m))
    for (_, one), (_, other) in pairwise(machine.ways):
        assert one[-1] == pytest.approx(other[0], abs=1e-5)


def test_a_found_surface_is_added_and_taken_off_again() -> None:
    rig = make_rig(surface=(0.001, 0.0, 0.0))
    bot, machine, _ = robot(rig)
    path = stroke()
    measured = bot.move(path)
    (poses,) = [way[1] for way in machine.ways if np.array_equal(way[0], path[:, 0])]
    assert poses[:, 2, 3] == pytest.approx(0.05 + 0.001 + path[:, 3])
    assert measured == pytest.approx(path, abs=1e-9)


def test_nothing_moves_when_any_part_of_the_way_is_out_of_reach() -> None:
    """The stroke itself is within reach; the way to it is too high."""
    rig = make_rig(reach_m=((0.1, 0.0, 0.03), (0.5, 0.6, 0.075)))
    bot, machine, _ = robot(rig)
    with pytest.raises(EnvelopeViolation, match="out of the reach"):
        bot.move(stroke())
    assert machine.ways == []


def test_dips_and_wipes_happen_beside_the_canvas_and_below_its_height() -> None:
    bot, machine, asked = robot()
    bot.load_palette(RED_BLUE)
    bot.load_palette(RED_BLUE)
    assert len(asked) == 1 and "well 1: #ff0000" in asked[0] and "well 2: #0000ff" in asked[0]
    bot.dip(1)
    path = np.concatenate([path_of(way[0], way[1], bot.rig) for way in machine.ways])
    low = path[path[:, 3] < 0]
    assert low[:, 1] == pytest.approx(np.full(len(low), 0.34)) and abs(low[:, 2] - 0.1).max() <= 0.0031
    assert path[:, 3].min() == pytest.approx(-0.004)
    machine.ways.clear()
    bot.wipe()
    path = np.concatenate([path_of(way[0], way[1], bot.rig) for way in machine.ways])
    assert path[path[:, 3] < 0][:, 1].min() > 0.3
    with pytest.raises(ContractError, match="Paint 2"):
        bot.dip(2)
    with pytest.raises(ContractError, match="2 wells"):
        bot.load_palette(np.zeros((3, 3)))


def test_the_person_is_asked_only_with_the_tool_up() -> None:
    bot, machine, asked = robot()
    machine.pose = poses_of(np.array([[0, 0.05, 0.05, -0.001, 0.0]]), bot.rig)[0]
    bot.change_tool(load_tool("marker"))
    assert machine.pose[2, 3] == pytest.approx(0.08) and "marker" in asked[0]
    bot.change_tool(load_tool("marker"))
    assert len(asked) == 1
    bot.new_sheet()
    assert "blank sheet" in asked[1]


def test_a_lift_during_a_stroke_breaks_it_off_and_raises_the_tool() -> None:
    bot, machine, _ = robot()
    here: list[np.ndarray] = []

    def press_stop() -> None:
        here.append(machine.pose)
        bot._halts += 1  # as `lift` from another thread does before it waits for this move to end

    machine.at_way[2] = press_stop
    with pytest.raises(HaltedError):
        bot.move(stroke())
    assert here[0][2, 3] < 0.05
    bot.lift()
    assert machine.halts == 1 and machine.pose[2, 3] == pytest.approx(0.08)
    assert machine.pose[:2, 3] == pytest.approx(here[0][:2, 3])
    ways = len(machine.ways)
    bot.lift()
    assert len(machine.ways) == ways  # up already


def test_a_robot_at_rest_in_the_air_is_not_halted_again_but_one_after_a_fault_is() -> None:
    """After a fault the machine may still have motions in its queue."""
    bot, machine, _ = robot()
    bot.lift()
    assert machine.halts == 1  # what the machine did before it was opened nobody knows
    bot.move(stroke())
    bot.lift()
    assert machine.halts == 1

    def fail() -> None:
        raise OSError("the link is lost")

    machine.at_way[len(machine.ways)] = fail
    with pytest.raises(OSError, match="link"):
        bot.move(stroke())
    machine.pose = poses_of(np.array([[0, 0.05, 0.05, bot.rig.travel_height_m, 0.0]]), bot.rig)[0]
    bot.lift()
    assert machine.halts == 2


def test_a_halt_between_two_ways_is_not_lost() -> None:
    bot, machine, _ = robot()
    follow = machine.follow

    def follow_and_halt(times_s: np.ndarray, poses: np.ndarray) -> np.ndarray:
        done = follow(times_s, poses)
        bot._halts += 1
        return done

    machine.follow = follow_and_halt  # type: ignore[method-assign]
    with pytest.raises(HaltedError, match="stroke broke off"):
        bot.move(stroke())
    assert len(machine.ways) == 1


def test_what_the_rig_lacks_is_said() -> None:
    bot, _, _ = robot(make_rig(palette=None))
    interface: Robot = bot
    for ask in (interface.photo, interface.scan, interface.wipe, lambda: interface.dip(0)):
        with pytest.raises((MissingAbilityError, ContractError)):
            ask()
    photo = Photo(np.zeros((2, 2, 3), np.uint8), 0.01, 1.0, np.ones(3), 0.0)
    assert robot(camera=lambda: photo)[0].photo() is photo


def test_for_a_photograph_the_tool_leaves_the_picture_at_travel_height() -> None:
    taken_at: list[np.ndarray] = []
    photo = Photo(np.zeros((2, 2, 3), np.uint8), 0.01, 1.0, np.ones(3), 0.0)

    def camera() -> Photo:
        taken_at.append(path_of(np.zeros(1), machine.pose[None], bot.rig)[0, 1:])
        return photo

    bot, machine, _ = robot(camera=camera)
    bot.move(stroke())
    ways = len(machine.ways)
    bot.photo()
    bot.photo()
    assert taken_at[0][:3] == pytest.approx([0.1, -0.05, 0.03]) and len(machine.ways) == ways + 1
    path = path_of(*machine.ways[-1], bot.rig)
    assert path[:, 3].min() == pytest.approx(0.03)


def test_closing_lifts_first() -> None:
    bot, machine, _ = robot()
    machine.pose = poses_of(np.array([[0, 0.05, 0.05, -0.001, 0.0]]), bot.rig)[0]
    bot.close()
    assert machine.closed and machine.pose[2, 3] == pytest.approx(0.08)
    assert bot.canvas_size_m == (0.3, 0.2) and bot.clock_s >= 0
    bot.wait(0.0)
