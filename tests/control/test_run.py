"""The command `pentimento run` from a bundle to a painting, in processes without PyTorch."""

from __future__ import annotations

import io
import json
import subprocess
import sys
import urllib.error
import urllib.request
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pytest

from pentimento.cli.main import main
from pentimento.contracts.images import read_image, write_png
from pentimento.contracts.strokes import CONTRACT
from pentimento.contracts.tables import read_table
from pentimento.control.checkpoint import load_state
from pentimento.control.commission import Wanted
from pentimento.control.person import Control, Progress
from pentimento.control.run import commission_of, run
from tests.bundle.tiny_bundle import CANVAS_M
from tests.control.painting_bundle import write_painting_bundle

WITHOUT_TORCH = """
import sys
from pentimento.cli.main import main
code = main(sys.argv[1:])
heavy = sorted({"torch", "onnx", "skimage", "sklearn", "transformers", "diffusers"} & set(sys.modules))
assert not heavy, heavy
sys.exit(code)
"""


@pytest.fixture(scope="module")
def bundle(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_painting_bundle(tmp_path_factory.mktemp("bundle"))


@pytest.fixture(scope="module")
def picture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two dark bars on white."""
    image = np.full((80, 120, 3), 255, np.uint8)
    image[20:26, 15:105] = 20
    image[30:70, 57:63] = 20
    path = tmp_path_factory.mktemp("picture") / "t.png"
    write_png(path, image)
    return path


def _apart(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-W", "error", "-c", WITHOUT_TORCH, *map(str, arguments)],
        capture_output=True, text=True, timeout=120,
    )  # fmt: skip


def test_a_picture_is_painted_by_the_virtual_robot_without_torch(bundle: Path, picture: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    done = _apart("run", bundle, "--goal-image", picture, "--out", out)
    assert done.returncode == 0, done.stderr
    assert "strokes are made" in done.stdout and done.stderr == ""  # nobody is at a terminal
    told = json.loads((out / "painting.json").read_text())
    rows = read_table(out / "record", CONTRACT)
    assert rows.table.num_rows == told["strokes"] == load_state(out).executed and not rows.quarantined
    canvas, goal = (read_image(out / name) for name in ("canvas.png", "goal.png"))
    assert canvas.shape == goal.shape
    assert canvas.min() < goal.max() - 60  # there is ink
    again = _apart("run", "--resume", out)
    assert again.returncode == 0 and read_table(out / "record", CONTRACT).table.num_rows == told["strokes"]


def test_words_make_a_goal_that_is_painted_without_torch(bundle: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    done = _apart("run", bundle, "--goal-text", "a cat", "--out", out, "--strokes", "4", "--batch", "2", "--seed", "5")
    assert done.returncode == 0, done.stderr
    commission = json.loads((out / "commission.json").read_text())
    assert commission["wanted"] == {"kind": "words", "value": "a cat"}
    assert (commission["strokes"], commission["batch"], commission["seed"]) == (4, 2, 5)
    assert load_state(out).executed <= 4
    goal, canvas = (read_image(out / name).astype(float) for name in ("goal.png", "canvas.png"))
    middle = slice(8, 40)  # the centred square of 48 x 32 pixels; these networks ask for a darker upper half
    assert goal[:14, middle].mean() < goal[18:, middle].mean() - 60
    assert canvas[:16].mean() < canvas[16:].mean()  # and that is where the robot drew


def test_a_drawing_on_file_holds_the_strokes(
    bundle: Path, picture: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert main(["run", str(bundle), "--robot", "svg", "--goal-image", str(picture), "--out", str(out)]) == 0
    drawn = ElementTree.parse(out / "drawing.svg").getroot()
    assert len(drawn) == load_state(out).executed > 0
    assert not (out / "record").exists()  # what nobody saw is not recorded
    assert str(out) in capsys.readouterr().out


def test_the_page_is_there_while_it_paints(bundle: Path, picture: Path, tmp_path: Path) -> None:
    out, control, seen = tmp_path / "out", Control(), []

    def look(address: str) -> None:
        with urllib.request.urlopen(f"{address}state.json", timeout=5) as answer:
            seen.append((address, answer.status))
        control.send("stop")

    commission = commission_of(bundle, Wanted("picture", str(picture)), robot="svg")
    state = run(
        commission, out, resume=False, calibration=tmp_path, ask=print, page=look, control=control,
        progress=Progress(io.StringIO()),
    )  # fmt: skip
    assert state.phase == "stopped" and state.executed == 0 and seen[0][1] == 200
    with pytest.raises(urllib.error.URLError):
        urllib.request.urlopen(seen[0][0], timeout=5)


def test_a_folder_holds_one_painting(
    bundle: Path, picture: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["run", str(bundle), "--robot", "svg", "--goal-image", str(picture), "--out", str(tmp_path / "out")]
    assert main(arguments) == 0
    assert main(arguments) == 1
    assert capsys.readouterr().err.count("--resume") == 1


def test_a_picture_that_cannot_be_read_leaves_no_folder_behind(
    bundle: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "cut.jpg").write_bytes(b"\xff\xd8 and no more")
    for name in ("cut.jpg", "nowhere.jpg"):
        out = tmp_path / "out"
        assert main(["run", str(bundle), "--goal-image", str(tmp_path / name), "--out", str(out)]) == 1
        assert name in capsys.readouterr().err and not out.exists()


def test_a_file_is_no_folder_for_a_painting(
    bundle: Path, picture: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "file"
    file.write_text("mine")
    for out in (file, file / "below"):
        assert main(["run", str(bundle), "--goal-image", str(picture), "--out", str(out)]) == 1
        assert "a file is in its place" in capsys.readouterr().err
    assert main(["run", "--resume", str(file)]) == 1
    assert "no painting" in capsys.readouterr().err and file.read_text() == "mine"


def test_a_damaged_state_is_not_advised_to_be_gone_on_with(
    bundle: Path, picture: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert main(["run", str(bundle), "--robot", "svg", "--goal-image", str(picture), "--out", str(out)]) == 0
    (out / "state.npz").write_bytes(b"torn")
    assert main(["run", "--resume", str(out)]) == 1
    said = capsys.readouterr().err
    assert "damaged" in said and "--resume" not in said


def test_a_folder_with_something_else_in_it_is_left_alone(
    bundle: Path, picture: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "canvas.png").write_bytes(b"mine")
    arguments = ["--robot", "svg", "--goal-image", str(picture), "--out", str(tmp_path)]
    assert main(["run", str(bundle), *arguments]) == 1
    assert "other files" in capsys.readouterr().err
    assert [file.name for file in tmp_path.iterdir()] == ["canvas.png"]


def test_a_goal_that_is_there_already_needs_no_stroke_and_that_is_said(
    bundle: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_png(tmp_path / "blank.png", np.full((80, 80, 3), 255, np.uint8))
    arguments = ["--robot", "svg", "--goal-image", str(tmp_path / "blank.png"), "--out", str(tmp_path / "out")]
    assert main(["run", str(bundle), *arguments]) == 0
    assert "No stroke was made" in capsys.readouterr().out


def test_a_bundle_that_was_changed_is_refused_before_anything_is_written(
    bundle: Path, picture: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    copy = tmp_path / "copy"
    copy.mkdir()
    for file in bundle.rglob("*"):
        if file.is_file():
            (copy / file.relative_to(bundle)).parent.mkdir(parents=True, exist_ok=True)
            (copy / file.relative_to(bundle)).write_bytes(file.read_bytes())
    (copy / "card.md").write_text("changed")
    out = tmp_path / "out"
    assert main(["run", str(copy), "--goal-image", str(picture), "--out", str(out)]) == 1
    assert "refused" in capsys.readouterr().err and not out.exists()


def test_a_painting_is_finished_with_the_bundle_that_it_was_begun_with(
    bundle: Path, picture: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert main(["run", str(bundle), "--robot", "svg", "--goal-image", str(picture), "--out", str(out)]) == 0
    commission = json.loads((out / "commission.json").read_text())
    (out / "commission.json").write_text(json.dumps(commission | {"digest": "0" * 64}))
    assert main(["run", "--resume", str(out)]) == 1
    assert "another bundle" in capsys.readouterr().err


def test_hardware_that_is_not_calibrated_does_not_move(
    bundle: Path, picture: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rig = tmp_path / "small.toml"
    rig.write_text(SMALL_PLOTTER)
    arguments = ["run", str(bundle), "--robot", str(rig), "--goal-image", str(picture), "--out", str(tmp_path / "out")]
    assert main([*arguments, "--execute", "--calibration", str(tmp_path / "none")]) == 1
    assert "calibrat" in capsys.readouterr().err


def test_on_a_larger_sheet_the_painting_lies_in_the_lower_left_corner(
    bundle: Path, picture: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    assert main(["run", str(bundle), "--robot", "plotter", "--goal-image", str(picture), "--out", str(out)]) == 0
    rows = read_table(out / "record", CONTRACT).table.to_pylist()  # rehearsed, before a sheet of 300 x 200 mm
    places = np.concatenate([np.array(row["path"])[:, 1:3] for row in rows])
    assert np.all(places >= 0) and np.all(places <= CANVAS_M)


def test_a_rigs_own_limits_are_kept(
    bundle: Path, picture: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rig = tmp_path / "small.toml"
    rig.write_text(SMALL_PLOTTER + '[limits]\nmax_speed = "1 mm/s"\n')
    arguments = ["run", str(bundle), "--robot", str(rig), "--goal-image", str(picture), "--out", str(tmp_path / "out")]
    assert main(arguments) == 1
    assert "speed" in capsys.readouterr().err


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["b", "--resume", "o"],
        ["b"],
        ["b", "--out", "o", "--strokes", "0"],
        ["b", "--out", "o", "--strokes", "many"],
        ["b", "--out", "o", "--seed", "-1"],
        ["b", "--out", "o", "--goal-text", "a", "--goal-image", "f"],
        ["b", "--out", "o", "--goal-text", "\udcff"],  # a byte that is no UTF-8, as Python hands it over
        ["--resume", "o", "--strokes", "3"],
        ["--resume", "o", "--execute"],
        ["--resume", "o", "--robot", "virtual"],
    ],
)
def test_commands_that_say_too_little_or_too_much(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["run", *arguments])
    assert "usage" in capsys.readouterr().err


SMALL_PLOTTER = """
name = "small"
driver = "grbl"
canvas = ["60 mm", "40 mm"]
[canvas_to_robot]
origin = ["20 mm", "20 mm", "-10 mm"]
turn = ["0 deg", "0 deg", "0 deg"]
[reach]
low = ["0 mm", "0 mm", "-14 mm"]
high = ["380 mm", "280 mm", "0 mm"]
[travel]
height = "5 mm"
speed = "80 mm/s"
[machine]
port = "/dev/null"
baud = 115200
pen = "z"
"""
