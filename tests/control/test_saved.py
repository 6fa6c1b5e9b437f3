"""What a person saves: the photograph, the strokes that stand on the sheet, the recording, and the replay."""

import io
import json
import re
import zipfile
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import pyarrow.parquet as pq
import pytest

from pentimento.contracts.errors import ConfigError
from pentimento.contracts.images import decode_png, read_image
from pentimento.contracts.strokes import example_table
from pentimento.control.checkpoint import PaintingState
from pentimento.control.person import Control
from pentimento.control.replay import frames_of, replay_page
from pentimento.control.saved import drawing_of, gcode_of, made_strokes, saved_files, write_drawings
from pentimento.control.session import resume
from pentimento.robots.rig import load_rig
from pentimento.robots.tools import load_tool
from tests.bundle.line_brush import SIDE_M, journaled_sheet
from tests.control.paintings import begun, session_of
from tests.control.test_session import one_bar
from tests.robots.machines import make_rig

PEN = load_tool("marker")
LINE = {"points": [[0.1, 0.9, 0.5], [0.9, 0.9, 0.5]], "color": None}


@pytest.fixture(scope="module")
def duet(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, PaintingState]:
    """A person draws a line below, asks for a bar at the left, and stops."""
    folder, control, said = tmp_path_factory.mktemp("duet"), Control(), iter([("draw", json.dumps(LINE))])
    robot = journaled_sheet(folder)
    begun(robot, folder)
    control.send("your turn")
    orders = iter([("draw", json.dumps(LINE)), ("wish", "a bar"), ("stop",)])

    def person(state: PaintingState) -> None:
        if state.phase == "your turn":
            control.send(*next(orders))

    session = session_of(robot, folder, control, person, goals_for=one_bar, in_turns=True, in_studio=True)
    state = resume(session)
    robot.close()
    assert state.phase == "done" and next(said)
    return folder, state


def test_strokes_of_the_drawing_are_the_persons_line_and_the_robots(duet: tuple[Path, PaintingState]) -> None:
    folder, state = duet
    strokes = made_strokes(folder, PEN)
    assert len(strokes) == 1 + state.executed
    assert strokes[0].path[:, 2] == pytest.approx(0.1 * SIDE_M) and (strokes[0].color_srgb == PEN.color_srgb).all()
    recorded = pq.read_table(folder / "record")["path"].to_pylist()
    assert all(np.allclose(made.path, path) for made, path in zip(strokes[1:], recorded, strict=True))


def test_strokes_of_a_robot_without_a_journal_come_from_its_recording(
    duet: tuple[Path, PaintingState], tmp_path: Path
) -> None:
    folder, state = duet
    (tmp_path / "record").symlink_to(folder / "record")
    assert len(made_strokes(tmp_path, PEN)) == state.executed


def test_photograph_has_at_least_800_pixels_a_side_and_shows_the_canvas(duet: tuple[Path, PaintingState]) -> None:
    folder, state = duet
    picture = decode_png(saved_files(folder, PEN, (SIDE_M, SIDE_M))["painting.png"]())
    assert min(picture.shape[:2]) >= 800
    small = cv2.resize(picture, state.canvas.shape[1::-1], interpolation=cv2.INTER_AREA)
    assert np.abs(small.astype(int) - state.canvas).mean() < 3


def test_svg_and_gcode_hold_every_stroke(duet: tuple[Path, PaintingState]) -> None:
    folder, state = duet
    files = saved_files(folder, PEN, (SIDE_M, SIDE_M))
    assert files["painting.svg"]().count(b"<path") == 1 + state.executed
    lines = files["painting.gcode"]().decode().splitlines()
    heights = [float(found[1]) for line in lines if (found := re.search(r"Z(-?[\d.]+)", line))]
    landings = sum(before > -10 >= now for before, now in pairwise(heights))
    assert landings == 1 + state.executed and heights[-1] > -10 and "M0" not in lines


def test_drawing_that_is_too_large_for_the_plotter_is_saved_as_svg_alone(tmp_path: Path) -> None:
    path = [[0.0, 0.45, 0.1, -0.001, 0.0], [1.0, 0.5, 0.1, -0.001, 0.0]]
    (tmp_path / "journal.jsonl").write_text(json.dumps(["move", [path]]) + "\n")
    (sentence,) = write_drawings(tmp_path, PEN, (0.6, 0.4))
    assert sentence.startswith("There is no painting.gcode: ") and not (tmp_path / "painting.gcode").exists()
    assert (tmp_path / "painting.svg").read_text().count("<path") == 1


