"""Tests of `pentimento diagnose` and `calibrate` from the command line."""

import json
import shutil
import subprocess
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pentimento.cli import calibrate as calibrate_command
from pentimento.cli.main import main
from pentimento.collection import collect
from pentimento.collection.design import CollectionConfig, Command
from pentimento.contracts.plan import PlannedStroke
from pentimento.contracts.schema import arrow_schema
from pentimento.contracts.strokes import CONTRACT, example_table
from pentimento.contracts.tables import read_table
from pentimento.control.guard import GuardedRobot
from pentimento.control.safety import envelope_for
from pentimento.dynamics.strokes.traj2stroke import Traj2StrokeParameters
from pentimento.robots.motion import timed_path
from pentimento.robots.strokes import stroke_points
from pentimento.robots.tools import load_tool
from pentimento.robots.virtual import VirtualRobot
from pentimento.studio.strokes.studio import Studio
from pentimento.studio.strokes.world import WORLDS, load_world


def rows_with(table: pa.Table, **values: Any) -> pa.Table:
    """The table with the same values in every row."""
    return pa.Table.from_pylist([row | values for row in table.to_pylist()], schema=table.schema)


def run(table: pa.Table, folder: Path, *more: str) -> int:
    pq.write_table(table, folder / "rows.parquet")
    return main(["diagnose", str(folder / "rows.parquet"), "--out", str(folder / "out"), *more])


@pytest.mark.timeout(300)  # three models are fitted to two tables: a minute of one core
def test_diagnose_finds_ink_depletion_in_the_example_strokes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """They grow paler with the length drawn since the last dip, there as in an outside table; a model that lays no
    paint at all is named for comparison.
    """
    outside, base = tmp_path / "outside.parquet", tmp_path / "parameters.json"
    pq.write_table(example_table(40, seed=9), outside)
    base.write_text(json.dumps(asdict(Traj2StrokeParameters((1.0, 1.0), (0.0, 0.0), 1.0, 0.001, 0.3, 0.001))))
    options = ("--kind", "strokes", "--test", str(outside), "--base", str(base))
    assert run(example_table(72), tmp_path, *options) == 0
    verdict = json.loads((tmp_path / "out/verdict.json").read_text())
    assert verdict["schema"] == 2 and verdict["rows"] == 72
    assert [entry["cause"] for entry in verdict["established"]] == ["ink_depletion"]
    assert verdict["mse"]["extended"] < verdict["mse"]["base"] < verdict["mse"]["given"]
    assert (tmp_path / "out/figures/given_strokes.png").is_file()
    assert verdict["established"][0]["parameters"]["density_loss"]["value"] > 0
    assert verdict["gap_closed"]["shifted"] > 0.3
    printed = capsys.readouterr()
    assert verdict["text"] in printed.out and "report.html" in printed.out
    assert printed.err == ""  # no terminal: nothing but the verdict


