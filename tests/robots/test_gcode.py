"""G-code is parsed back into metres and seconds."""

import re
from pathlib import Path

import numpy as np
import pytest

from pentimento.contracts.errors import ConfigError
from pentimento.robots.gcode import Pen, connect, gcode_of, pen_of
from pentimento.robots.hardware import HardwareRobot
from pentimento.robots.motion import timed_path
from pentimento.robots.tools import load_tool
from tests.robots.machines import make_rig

SERVO = Pen("servo", up=30, down=60, paper_z_m=-0.01)


def way(*places_m: tuple[float, float, float]) -> tuple[np.ndarray, np.ndarray]:
    return np.arange(len(places_m)) * 0.5, np.array(places_m)


def parsed(lines: list[str]) -> tuple[np.ndarray, np.ndarray]:
    """Places [N, 3] in metres and feeds [N] in m/s of the lines that move."""
    found = [re.fullmatch(r"G1 X(\S+) Y(\S+) Z(\S+) F(\S+)", line) for line in lines if line.startswith("G1")]
    assert all(found)
    numbers = np.array([[float(value) for value in match.groups()] for match in found if match])
    return numbers[:, :3] / 1000, numbers[:, 3] / 60_000


def test_places_and_speeds_come_back_in_metres() -> None:
    s = np.linspace(0, 1, 24)
    path = timed_path(np.column_stack((0.02 + 0.05 * s, 0.03 + 0.01 * s**2, -0.01 - 0.001 * s, 0 * s)), 0.06)
    places_m, feeds_m_s = parsed(list(gcode_of(path[:, 0], path[:, 1:4], Pen("z"))))
    assert places_m == pytest.approx(path[1:, 1:4], abs=6e-7)
    speeds_m_s = np.linalg.norm(np.diff(path[:, 1:4], axis=0), axis=1) / np.diff(path[:, 0])
    assert feeds_m_s == pytest.approx(speeds_m_s, abs=1e-6)


def test_ten_millimetres_in_half_a_second_are_1200_a_minute() -> None:
    assert list(gcode_of(*way((0, 0, 0), (0.006, 0.008, 0)), Pen("z"))) == ["G1 X6.000 Y8.000 Z0.000 F1200.0"]


def test_a_servo_pen_goes_down_and_up_where_the_way_crosses_the_sheet() -> None:
    """From 5 mm above to 5 mm below the sheet over 10 mm: the pen falls half-way."""
    lines = list(gcode_of(*way((0, 0, -0.005), (0.01, 0, -0.015), (0.02, 0, -0.015), (0.03, 0, -0.005)), SERVO))
    assert lines == [
        "G1 X5.000 Y0.000 F1200.0", "M3 S60", "G4 P0.25", "G1 X10.000 Y0.000 F1200.0",
        "G1 X20.000 Y0.000 F1200.0",
        "G1 X25.000 Y0.000 F1200.0", "M3 S30", "G4 P0.25", "G1 X30.000 Y0.000 F1200.0",
    ]  # fmt: skip


def test_a_servo_pen_that_only_falls_makes_no_motion() -> None:
    lines = list(gcode_of(*way((0.01, 0, 0.0), (0.01, 0, -0.02)), SERVO))
    assert lines == ["M3 S60", "G4 P0.25"]


def test_nothing_but_numbers_can_get_into_a_line() -> None:
    """What the reach let through is finite; feeds never are zero, which GRBL refuses."""
    (line,) = gcode_of(np.array([0.0, 1e6]), np.array([[0, 0, 0], [1e-6, 0, 0]]), Pen("z"))
    assert line == "G1 X0.001 Y0.000 Z0.000 F0.1"


@pytest.mark.parametrize(
    "machine",
    [
        {},
        {"pen": "servo", "servo_up": -1, "servo_down": 2},
        {"pen": "laser"},
        {"pen": "z", "servo_up": 3},
        {"pen": "servo"},
        {"pen": "servo", "servo_up": 3},
    ],
)
def test_a_bad_pen_is_refused(machine: dict[str, object]) -> None:
    with pytest.raises(ConfigError, match="servo_up and servo_down"):
        pen_of(machine, make_rig())


def test_a_canvas_that_is_not_level_is_refused() -> None:
    with pytest.raises(ConfigError, match="level"):
        pen_of({"pen": "z"}, make_rig(turn_rad=(0.1, 0.0, 0.0)))


def test_a_drawing_on_file_holds_the_strokes_and_ends_with_the_pen_up(tmp_path: Path) -> None:
    target = tmp_path / "drawing.gcode"
    rig = make_rig(driver="gcode", palette=None, machine={"file": str(target), "pen": "z"})
    robot = HardwareRobot(connect(rig), rig, lambda _: None)
    robot.change_tool(load_tool("marker"))
    s = np.linspace(0, 1, 12)
    path = timed_path(np.column_stack((0.1 + 0.03 * s, 0.1 + 0 * s, -0.001 + 0 * s, 0 * s)), 0.06)
    measured = robot.move(path)
    assert measured.shape == path.shape and np.isnan(measured).all()
    assert not target.exists()
    robot.close()
    lines = target.read_text().splitlines()
    assert lines[:5] == [
        "(rig: bench)",
        "(units: mm, mm/min; absolute places in machine coordinates)",
        "(sheet: 300.000 x 200.000 mm, lower left corner at x 400.000 mm, y 100.000 mm)",
        "(sheet is turned by 90.000 deg about that corner)",
        "(z 50.000 mm touches the paper, z 80.000 mm between strokes)",
    ]
    assert lines[5:8] == ["G21", "G90", "G94"] and lines[-1].startswith("G1 ")
    places_m, _ = parsed([line for line in lines if " Z" in line and " X" in line])
    on_paper = places_m[places_m[:, 2] < 0.05]
    # canvas (x, y, z) -> robot (0.4 − y, 0.1 + x, 0.05 + z)
    assert on_paper[:, 0] == pytest.approx(np.full(len(on_paper), 0.3))
    assert on_paper[:, 1].min() == pytest.approx(0.2) and on_paper[:, 1].max() == pytest.approx(0.23)
    assert on_paper[:, 2].min() == pytest.approx(0.049)
    assert places_m[-1, 2] == pytest.approx(0.08)


def test_a_drawing_on_file_leaves_a_servo_up(tmp_path: Path) -> None:
    target = tmp_path / "drawing.gcode"
    pen = {"pen": "servo", "servo_up": 30, "servo_down": 60}
    rig = make_rig(driver="gcode", palette=None, machine={"file": str(target), **pen})
    connect(rig).close()
    lines = target.read_text().splitlines()
    assert lines[4] == "(no z: a servo lowers the pen by M3 S60 and raises it by M3 S30)"
    assert lines[-2:] == ["M3 S30", "G4 P0.25"] and "M5" not in lines


def test_a_rigs_name_stays_within_its_comment(tmp_path: Path) -> None:
    rig = make_rig(name="Plötter (2)\nG1 X0", driver="gcode", machine={"file": str(tmp_path / "a"), "pen": "z"})
    assert connect(rig).text().splitlines()[0] == "(rig: Pl?tter [2] G1 X0)"


def test_a_servo_that_is_up_below_down_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="servo_up is the smaller number"):
        pen_of({"pen": "servo", "servo_up": 60, "servo_down": 30}, make_rig())
