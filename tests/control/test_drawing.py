"""An SVG drawing is the plan: what the robot draws is the drawing, in size, place, order, corners and colour."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from pentimento.cli.main import main
from pentimento.contracts.covariates import fresh_memory
from pentimento.contracts.errors import ContractError, EnvelopeViolation
from pentimento.contracts.images import read_image
from pentimento.contracts.strokes import CONTRACT
from pentimento.contracts.tables import read_table
from pentimento.control.checkpoint import load_state, save_state
from pentimento.control.drawing import DrawnPlan, drawn_plan
from pentimento.control.execute import Session, execute
from pentimento.control.guard import GuardedRobot
from pentimento.control.safety import envelope_for
from pentimento.robots.svg import SvgPlotter
from pentimento.robots.tools import load_tool
from pentimento.svg.drawing import read_drawing
from tests.bundle.tiny_bundle import CANVAS_M
from tests.control.painting_bundle import write_painting_bundle

PEN, BRUSH = load_tool("marker"), load_tool("round_brush")
SHEET_M = (0.2, 0.1)
ZIGZAG = "M20,80 L60,20 L100,80"


def written(folder: Path, head: str, *content: str) -> Path:
    path = folder / "drawing.svg"
    path.write_text(f'<svg xmlns="http://www.w3.org/2000/svg" {head}>{"".join(content)}</svg>')
    return path


def plan(path: Path, tool=PEN, sheet_m=SHEET_M) -> DrawnPlan:  # type: ignore[no-untyped-def]
    return drawn_plan(path, tool, sheet_m, envelope_for(tool, sheet_m))


def ends_mm(found: DrawnPlan, tool=PEN) -> np.ndarray:  # type: ignore[no-untyped-def]
    """[S, 4] x and y of each stroke's first and last point."""
    paths = [stroke.path for stroke in found.strokes.planned(tool, 0)]
    return np.array([[*path[0, 1:3], *path[-1, 1:3]] for path in paths]) * 1e3


def test_a_page_in_millimetres_keeps_its_size_at_the_lower_left_corner(tmp_path: Path) -> None:
    """A page of 100 mm on a sheet of 200 x 100 mm; the viewBox does not begin at 0."""
    head = 'width="100mm" height="50mm" viewBox="10 10 200 100"'
    path = written(tmp_path, head, '<path d="M10,110 L210,10"/><path d="M110,60 h20"/>')
    found = plan(path)
    assert ends_mm(found) == pytest.approx(np.array([[0, 0, 100, 50], [50, 25, 60, 25]]), abs=1e-6)
    assert "100 x 50 mm" in found.sentence


@pytest.mark.parametrize(
    ("head", "scale", "shift"),
    [
        ('viewBox="0 0 100 100"', 1.0, (50, 0)),
        ('width="744px" height="372px" viewBox="0 0 100 50"', 2.0, (0, 0)),
        ('width="400mm" height="400mm" viewBox="0 0 100 100"', 1.0, (50, 0)),
    ],
    ids=["no size", "pixels", "larger than the sheet"],
)
def test_any_other_page_is_as_large_as_the_sheet_allows(
    head: str, scale: float, shift: tuple[float, float], tmp_path: Path
) -> None:
    path = written(tmp_path, head, '<path d="M10,40 L30,40"/>')
    height = 50 if "0 0 100 50" in head else 100
    x, y = shift
    expected = [10 * scale + x, (height - 40) * scale + y, 30 * scale + x, (height - 40) * scale + y]
    assert ends_mm(plan(path)) == pytest.approx(np.array([expected]), abs=1e-6)


def test_without_a_page_the_box_of_the_lines_is_fitted(tmp_path: Path) -> None:
    path = written(tmp_path, "", '<path d="M-5,3 L45,3"/><path d="M-5,3 V8"/>')
    assert ends_mm(plan(path)) == pytest.approx(np.array([[0, 60, 200, 60], [0, 60, 0, 40]]), abs=1e-6)


def test_paths_keep_the_corners_and_pass_the_envelope(tmp_path: Path) -> None:
    head = 'width="200mm" height="100mm" viewBox="0 0 200 100"'
    found = plan(written(tmp_path, head, f'<path d="{ZIGZAG}"/><circle cx="150" cy="50" r="20"/>'))
    zigzag, circle = (stroke.path for stroke in found.strokes.planned(PEN, 0))
    assert np.linalg.norm(zigzag[:, 1:3] - [0.06, 0.08], axis=1).min() < 1e-9
    assert np.linalg.norm(circle[:, 1:3] - [0.15, 0.05], axis=1) == pytest.approx(0.02, abs=0.05e-3)
    for path in (zigzag, circle):
        assert np.linalg.norm(np.diff(path[:, 1:3], axis=0), axis=1).max() < 1.6e-3
        assert (path[:, 3] == -sum(PEN.press_range_m) / 2).all()


def test_a_brush_makes_long_lines_of_strokes_that_its_paint_lasts_in_the_drawings_colours(tmp_path: Path) -> None:
    head = 'width="200mm" height="100mm" viewBox="0 0 200 100"'
    red = '<path d="M10,50 H190" stroke="#ff0000"/>'
    blue = '<g fill="blue"><rect x="5" y="5" width="9" height="9"/></g>'
    found = plan(written(tmp_path, head, red, blue, red), BRUSH)
    assert found.palette_srgb.tolist() == [[1, 0, 0], [0, 0, 1]]
    strokes = found.strokes.planned(BRUSH, 0)
    for stroke in strokes:
        assert np.ptp(stroke.path[:, 1:3], axis=0).max() <= BRUSH.stroke_length_m[1] + 1e-9
        assert np.abs(found.palette_srgb - stroke.color_srgb).max(axis=1).min() < 1e-6
    red_ends = [stroke.path[[0, -1], 1:3] for stroke in strokes if stroke.color_srgb[0] > 0.5]
    assert len(red_ends) >= 2 * 0.18 / BRUSH.stroke_length_m[1]
    joined = sum(np.allclose(before[1], after[0]) for before, after in pairwise(red_ends))
    assert joined == len(red_ends) - 2  # all but the two beginnings