@pytest.mark.parametrize(("driver", "own"), [("gcode", True), ("grbl", True), ("xarm", False)])
def test_gcode_is_for_the_paintings_own_plotter(driver: str, own: bool, tmp_path: Path) -> None:
    path = [[0.0, 0.05, 0.1, -0.001, 0.0], [1.0, 0.1, 0.1, -0.001, 0.0]]
    (tmp_path / "journal.jsonl").write_text(json.dumps(["move", [path]]) + "\n")
    rig = make_rig(driver=driver, palette=None, machine={"pen": "z", "port": "/dev/null", "baud": 115200})
    assert write_drawings(tmp_path, PEN, (0.3, 0.2), rig) == []
    lines = (tmp_path / "painting.gcode").read_text().splitlines()
    assert lines[0] == f"(rig: {'bench' if own else 'plotter_on_file'})"
    heights = [float(found[1]) for line in lines if (found := re.search(r"Z(-?[\d.]+)", line))]
    assert min(heights) == pytest.approx(49 if own else -11)  # 1 mm into the paper


BRUSH = load_tool("round_brush")
LOADS = [
    ("wipe", 0),
    ("dip", 0),
    ("move", 0),
    ("move", 0),
    ("dip", 0),
    ("move", 0),
    ("wipe", 0),
    ("dip", 1),
    ("move", 0),
]
"""A red load for two strokes, another for one, and a blue one after a wash."""


@pytest.fixture
def dipped(tmp_path: Path) -> Path:
    """A folder with the journal of `LOADS`."""
    path = [[0.0, 0.05, 0.1, -0.001, 0.0], [1.0, 0.1, 0.1, -0.001, 0.0]]
    given = {"wipe": lambda _: [], "dip": lambda paint: [paint], "move": lambda _: [path]}
    commands = [["load_palette", [[[1, 0, 0], [0, 0, 1]]]], *([name, given[name](paint)] for name, paint in LOADS)]
    (tmp_path / "journal.jsonl").write_text("".join(json.dumps(command) + "\n" for command in commands))
    return tmp_path


def visits(lines: list[str], places_m: list[tuple[float, float]], tool_height_mm: float) -> list[int]:
    """Index of the place each time the tip goes down near one, from the lines of a G-code file."""
    rig, down, found = load_rig("plotter_on_file"), False, []
    for line in lines:
        values = dict(re.findall(r"([XYZ])(-?[\d.]+)", line))
        if set(values) < {"X", "Y", "Z"}:
            continue
        x, y, z = (float(values[axis]) for axis in "XYZ")
        here = np.array([x, y]) / 1000 - rig.origin_m[:2]
        near = [number for number, place in enumerate(places_m) if np.linalg.norm(here - place) < 0.005]
        if z < tool_height_mm and near and not down:
            found.append(near[0])
        down = z < tool_height_mm
    return found


def test_gcode_of_a_brush_goes_to_the_well_at_each_dip_and_to_the_water_first(dipped: Path) -> None:
    strokes = made_strokes(dipped, BRUSH)
    assert [stroke.color_srgb.tolist() for stroke in strokes] == [[1, 0, 0]] * 3 + [[0, 0, 1]]
    assert [(stroke.dip, stroke.wash) for stroke in strokes] == [
        (True, True), (False, False), (True, False), (True, True)
    ]  # fmt: skip
    lines = gcode_of(strokes, BRUSH).decode().splitlines()
    places = load_rig("plotter_on_file").palette
    assert places is not None
    wells, water = list(places.wells_m), len(places.wells_m)
    assert visits(lines, [*wells, places.water_m], -12.5) == [water, 0, 0, water, 1]
    assert lines.count("M0") == 1 and "well 1: #ff0000, well 2: #0000ff" in lines[lines.index("M0") - 1]
    assert [line for line in lines[lines.index("M0") :] if line.startswith("(")] == [
        "(wash and wipe)", "(dip: well 1)", "(dip: well 1)", "(wash and wipe)", "(dip: well 2)"
    ]  # fmt: skip


def test_svg_of_a_brush_has_a_layer_with_a_visit_for_each_dip(dipped: Path) -> None:
    document = drawing_of(made_strokes(dipped, BRUSH), BRUSH, (0.3, 0.2)).decode()
    labels = re.findall(r'inkscape:label="([^"]*)"', document)
    assert labels == ["1 dip 1 well 1 #ff0000", "2 dip 2 well 1 #ff0000", "3 dip 3 well 2 #0000ff"]
    layers = [re.findall(r"<path[^>]*>", layer) for layer in document.split("<g ")[1:]]
    # Water, cloth, well, two strokes; well, stroke; water, cloth, well, stroke.
    assert [len(paths) for paths in layers] == [5, 2, 4]
    places = load_rig("plotter_on_file").palette
    assert places is not None
    for layer, at, place in ((0, 0, places.water_m), (0, 1, places.cloth_m), (0, 2, places.wells_m[0]),
                             (1, 0, places.wells_m[0]), (2, 2, places.wells_m[1])):  # fmt: skip
        points = np.array([float(v) for v in re.findall(r"-?[\d.]+", layers[layer][at].split('"')[1])]).reshape(-1, 2)
        assert points.mean(axis=0) == pytest.approx([1000 * place[0], 200 - 1000 * place[1]], abs=6)


