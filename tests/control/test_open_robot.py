"""Opening the robot that a command names, and commissions in folders."""

from pathlib import Path

import numpy as np
import pytest

from pentimento.contracts.errors import CalibrationError, ConfigError, ContractError
from pentimento.control.commission import Commission, Wanted, exclusive, read_commission, write_commission
from pentimento.control.open_robot import RobotHandle, open_robot, rig_named
from pentimento.robots.driver import MissingAbilityError
from pentimento.robots.motion import timed_path
from pentimento.robots.tools import load_tool

CANVAS_M = (0.1, 0.08)
LINE = timed_path(np.array([[0.02, 0.02, -0.0005, 0], [0.05, 0.03, -0.0005, 0], [0.08, 0.02, -0.0005, 0]]), 0.06)


def _open(name: str, folder: Path, execute: bool = False) -> RobotHandle:
    def refuse(request: str) -> None:
        raise AssertionError(f"No request is expected: {request}")

    return open_robot(
        name, load_tool("marker"), CANVAS_M, folder=folder, seed=1, execute=execute, calibration=folder / "calibration",
        ask=refuse,
    )  # fmt: skip


@pytest.mark.parametrize("name", ["virtual", "virtual:marker"])
def test_open_virtual_robot_has_a_camera_and_keeps_its_clock(name: str, tmp_path: Path) -> None:
    opened = _open(name, tmp_path)
    assert opened.traits.has_camera and opened.traits.clock_persists
    assert opened.robot.canvas_size_m == CANVAS_M
    opened.robot.move(LINE)
    clock_s = opened.robot.clock_s
    opened.close()
    again = _open(name, tmp_path)
    assert again.robot.clock_s == clock_s
    again.close()


def test_open_svg_has_no_camera_and_keeps_strokes_when_reopened(tmp_path: Path) -> None:
    for y_m in (0.0, 0.02):
        opened = _open("svg", tmp_path)
        assert not opened.traits.has_camera
        opened.robot.change_tool(load_tool("marker"))
        opened.robot.move(LINE + np.array([0, 0, y_m, 0, 0]))
        with pytest.raises(MissingAbilityError):
            opened.robot.photo()
        opened.close()
    assert (tmp_path / "drawing.svg").read_text().count("<path") == 2


def test_open_gcode_writes_a_file_without_requests(tmp_path: Path) -> None:
    opened = _open("gcode", tmp_path)
    assert not opened.traits.has_camera
    opened.robot.change_tool(load_tool("marker"))
    opened.robot.move(LINE)
    opened.close()
    assert "G1 X" in (tmp_path / "drawing.gcode").read_text()


def test_open_hardware_without_execute_is_a_virtual_robot_of_its_size(tmp_path: Path) -> None:
    opened = _open("gcode:/dev/null", tmp_path)
    rig = rig_named("gcode:/dev/null")
    assert rig is not None and opened.robot.canvas_size_m == rig.canvas_size_m
    assert not opened.traits.has_camera and rig.camera is None
    opened.close()
    with_camera = _open("xarm", tmp_path / "xarm")
    assert with_camera.traits.has_camera
    with_camera.close()


def test_open_hardware_without_calibration_is_refused(tmp_path: Path) -> None:
    with pytest.raises(CalibrationError, match="calibrate"):
        _open("gcode:/dev/null", tmp_path, execute=True)


@pytest.mark.parametrize("name", ["nowhere", "nowhere.toml"])
def test_open_unknown_robot_is_refused(name: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="rig"):
        _open(name, tmp_path)


COMMISSION = Commission("/b", "d", "marker", "virtual", False, Wanted("words", "a – b"), 12, 3, 7)


def test_commission_round_trip(tmp_path: Path) -> None:
    write_commission(tmp_path, COMMISSION)
    assert read_commission(tmp_path) == COMMISSION


def test_write_commission_refuses_a_used_folder(tmp_path: Path) -> None:
    write_commission(tmp_path, COMMISSION)
    with pytest.raises(ContractError, match="--resume"):
        write_commission(tmp_path, COMMISSION)


def test_exclusive_refuses_a_second_process(tmp_path: Path) -> None:
    write_commission(tmp_path, COMMISSION)
    with exclusive(tmp_path), pytest.raises(ContractError, match="Another process"), exclusive(tmp_path):
        pass
    with exclusive(tmp_path):
        pass  # the first lock is released


def test_read_commission_rejects_missing_and_damaged_files(tmp_path: Path) -> None:
    with pytest.raises(ContractError, match="no painting"):
        read_commission(tmp_path)
    (tmp_path / "commission.json").write_text('{"bundle": "x"}')
    with pytest.raises(ContractError, match="missing"):
        read_commission(tmp_path)
    (tmp_path / "commission.json").write_text("{")
    with pytest.raises(ContractError, match="damaged"):
        read_commission(tmp_path)
