"""The SVG written is parsed back into metres."""

import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pytest

from pentimento.contracts.errors import ContractError
from pentimento.robots.driver import MissingAbilityError, Robot
from pentimento.robots.svg import SvgPlotter
from pentimento.robots.tools import load_tool

CANVAS_M = (0.3, 0.2)
INKSCAPE = "{http://www.inkscape.org/namespaces/inkscape}"
SVG = "{http://www.w3.org/2000/svg}"


def stroke(*points_m: tuple[float, float, float]) -> np.ndarray:
    path = np.zeros((len(points_m), 5))
    path[:, 0] = np.linspace(0, 1, len(points_m))
    path[:, 1:4] = points_m
    return path


def plotter(path: Path) -> SvgPlotter:
    robot = SvgPlotter(path, CANVAS_M)
    robot.change_tool(load_tool("marker"))
    return robot


def subpaths_m(element: ElementTree.Element, height_m: float) -> list[np.ndarray]:
    """Canvas points [N, 2] of each piece of a path, from its own text."""
    pieces = []
    for piece in element.attrib["d"].split("M")[1:]:
        numbers = np.array([float(n) for n in re.findall(r"-?[\d.]+", piece)]).reshape(-1, 2)
        pieces.append(np.column_stack((numbers[:, 0] / 1000, height_m - numbers[:, 1] / 1000)))
    return pieces


def test_strokes_come_back_in_metres_from_the_file(tmp_path: Path) -> None:
    target = tmp_path / "drawing.svg"
    robot = plotter(target)
    rng = np.random.default_rng(0)
    paths = [
        stroke(*np.column_stack((rng.uniform(0, 0.3, n), rng.uniform(0, 0.2, n), -np.full(n, 1e-3))))
        for n in (2, 32, 7)
    ]
    for path in paths:
        robot.move(path)
    assert not target.exists()
    robot.close()

    root = ElementTree.parse(target).getroot()
    assert root.tag == SVG + "svg"
    assert (root.attrib["width"], root.attrib["height"]) == ("300mm", "200mm")
    assert root.attrib["viewBox"] == "0 0 300 200"
    elements = root.findall(f"{SVG}g/{SVG}path")
    assert len(elements) == len(paths)
    for element, path in zip(elements, paths, strict=True):
        (points_m,) = subpaths_m(element, CANVAS_M[1])
        assert points_m == pytest.approx(path[:, 1:3], abs=1e-7)
        assert element.attrib["stroke"] == "#000000"
        assert float(element.attrib["stroke-width"]) == pytest.approx(2.0)
    assert [entry.name for entry in tmp_path.iterdir()] == ["drawing.svg"]


def test_up_on_the_canvas_is_up_on_the_page(tmp_path: Path) -> None:
    """The canvas's upper left corner is the SVG's origin."""
    target = tmp_path / "corner.svg"
    robot = plotter(target)
    robot.move(stroke((0, 0.2, -1e-3), (0, 0, -1e-3)))
    robot.close()
    assert ElementTree.parse(target).getroot()[0][0].attrib["d"] == "M0,0 L0,200"


def test_what_is_lifted_is_not_drawn(tmp_path: Path) -> None:
    """z crosses zero a quarter of the way down and half of the way up."""
    target = tmp_path / "lift.svg"
    robot = plotter(target)
    robot.move(stroke((0.1, 0.1, 1e-3), (0.14, 0.1, -3e-3), (0.16, 0.1, 3e-3), (0.2, 0.1, 3e-3), (0.2, 0.14, -1e-3)))
    robot.move(stroke((0.1, 0.1, 1e-3), (0.2, 0.1, 1e-3)))
    robot.close()
    ((element,),) = ElementTree.parse(target).getroot()
    first, second = subpaths_m(element, CANVAS_M[1])
    assert first == pytest.approx(np.array([[0.11, 0.1], [0.14, 0.1], [0.15, 0.1]]), abs=1e-7)
    assert second == pytest.approx(np.array([[0.2, 0.13], [0.2, 0.14]]), abs=1e-7)


def test_a_dipped_tool_draws_in_the_paint_of_its_last_dip(tmp_path: Path) -> None:
    target = tmp_path / "colours.svg"
    robot = SvgPlotter(target, CANVAS_M)
    robot.change_tool(load_tool("round_brush"))
    robot.load_palette(np.array([[1.0, 0, 0], [0, 0.2, 1.0]]))
    path = stroke((0.1, 0.1, -1e-3), (0.2, 0.1, -1e-3))
    with pytest.raises(ContractError, match="no paint"):
        robot.move(path)
    for paint in (1, 0, 1):
        robot.wipe()
        robot.dip(paint)
        robot.move(path)
    with pytest.raises(ContractError, match="Paint 2"):
        robot.dip(2)
    robot.close()
    layers = list(ElementTree.parse(target).getroot())
    assert [[element.attrib["stroke"] for element in layer] for layer in layers] == [["#0033ff"] * 2, ["#ff0000"]]
    assert [layer.attrib[f"{INKSCAPE}groupmode"] for layer in layers] == ["layer", "layer"]
    assert [layer.attrib[f"{INKSCAPE}label"] for layer in layers] == ["1 #0033ff", "2 #ff0000"]


def test_a_failed_write_leaves_the_old_drawing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    target = tmp_path / "drawing.svg"
    target.write_text("old")
    robot = plotter(target)
    robot.move(stroke((0.1, 0.1, -1e-3), (0.2, 0.1, -1e-3)))

    def full_disk(self: Path, other: Path) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", full_disk)
    with pytest.raises(OSError, match="No space"):
        robot.close()
    assert target.read_text() == "old"


def test_svg_plotter_implements_robot_and_rejects_missing_abilities(tmp_path: Path) -> None:
    robot: Robot = plotter(tmp_path / "x.svg")
    assert robot.canvas_size_m == CANVAS_M
    with pytest.raises(MissingAbilityError, match="camera"):
        robot.photo()
    with pytest.raises(MissingAbilityError, match="scanner"):
        robot.scan()
    path = stroke((0.1, 0.1, -1e-3), (0.2, 0.1, -1e-3))
    robot.new_sheet()
    measured = robot.move(path)
    assert measured.shape == path.shape and np.isnan(measured).all()
    robot.wait(2.5)
    assert robot.clock_s == pytest.approx(3.5)
    with pytest.raises(ContractError, match="one sheet"):
        robot.new_sheet()


def test_nothing_is_drawn_without_a_tool_or_after_closing(tmp_path: Path) -> None:
    path = stroke((0.1, 0.1, -1e-3), (0.2, 0.1, -1e-3))
    with pytest.raises(ContractError, match="change_tool"):
        SvgPlotter(tmp_path / "x.svg", CANVAS_M).move(path)
    robot = plotter(tmp_path / "y.svg")
    robot.close()
    with pytest.raises(ContractError, match="closed"):
        robot.move(path)