def test_svg_has_no_visits_where_the_sheet_reaches_the_wells(dipped: Path) -> None:
    document = drawing_of(made_strokes(dipped, BRUSH), BRUSH, (0.6, 0.4)).decode()
    assert re.findall(r'inkscape:label="([^"]*)"', document) == ["1 #ff0000", "2 #0000ff"]
    assert document.count("<path") == 4


def test_dips_of_a_recording_are_those_of_its_loads(dipped: Path) -> None:
    """`since_reload` is 0 for the first stroke of a load, and a wash is due where the colour changes."""
    rows = example_table(6, 1)
    (dipped / "journal.jsonl").unlink()
    (dipped / "record").mkdir()
    pq.write_table(rows, dipped / "record/part.parquet")
    strokes = made_strokes(dipped, BRUSH)
    assert [stroke.dip for stroke in strokes] == [number == 0 for number in rows["since_reload"].to_pylist()]
    assert all(stroke.dip for stroke in strokes if stroke.wash) and strokes[0].wash


def test_recording_is_the_folders(duet: tuple[Path, PaintingState]) -> None:
    folder, _ = duet
    with zipfile.ZipFile(io.BytesIO(saved_files(folder, PEN, (SIDE_M, SIDE_M))["recording.zip"]())) as archive:
        assert archive.testzip() is None
        assert {name: archive.read(name) for name in archive.namelist()} == {
            f"record/{file.name}": file.read_bytes() for file in (folder / "record").iterdir()
        }


def test_replay_shows_the_start_each_turn_and_each_stroke(duet: tuple[Path, PaintingState]) -> None:
    folder, state = duet
    frames = frames_of(folder)
    captions = [frame.caption for frame in frames]
    assert captions[:2] == ["The sheet at the start", "Turn 1, yours; asked for: “a bar”"]
    assert len(frames) == 2 + state.executed
    side = frames[0].picture.shape[0]
    drawn = frames[0].picture.min(-1).astype(int) - frames[1].picture.min(-1) > 60
    assert drawn[round(0.85 * side) : round(0.95 * side)].sum() > side and not drawn[: round(0.8 * side)].any()
    last = read_image(folder / "painting.png")
    times = np.linspace(0, last.shape[0] - 1, side).round().astype(int)
    assert np.abs(frames[-1].picture.astype(int) - last[times][:, times]).mean() < 6


def test_replay_ends_with_a_line_that_was_drawn_before_stop(tmp_path: Path) -> None:
    robot, control = journaled_sheet(tmp_path), Control()
    begun(robot, tmp_path)
    high = {"points": [[0.1, 0.1, 0.5], [0.9, 0.1, 0.5]], "color": None}
    orders = iter([("draw", json.dumps(LINE)), ("go on",), ("draw", json.dumps(high)), ("stop",)])
    control.send("your turn")

    def person(state: PaintingState) -> None:
        if state.phase == "your turn":
            control.send(*next(orders))

    resume(session_of(robot, tmp_path, control, person, in_turns=True, in_studio=True))
    robot.close()
    *_, before, last = frames_of(tmp_path)
    side = last.picture.shape[0]
    new = before.picture.min(-1).astype(int) - last.picture.min(-1) > 60
    # y of the page points down; the robot's own bar may cross the line.
    assert last.caption == "Turn 2, yours" and before.caption.startswith("The robot’s stroke")
    assert new[round(0.05 * side) : round(0.15 * side)].sum() > side and not new[round(0.2 * side) :].any()


def test_replay_is_one_file_that_loads_nothing(duet: tuple[Path, PaintingState]) -> None:
    page = replay_page(duet[0])
    assert page.count("data:image/jpeg;base64,") == len(frames_of(duet[0]))
    assert not re.search(r"(https?:)?//[a-z]", re.sub(r"base64,[^\"]*", "", page))


def test_nothing_to_save_is_one_sentence(tmp_path: Path) -> None:
    for name, give in saved_files(tmp_path, PEN, (SIDE_M, SIDE_M)).items():
        with pytest.raises(ConfigError) as raised:
            give()
        assert str(raised.value).endswith("."), name