def test_what_leaves_the_canvas_or_has_no_colour_is_refused(tmp_path: Path) -> None:
    head = 'width="200mm" height="100mm" viewBox="0 0 200 100"'
    path = written(tmp_path, head, '<path d="M10,50 H190"/><path d="M10,50 H210"/>')
    with pytest.raises(EnvelopeViolation, match=r"stroke 2.*page"):
        plan(path)
    path = written(tmp_path, head, '<path d="M10,50 H190" stroke="url(#fade)"/>')
    with pytest.raises(ContractError, match="no colour"):
        plan(path, BRUSH)
    assert len(plan(path).strokes) == 1  # a pen has its own ink


def test_a_drawing_comes_back_as_it_was(tmp_path: Path) -> None:
    """SVG → strokes → the plotter's SVG: the same lines, in millimetres, in layers by colour."""
    head = 'width="200mm" height="100mm" viewBox="0 0 200 100"'
    content = '<path d="M10,10 L30,10 L30,30" stroke="#ff0000"/><path d="M50,50 L52,90" stroke="#0000ff"/>'
    first = plan(written(tmp_path, head, content), BRUSH)
    plotter = SvgPlotter(tmp_path / "again.svg", SHEET_M)
    execute(
        GuardedRobot(plotter, envelope_for(BRUSH, SHEET_M)), BRUSH, first.strokes.planned(BRUSH, 0),
        palette_srgb=first.palette_srgb, memory=fresh_memory(SHEET_M, BRUSH.nominal_width_m),
        session=Session("again", 0.0),
    )  # fmt: skip
    plotter.close()
    again = plan(tmp_path / "again.svg", BRUSH)
    assert ends_mm(again, BRUSH) == pytest.approx(ends_mm(first, BRUSH), abs=1e-3)
    assert {line.paint for line in read_drawing(tmp_path / "again.svg", None).lines} == {"#ff0000", "#0000ff"}
    assert again.palette_srgb.tolist() == first.palette_srgb.tolist()


@pytest.fixture(scope="module")
def bundle(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_painting_bundle(tmp_path_factory.mktemp("bundle"))


@pytest.fixture
def drawing(tmp_path: Path) -> Path:
    """Two lines on a page of the bundle's canvas."""
    width, height = (1e3 * side for side in CANVAS_M)
    head = f'width="{width}mm" height="{height}mm" viewBox="0 0 {width} {height}"'
    lines = (f'<path d="M{0.2 * width},{y * height} H{0.8 * width}"/>' for y in (0.3, 0.7))
    return written(tmp_path, head, *lines)


def test_run_draws_the_drawing_and_looks_without_changing_it(bundle: Path, drawing: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    options = ("--replan-every", "1")
    assert main(["run", str(bundle), "--goal-svg", str(drawing), "--out", str(out), *options]) == 0
    state = load_state(out)
    assert state.executed == 2 and len(state.remaining) == 0
    rows = read_table(out / "record", CONTRACT).table.to_pylist()
    expected = plan(drawing, load_tool("marker"), CANVAS_M)
    width, height = CANVAS_M
    for row, y in zip(rows, (0.7, 0.3), strict=True):
        path = np.array(row["path"])
        assert path[:, 2] == pytest.approx(y * height, abs=1e-6)
        assert path[[0, -1], 1] == pytest.approx([0.2 * width, 0.8 * width], abs=1e-6)
    assert len(expected.strokes) == 2
    canvas, goal = (read_image(out / name).astype(float) for name in ("canvas.png", "goal.png"))
    assert canvas[goal < 100].mean() < canvas[goal > 200].mean() - 60  # the ink is where the drawing is
    assert json.loads((out / "commission.json").read_text())["wanted"] == {"kind": "drawing", "value": str(drawing)}


def test_a_drawing_is_kept_in_the_checkpoint(bundle: Path, drawing: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert main(["run", str(bundle), "--goal-svg", str(drawing), "--out", str(out)]) == 0
    strokes = plan(drawing, load_tool("marker"), CANVAS_M).strokes
    for some in (strokes, strokes.pick(slice(0, 1)), strokes.pick(slice(0, 0))):
        save_state(out, replace(load_state(out), remaining=some))
        found = load_state(out).remaining
        assert type(found) is type(strokes) and len(found) == len(some)
        assert all(np.array_equal(a, b) for a, b in zip(found.lines, some.lines, strict=True))  # type: ignore[attr-defined]
        assert np.array_equal(found.color, some.color)


def test_run_refuses_what_would_change_a_drawing_and_leaves_no_folder(
    bundle: Path, drawing: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    with pytest.raises(SystemExit):
        main(["run", str(bundle), "--goal-svg", str(drawing), "--out", str(out), "--strokes", "3"])
    assert "is a plan already" in capsys.readouterr().err
    drawing.write_text("no drawing")
    assert main(["run", str(bundle), "--goal-svg", str(drawing), "--out", str(out)]) == 1
    assert "cannot be read as SVG" in capsys.readouterr().err and not out.exists()
