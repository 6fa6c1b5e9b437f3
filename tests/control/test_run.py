"""The command `pentimento run` from a bundle to a painting, in processes without PyTorch."""

from __future__ import annotations

import io
import json
import shutil
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.request
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pentimento.cli.main import main
from pentimento.contracts.images import read_image, write_png
from pentimento.contracts.strokes import CONTRACT
from pentimento.contracts.tables import read_table
from pentimento.control.checkpoint import PaintingState, load_state
from pentimento.control.commission import Wanted
from pentimento.control.layout import Wish
from pentimento.control.person import Control, Progress
from pentimento.control.run import commission_of, run
from pentimento.robots.calibration import Calibration, write_calibration
from pentimento.robots.rig import load_rig
from pentimento.robots.simulated_grbl import SimulatedGrbl
from tests.bundle.small_hands import HAND_POINTS
from tests.bundle.tiny_bundle import CANVAS_M, PLANNER
from tests.control.painting_bundle import small_vocabulary, write_painting_bundle
from tests.robots.small_plotter import small_plotter

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


@pytest.fixture(scope="module")
def finished(bundle: Path, picture: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a painting that was written to SVG. No test may change it."""
    out = tmp_path_factory.mktemp("finished") / "out"
    assert main(["run", str(bundle), "--robot", "svg", "--goal-image", str(picture), "--out", str(out)]) == 0
    return out


def _in_process(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-W", "error", "-c", WITHOUT_TORCH, *map(str, arguments)],
        capture_output=True, text=True, timeout=120,
    )  # fmt: skip


def test_run_paints_a_picture_without_torch(bundle: Path, picture: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    done = _in_process("run", bundle, "--goal-image", picture, "--out", out, "--strokes", "8")
    assert done.returncode == 0, done.stderr
    assert "strokes are made" in done.stdout and done.stderr == ""  # there is no terminal
    summary = json.loads((out / "painting.json").read_text())
    rows = read_table(out / "record", CONTRACT)
    assert rows.table.num_rows == summary["strokes"] == load_state(out).executed and not rows.quarantined
    canvas, goal = (read_image(out / name) for name in ("canvas.png", "goal.png"))
    assert canvas.shape == goal.shape
    assert canvas.min() < goal.max() - 60  # there is ink
    assert main(["run", "--resume", str(out)]) == 0  # it is done already
    assert read_table(out / "record", CONTRACT).table.num_rows == summary["strokes"]


def test_turns_without_terminal_and_page_are_refused_before_anything_is_drawn(
    bundle: Path, picture: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO("a sun\n"))
    out = tmp_path / "out"
    assert main(["run", str(bundle), "--goal-image", str(picture), "--out", str(out), "--turns"]) == 1
    said = capsys.readouterr().err
    assert "nobody can say whose turn it is: there is no terminal and no page" in said and "--page" in said
    assert not out.exists()


def test_run_paints_a_goal_from_words_without_torch(bundle: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    done = _in_process(
        "run", bundle, "--goal-text", "a cat", "--out", out, "--strokes", "4", "--replan-every", "2", "--seed", "5"
    )
    assert done.returncode == 0, done.stderr
    commission = json.loads((out / "commission.json").read_text())
    assert commission["wanted"] == {"kind": "words", "value": "a cat"}
    assert (commission["strokes"], commission["replan_every"], commission["seed"]) == (4, 2, 5)
    assert load_state(out).executed <= 4
    goal, canvas = (read_image(out / name).astype(float) for name in ("goal.png", "canvas.png"))
    middle = slice(8, 40)  # the centred square of 48 x 32 pixels; these networks ask for a darker upper half
    assert goal[:14, middle].mean() < goal[18:, middle].mean() - 60
    assert canvas[:16].mean() < canvas[16:].mean()


@pytest.fixture(scope="module")
def with_hands(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A bundle with two hands, whose goal planner was taught two nouns."""
    return write_painting_bundle(tmp_path_factory.mktemp("hands"), small_vocabulary(), hands=("anna", "bert"))


def test_run_draws_in_a_hand_without_torch_and_keeps_it_when_resumed(
    with_hands: Path, picture: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    done = _in_process("run", with_hands, "--goal-image", picture, "--hand", "anna", "--out", out, "--strokes", "8")
    assert done.returncode == 0, done.stderr
    assert load_state(out).executed > 0 and load_state(out).hand == "anna"
    canvas, goal = (read_image(out / name).astype(float) for name in ("canvas.png", "goal.png"))
    assert canvas[goal < 120].mean() < canvas[goal > 200].mean() - 40  # the ink is where it should be
    rows = read_table(out / "record", CONTRACT).table.to_pylist()
    assert {len(row["path"]) for row in rows} == {HAND_POINTS}
    bends = [_bend(np.array(row["path"])[:, 1:3]) for row in rows]
    assert np.ptp(bends) > 0.01  # shapes differ as the hand's do
    resumed = _in_process("run", "--resume", out, "--goal-text", "a dog")
    assert resumed.returncode == 0, resumed.stderr
    state = load_state(out)
    assert state.hand == "anna" and state.executed > len(rows)
    rows = read_table(out / "record", CONTRACT).table.to_pylist()
    assert {len(row["path"]) for row in rows} == {HAND_POINTS}


def test_hand_chosen_on_the_page_draws_from_the_next_wish_on(with_hands: Path, tmp_path: Path) -> None:
    out, quiet = tmp_path / "out", Progress(io.StringIO())
    commission = commission_of(with_hands, Wanted("words", "a cat"), tell=print, strokes=4, seed=5)

    def paint(wish: str, page: Callable[[str], None] | None = None) -> PaintingState:
        return run(
            commission, out, resume=bool(wish), calibration=tmp_path, ask=print, page=page, control=Control(),
            progress=quiet, wish=wish,
        )  # fmt: skip

    before = paint("")
    assert before.hand is None and before.executed > 0

    def choose(address: str) -> None:
        urllib.request.urlopen(f"{address}hand", data=b"bert", timeout=5)

    assert paint("a dog", choose).hand == "bert"
    rows = read_table(out / "record", CONTRACT).table.to_pylist()
    points = [len(row["path"]) for row in rows]
    assert set(points[: before.executed]) == {PLANNER.path_points} and set(points[before.executed :]) == {HAND_POINTS}
    assert paint("a cat").hand == "bert"


def _bend(path: np.ndarray) -> float:
    """Distance of the middle of a path from the line between its ends, as a share of its length."""
    (x, y), middle = path[-1] - path[0], path[len(path) // 2] - path[0]
    return float((x * middle[1] - y * middle[0]) / (x * x + y * y))


@pytest.mark.parametrize(
    ("name", "message"), [("carl", "no hand 'carl'; it has anna, bert."), ("", "no hand ''; it has anna, bert.")]
)
def test_run_lists_the_hands_where_one_is_unknown(
    with_hands: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str, message: str
) -> None:
    out = tmp_path / "out"
    assert main(["run", str(with_hands), "--goal-text", "a cat", "--hand", name, "--out", str(out)]) == 1
    assert message in capsys.readouterr().err and not out.exists()


def test_run_in_a_hand_needs_a_bundle_with_hands(
    bundle: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert main(["run", str(bundle), "--goal-text", "a cat", "--hand", "anna", "--out", str(out)]) == 1
    assert "has no hands" in capsys.readouterr().err and not out.exists()


@pytest.fixture(scope="module")
def taught(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A bundle whose goal planner was taught two nouns."""
    return write_painting_bundle(tmp_path_factory.mktemp("taught"), small_vocabulary())


def test_run_tells_what_it_draws_before_it_paints(taught: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    done = _in_process(
        "run", taught, "--goal-text", "a small poodle over two cats", "--out", out, "--strokes", "2", "--seed", "5"
    )
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert lines[:2] == ["a poodle: drawn as a dog", "not understood and left out: small"]
    commission = json.loads((out / "commission.json").read_text())
    assert commission["wanted"]["value"] == "a small poodle over two cats"  # the person's own words


def test_goal_planner_reads_taught_words_and_the_medium(
    taught: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    read: list[str] = []

    def goal(wishes: list[Wish], canvas: np.ndarray, *_: object, **__: object) -> np.ndarray:
        read.extend(wish.words for wish in wishes)
        return canvas

    monkeypatch.setattr("pentimento.control.run.goal_from_words", goal)
    for text in (["--goal-text", "a poodle, please"], []):
        out = tmp_path / f"out{len(read)}"
        assert main(["run", str(taught), "--robot", "svg", "--out", str(out), *text]) == 0
    assert read == ["a dog, with a marker", ""]  # without words the canvas is completed


def test_finished_painting_goes_on_with_new_words_and_refuses_others(
    taught: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    given = ["run", str(taught), "--goal-text", "a cat", "--out", str(out), "--strokes", "3", "--seed", "5"]
    assert main(given) == 0
    before = load_state(out)
    assert main(["run", "--resume", str(out), "--goal-text", "florb"]) == 1
    assert "florb" in capsys.readouterr().err and load_state(out).executed == before.executed
    assert main(["run", "--resume", str(out), "--goal-text", "a dog"]) == 0
    after = load_state(out)
    assert after.phase == "done" and after.turns == 1
    assert json.loads((out / "turns" / "001.json").read_text())["words"] == "a dog"


def test_studio_lets_the_person_begin_and_ends_when_the_person_stops(
    taught: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out, seen = tmp_path / "out", []

    def person(address: str) -> None:
        def answer() -> None:
            while (state := json.loads(urllib.request.urlopen(f"{address}state.json", timeout=5).read())).get(
                "lines", 0
            ) < 1:
                if state.get("phase") == "your turn" and not seen:
                    seen.append(state["pen"])
                    line = json.dumps({"points": [[0.3, 0.5, 0.5], [0.7, 0.5, 0.5]]}).encode()
                    urllib.request.urlopen(f"{address}draw", data=line, timeout=5)
                time.sleep(0.1)
            urllib.request.urlopen(f"{address}command", data=b"stop", timeout=5)

        threading.Thread(target=answer, daemon=True).start()

    monkeypatch.setattr("pentimento.cli.robot._print_address", person)
    assert main(["studio", str(taught), "--out", str(out), "--seed", "5"]) == 0
    state = load_state(out)
    assert state.phase == "done" and state.executed == 0 and state.lines == 1
    dark = state.canvas.min(-1) < 120
    assert dark.sum() > 5 and np.abs(np.flatnonzero(dark.any(1)).mean() / len(dark) - 0.5) < 0.1
    assert seen[0]["color"] is not None
    assert (out / "painting.svg").read_text().count("<path") == 1 and (out / "painting.gcode").is_file()
    assert main(["replay", str(out)]) == 0
    assert "data:image/jpeg" in (out / "replay.html").read_text()
    assert main(["replay", str(tmp_path)]) == 1


@pytest.mark.parametrize("text", ["florb", "", "  ", "five cats", "a cat\x07", "a" * 2000, "🐈", "🐈\u200d⬛"])
def test_run_refuses_words_that_it_does_not_understand_and_creates_no_folder(
    taught: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str
) -> None:
    out = tmp_path / "out"
    assert main(["run", str(taught), "--goal-text", text, "--out", str(out)]) == 1
    printed = capsys.readouterr()
    assert "Nothing was painted" in printed.err and printed.out == "" and not out.exists()


def test_run_writes_strokes_to_svg_without_recording(
    bundle: Path, picture: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert main(["run", str(bundle), "--robot", "svg", "--goal-image", str(picture), "--out", str(out)]) == 0
    drawn = ElementTree.parse(out / "drawing.svg").getroot()
    (layer,) = drawn  # a pen has one colour
    assert len(layer) == load_state(out).executed > 0
    assert not (out / "record").exists()  # there is no camera
    assert str(out) in capsys.readouterr().out


def test_run_serves_the_page_until_it_ends(bundle: Path, picture: Path, tmp_path: Path) -> None:
    out, control, seen = tmp_path / "out", Control(), []

    def look(address: str) -> None:
        with urllib.request.urlopen(f"{address}state.json", timeout=5) as answer:
            seen.append((address, answer.status))
        control.send("stop")

    commission = commission_of(bundle, Wanted("picture", str(picture)), tell=print, robot="svg")
    state = run(
        commission, out, resume=False, calibration=tmp_path, ask=print, page=look, control=control,
        progress=Progress(io.StringIO()),
    )  # fmt: skip
    assert state.phase == "stopped" and state.executed == 0 and seen[0][1] == 200
    with pytest.raises(urllib.error.URLError):
        urllib.request.urlopen(seen[0][0], timeout=5)


def test_run_refuses_a_used_folder(
    bundle: Path, picture: Path, finished: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["run", str(bundle), "--robot", "svg", "--goal-image", str(picture), "--out", str(finished)]
    assert main(arguments) == 1
    assert capsys.readouterr().err.count("--resume") == 1


def test_run_with_unreadable_picture_creates_no_folder(
    bundle: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "cut.jpg").write_bytes(b"\xff\xd8 and no more")
    for name in ("cut.jpg", "nowhere.jpg"):
        out = tmp_path / "out"
        assert main(["run", str(bundle), "--goal-image", str(tmp_path / name), "--out", str(out)]) == 1
        assert name in capsys.readouterr().err and not out.exists()


def test_run_refuses_a_file_as_folder(
    bundle: Path, picture: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "file"
    file.write_text("mine")
    for out in (file, file / "below"):
        assert main(["run", str(bundle), "--goal-image", str(picture), "--out", str(out)]) == 1
        assert "a file is in its place" in capsys.readouterr().err
    assert main(["run", "--resume", str(file)]) == 1
    assert "no painting" in capsys.readouterr().err and file.read_text() == "mine"


def test_run_with_damaged_state_does_not_suggest_resume(
    finished: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = shutil.copytree(finished, tmp_path / "out")
    (out / "state.npz").write_bytes(b"torn")
    assert main(["run", "--resume", str(out)]) == 1
    message = capsys.readouterr().err
    assert "damaged" in message and "--resume" not in message


def test_run_refuses_a_folder_with_other_files(
    bundle: Path, picture: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "canvas.png").write_bytes(b"mine")
    arguments = ["--robot", "svg", "--goal-image", str(picture), "--out", str(tmp_path)]
    assert main(["run", str(bundle), *arguments]) == 1
    assert "other files" in capsys.readouterr().err
    assert [file.name for file in tmp_path.iterdir()] == ["canvas.png"]


def test_run_with_reached_goal_reports_no_stroke(
    bundle: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_png(tmp_path / "blank.png", np.full((80, 80, 3), 255, np.uint8))
    arguments = ["--robot", "svg", "--goal-image", str(tmp_path / "blank.png"), "--out", str(tmp_path / "out")]
    assert main(["run", str(bundle), *arguments]) == 0
    assert "No stroke was made" in capsys.readouterr().out


def test_run_refuses_a_changed_bundle_before_writing(
    bundle: Path, picture: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    copy = shutil.copytree(bundle, tmp_path / "copy")
    (copy / "card.md").write_text("changed")
    out = tmp_path / "out"
    assert main(["run", str(copy), "--goal-image", str(picture), "--out", str(out)]) == 1
    assert "refused" in capsys.readouterr().err and not out.exists()


def test_run_refuses_to_resume_with_another_bundle(
    finished: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = shutil.copytree(finished, tmp_path / "out")
    commission = json.loads((out / "commission.json").read_text())
    (out / "commission.json").write_text(json.dumps(commission | {"digest": "0" * 64}))
    assert main(["run", "--resume", str(out)]) == 1
    assert "another bundle" in capsys.readouterr().err


def test_run_refuses_uncalibrated_hardware(
    bundle: Path, picture: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rig = tmp_path / "small.toml"
    rig.write_text(small_plotter(canvas_mm=(60, 40)))
    arguments = ["run", str(bundle), "--robot", str(rig), "--goal-image", str(picture), "--out", str(tmp_path / "out")]
    assert main([*arguments, "--execute", "--calibration", str(tmp_path / "none")]) == 1
    assert "calibrat" in capsys.readouterr().err


@pytest.mark.parametrize("execute", [[], ["--execute"]])
@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ('"grbl"', '"grlb"', "The rig small names the driver 'grlb', and installed are ["),
        ("[machine]", '[limits]\nx_min = "90 mm"\n[machine]', "workspace is empty"),
    ],
)
def test_run_refuses_a_bad_rig_file_and_leaves_nothing(
    bundle: Path, picture: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], execute: list[str], old: str,
    new: str, sentence: str,
) -> None:  # fmt: skip
    rig, out = tmp_path / "small.toml", tmp_path / "out"
    rig.write_text(small_plotter(canvas_mm=(60, 40)).replace(old, new))
    arguments = ["run", str(bundle), "--robot", str(rig), "--goal-image", str(picture), "--out", str(out), *execute]
    assert main(arguments) == 1
    assert sentence in capsys.readouterr().err and not out.exists()


def test_rehearsal_without_a_camera_makes_the_plan_of_the_execution(bundle: Path, tmp_path: Path) -> None:
    grbl = SimulatedGrbl(hurry=300)
    rig = tmp_path / "small.toml"
    rig.write_text(small_plotter(grbl.port, (60, 40)))
    touch = Calibration("touch", load_rig(rig).digest, time.time(), "a test", 0.0, {"surface": [0.0, 0.0, 0.0]})
    write_calibration(tmp_path / "calibration", touch)
    commission = commission_of(bundle, Wanted("words", "a cat"), tell=print, robot=str(rig), strokes=3, seed=5)
    try:
        for out, execute in (("rehearsed", False), ("executed", True)):
            run(
                replace(commission, execute=execute), tmp_path / out, resume=False,
                calibration=tmp_path / "calibration", ask=lambda _: None, page=None, control=Control(),
                progress=Progress(io.StringIO()),
            )  # fmt: skip
    finally:
        grbl.close()
    for name in ("goal.png", "plan.png"):
        assert (tmp_path / "rehearsed" / name).read_bytes() == (tmp_path / "executed" / name).read_bytes()


def test_run_on_a_larger_sheet_paints_its_lower_left_part(bundle: Path, picture: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"  # rehearsed on a sheet of 300 x 200 mm, with a camera
    assert main(["run", str(bundle), "--robot", "xarm", "--goal-image", str(picture), "--out", str(out)]) == 0
    rows = read_table(out / "record", CONTRACT).table.to_pylist()
    places = np.concatenate([np.array(row["path"])[:, 1:3] for row in rows])
    assert np.all(places >= 0) and np.all(places <= CANVAS_M)


def test_run_applies_the_rigs_limits(
    bundle: Path, picture: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rig = tmp_path / "small.toml"
    rig.write_text(small_plotter(canvas_mm=(60, 40)) + '[limits]\nmax_speed = "1 mm/s"\n')
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
        ["b", "--out", "o", "--goal-text", "\udcff"],  # a byte that is not UTF-8, as Python passes it
        ["--resume", "o", "--strokes", "3"],
        ["--resume", "o", "--execute"],
        ["--resume", "o", "--robot", "virtual"],
        ["--resume", "o", "--hand", "anna"],
    ],
)
def test_run_rejects_invalid_arguments(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["run", *arguments])
    assert "usage" in capsys.readouterr().err