def test_diagnose_reports_missing_columns_and_still_decides(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Times, ink and wear unknown, nothing repeated, one row torn: no floor, and what cannot be decided."""
    unknown = dict.fromkeys(("ink_since_reload_m", "tool_age_m", "t_start_s", "t_before_s", "t_after_s"), np.nan)
    table = rows_with(example_table(36), since_reload=None, reload_id=None, **unknown)
    rows = table.to_pylist()
    for number, row in enumerate(rows):
        row["action_id"] = number
        row["path"] = [[float("nan"), *point[1:]] for point in row["path"]]
    rows[7]["after"]["bytes"] = rows[7]["after"]["bytes"][:100]
    assert run(pa.Table.from_pylist(rows, schema=table.schema), tmp_path) == 0
    verdict = json.loads((tmp_path / "out/verdict.json").read_text())
    assert verdict["rows"] == 35 and verdict["mse"]["floor"] is None and verdict["gap_closed"]["test"] is None
    for said in ("floor is unknown", "speeds are unknown", "ink_depletion", "row 7"):
        assert said in verdict["text"]
    assert all(np.isnan(pq.read_table(tmp_path / "out/next_actions.parquet")["path"][0].as_py())[:, 0])
    capsys.readouterr()


@pytest.mark.parametrize(
    ("rows", "says"), [(0, "no rows"), (1, "15"), (10, "at least 15")], ids=["none", "one", "too few"]
)
def test_diagnose_rejects_too_few_rows(
    rows: int, says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(example_table(max(rows, 1)).slice(0, rows), tmp_path) == 1
    assert says in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ({"after": {"bytes": b"torn", "path": None}}, "not a readable PNG"),
        ({"window_m": [1.0, 1.0, 1.08, 1.056]}, "lies outside its window"),
        ({"window_m": [0.1, 0.1, 0.05, 0.2]}, "window_m"),
        ({"path": [[0.0, 0.1, float("nan"), 0.0, 0.0]] * 3}, "NaN"),
    ],
    ids=["torn images", "windows at another place", "windows inside out", "paths without places"],
)
def test_diagnose_rejects_malformed_rows(
    values: dict[str, Any], says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(rows_with(example_table(20), **values), tmp_path) == 1
    assert says in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_diagnose_counts_copies_of_one_row_as_one_action(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(pa.concat_tables([example_table(1)] * 40), tmp_path) == 1
    assert "1 different actions" in capsys.readouterr().err


def test_diagnose_rejects_a_base_that_is_no_stroke_model(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "parameters.json").write_text('{"scale": [1, 1]}')
    assert run(example_table(20), tmp_path, "--base", str(tmp_path / "parameters.json")) == 1
    assert "is not a stroke model" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_diagnose_without_the_workshop_says_what_to_install(tmp_path: Path) -> None:
    lean = """
import sys
class WithoutTorch:
    def find_spec(self, name, path=None, target=None):
        if name == "torch":
            raise ModuleNotFoundError("No module named 'torch'", name=name)
sys.meta_path.insert(0, WithoutTorch())
from pentimento.cli.main import main
sys.exit(main(sys.argv[1:]))
"""
    arguments = ["diagnose", str(tmp_path), "--out", str(tmp_path / "out")]
    done = subprocess.run([sys.executable, "-c", lean, *arguments], capture_output=True, text=True, timeout=120)
    assert done.returncode == 1 and not (tmp_path / "out").exists()
    assert len(done.stderr.splitlines()) == 1 and "torch is missing" in done.stderr and "'.[train]'" in done.stderr


def test_diagnose_names_a_missing_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["diagnose", str(tmp_path / "nowhere.parquet"), "--out", str(tmp_path / "out")]) == 1
    assert "nowhere.parquet" in capsys.readouterr().err


INK = (0.1, 0.1, 0.1)


def raster(*_: object) -> list[Command]:
    """Three sheets of rows from left to right with a dip for each row: ink runs out towards the right."""
    rng, commands = np.random.default_rng(5), []
    for number in range(54):
        row, column = divmod(number % 18, 3)
        middle, length = np.array([0.06 + 0.09 * column, 0.03 + 0.028 * row]), rng.uniform(0.02, 0.05)
        points = stroke_points(
            middle, 0.0, length, bend_m=rng.uniform(-0.008, 0.008), press_m=np.full(3, 2e-3), yaw_rad=0.0, points=16
        )
        stroke = PlannedStroke(timed_path(points, 0.06), np.array(INK), dip=column == 0)
        commands.append(Command(number, number // 18, stroke, 1.0))
    return commands


@pytest.mark.timeout(600)
def test_collected_strokes_distinguish_rivals_of_a_raster(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """In a world whose only effect is that the ink runs out, a raster of strokes that are all pressed alike, by a robot
    that does not measure its force, takes it for a tilted canvas as well; where presses differ, they would tell.
    """
    for world in ("plain.toml", "table.toml"):
        shutil.copy(WORLDS / world, tmp_path)
    (tmp_path / "fade.toml").write_text('base = "plain.toml"\n[effects]\nink_depletion = 0.15\n')
    monkeypatch.setattr(collect, "design_collection", raster)
    tool, robot = load_tool("round_brush"), VirtualRobot(Studio(load_world(tmp_path / "fade.toml"), 0))
    config = CollectionConfig(54, 0, 1, 0.0, 16, 0.008, 0.008, 700.0, (1.0, 1.0), (INK,), 0.0, 0)
    guarded = GuardedRobot(robot, envelope_for(tool, robot.canvas_size_m))
    rows = collect.collect_strokes(guarded, tool, config, lambda *_: None)
    table = pa.Table.from_pylist(rows, schema=arrow_schema(CONTRACT, include_optional=set(rows[0])))
    table = table.drop_columns(["force_n", "measured_path"])
    assert run(table, tmp_path, "--collect", "2", "--world", str(tmp_path / "fade.toml")) == 0
    first, _, second = capsys.readouterr().out.partition("Round 1: 16 strokes to separate ")
    assert "Not told apart by this table: ink_depletion from canvas_tilt.\n" in first and second
    verdict = json.loads((tmp_path / "out/verdict.json").read_text())
    assert [(entry["cause"], entry["rivals"]) for entry in verdict["established"]] == [("ink_depletion", [])]
    assert verdict["rows"] == 70 and "16 of the strokes were collected as proposed, in 1 round." in verdict["text"]
    assert read_table(tmp_path / "out/strokes", CONTRACT).table.num_rows == 70


@pytest.mark.parametrize(
    ("rows", "more", "says"),
    [
        ({}, ("--collect", "1", "--world", "marker"), "holds a marker"),
        ({}, ("--collect", "1", "--world", "nowhere"), "no world named"),
        ({"frame": "stroke"}, ("--collect", "1"), "on the canvas is unknown"),
        ({"tool": "quill"}, ("--collect", "1"), "no tool named 'quill'"),
    ],
    ids=["another tool's world", "no world", "no place", "no such tool"],
)
def test_rejects_unusable_robot_before_the_diagnosis(
    rows: dict[str, Any], more: tuple[str, ...], says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(rows_with(example_table(20), **rows), tmp_path, *more) == 1
    assert says in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("more", [("--collect", "-1"), ("--world", "marker")], ids=["fewer than none", "idle world"])
def test_rejects_invalid_rounds(more: tuple[str, ...], tmp_path: Path) -> None:
    with pytest.raises(SystemExit):
        run(example_table(20), tmp_path, *more)


def test_rejects_unknown_kind(tmp_path: Path) -> None:
    with pytest.raises(SystemExit):
        main(["diagnose", str(tmp_path), "--out", str(tmp_path / "out"), "--kind", "sculptures"])


def test_calibrate_writes_prints(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["calibrate", "plotter", "prints", "--calibration", str(tmp_path)]) == 0
    named = [Path(line) for line in capsys.readouterr().out.splitlines()]
    assert sorted(named) == sorted(tmp_path.iterdir()) and len(named) == 10


def test_calibrate_rejects_a_lens_without_a_camera(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["calibrate", "plotter", "lens", "--calibration", str(tmp_path)]) == 1
    assert "camera" in capsys.readouterr().err


def test_calibrate_without_a_person_says_so(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def nobody(*_: object, **__: object) -> None:
        raise EOFError

    monkeypatch.setattr(calibrate_command, "calibrate_rig", nobody)
    assert main(["calibrate", "plotter", "touch"]) == 1
    assert "at a terminal" in capsys.readouterr().err
