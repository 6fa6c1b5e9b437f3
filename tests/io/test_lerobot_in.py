"""Tests of the import of LeRobot datasets."""

import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pentimento.cli.main import main
from pentimento.contracts.errors import ConfigError, ContractError, PentimentoError
from pentimento.contracts.images import decode_png, encode_png
from pentimento.contracts.strokes import CONTRACT, example_table
from pentimento.contracts.tables import read_table, write_table
from pentimento.io.lerobot_episodes import Span, video_pairs
from pentimento.io.lerobot_folder import names_of, open_dataset
from pentimento.io.lerobot_in import Description, import_lerobot
from pentimento.io.lerobot_out import export_lerobot
from pentimento.io.stroke_rows import Placement, Refused
from tests.io.photographed import sheet
from tests.io.published import (
    CAMERA,
    FPS,
    LENGTHS,
    NAMES,
    SCALE,
    action,
    change_column,
    change_info,
    corner,
    film,
    publish,
)
from tests.io.test_photo_pairs import ink_centre_m

DESCRIPTION = Description(Placement.parsed(None, SCALE, False), "quill", 1.0, None, None)
DATA = "data/chunk-000/file-000.parquet"
EPISODES = "meta/episodes/chunk-000/file-000.parquet"
VIDEO = f"videos/{CAMERA}/chunk-000/file-000.mp4"


def rows_of(folder: Path, out: Path, description: Description = DESCRIPTION) -> list[dict[str, Any]]:
    imported = import_lerobot(folder, description, out)
    rows: list[dict[str, Any]] = read_table(out, CONTRACT).table.to_pylist()
    assert imported.rows == len(rows)
    return rows


@pytest.mark.parametrize("video", [False, True], ids=["images", "video"])
def test_episode_becomes_a_stroke(video: bool, tmp_path: Path) -> None:
    rows = rows_of(publish(tmp_path / "lines", video), tmp_path / "out")
    assert [row["order"] for row in rows] == [row["action_id"] for row in rows] == [0, 1, 2]
    for number, row in enumerate(rows):
        assert row["tool"] == "quill" and row["session"] == "lines"
        expected = [[frame / FPS, *action(number, frame)[1:]] for frame in range(LENGTHS[number])]
        np.testing.assert_allclose(row["path"], expected, atol=1e-6)
        np.testing.assert_allclose(ink_centre_m(row), np.array(row["path"])[:, 1:3].mean(0), atol=4e-4)
        before, after = (decode_png(row[when]["bytes"]).astype(float) for when in ("before", "after"))
        x_min, _, x_max, _ = row["window_m"]
        assert before.shape[1] / (x_max - x_min) == pytest.approx(5000, rel=1e-3)
        assert before.min() > 225 and (after < 60).mean() > 0.01


def test_uses_exactly_the_first_and_last_frames_of_a_video(tmp_path: Path) -> None:
    film(tmp_path / "film.mp4", range(3))
    first = np.cumsum([0, *LENGTHS])
    spans = [Span(first[k] / FPS, (first[k + 1] - 1) / FPS, LENGTHS[k]) for k in range(3)]
    found = list(video_pairs(tmp_path / "film.mp4", list(sheet().shape), FPS, spans))
    for number, pair in enumerate(found):
        assert not isinstance(pair, Refused)
        reds = [picture[5:35, 5:35, 0].mean() for picture in pair]
        np.testing.assert_allclose(reds, [corner(number, 0), corner(number, LENGTHS[number] - 1)], atol=4)


def test_times_start_again_in_each_video_file(tmp_path: Path) -> None:
    """A recorder begins a new file when one is full."""
    whole = rows_of(publish(tmp_path / "lines", video=True), tmp_path / "whole")
    film(tmp_path / "lines" / VIDEO, [0])
    film(tmp_path / "lines" / VIDEO.replace("file-000", "file-001"), [1, 2])
    episodes = tmp_path / "lines" / EPISODES
    change_column(episodes, f"videos/{CAMERA}/file_index", pa.array([0, 1, 1]))
    change_column(episodes, f"videos/{CAMERA}/from_timestamp", pa.array([0.0, 0.0, LENGTHS[1] / FPS]))
    for row, wanted in zip(rows_of(tmp_path / "lines", tmp_path / "split"), whole, strict=True):
        assert row["path"] == wanted["path"]
        np.testing.assert_allclose(ink_centre_m(row), ink_centre_m(wanted), atol=2e-4)


@pytest.mark.parametrize("plays", [FPS / 4, FPS / 2, FPS * 0.93, FPS * 1.07, 2 * FPS])
def test_a_video_of_another_rate_than_the_table_gives_no_pictures(tmp_path: Path, plays: float) -> None:
    folder = publish(tmp_path / "lines", video=True)
    film(folder / VIDEO, range(3), fps=plays)
    with pytest.raises(ContractError, match=r"fps is not the video's|no picture at its first or last frame"):
        import_lerobot(folder, DESCRIPTION, tmp_path / "out")


def test_pictures_are_found_by_the_times_in_the_table(tmp_path: Path) -> None:
    """Frames that were dropped at the start of a recording, and an episode that begins one picture early."""
    folder = publish(tmp_path / "lines", video=True)
    first = np.cumsum([0, *LENGTHS])[:-1] / FPS
    change_column(folder / EPISODES, f"videos/{CAMERA}/from_timestamp", pa.array(first - [0, 1 / FPS, 0]))
    imported = import_lerobot(folder, DESCRIPTION, tmp_path / "out")
    assert imported[:2] == (2, {"its first picture in the video is one of another episode": ["1"]})
    late = 4 / FPS
    data_column("timestamp", lambda v: [value + late for value in v])(folder)
    change_column(folder / EPISODES, f"videos/{CAMERA}/from_timestamp", pa.array(first - late))
    assert import_lerobot(folder, DESCRIPTION, tmp_path / "late").rows == 3


def test_reads_pictures_across_row_groups(tmp_path: Path) -> None:
    """The camera sees all of the sheet: the mark in its corner says which picture a row has."""
    wide = DESCRIPTION._replace(placement=Placement.parsed("-50 mm, -50 mm, 70 mm, 30 mm", None, False))
    folder = publish(tmp_path / "lines")
    data = pq.read_table(folder / DATA)
    beside = [[0.0, -0.045 + 0.0001 * k, 0.025, -0.001, 0.0] for k in range(data.num_rows)]
    change_column(folder / DATA, "action", pa.array(beside, pa.list_(pa.float32())))
    for number, row in enumerate(rows_of(folder, tmp_path / "out", wide)):
        reds = [decode_png(row[when]["bytes"])[3, 3, 0] for when in ("before", "after")]
        assert reds == [corner(number, 0), corner(number, LENGTHS[number] - 1)]


def test_units_y_down_and_value_indices_give_equal_strokes(tmp_path: Path) -> None:
    folder = publish(tmp_path / "lines")
    plain = rows_of(folder, tmp_path / "plain")
    values = np.array(pq.read_table(folder / DATA)["action"].to_pylist())
    turned = values.copy()
    turned[:, 1:4] *= 1000
    turned[:, 2] = 80 - turned[:, 2]
    turned[:, 4] *= -1
    change_column(folder / DATA, "action", pa.array(turned.tolist(), pa.list_(pa.float64(), 5)))
    down = Description(Placement.parsed(None, SCALE, True), "quill", 0.001, "1,y, z,4", CAMERA)
    for row, same in zip(plain, rows_of(folder, tmp_path / "turned", down), strict=True):
        np.testing.assert_allclose(row["path"], same["path"], atol=2e-6)
        assert row["before"] == same["before"] and row["after"] == same["after"]
    for row in rows_of(folder, tmp_path / "without", down._replace(action="x,y,z")):
        assert {point[4] for point in row["path"]} == {0.0}


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        (["a", "b"], ["a", "b"]),
        ({"motors": ["a", "b"]}, ["a", "b"]),
        ({"arm": ["a"], "hand": ["b"]}, ["a", "b"]),
        ({"b": 1, "a": 0}, ["a", "b"]),
        ({"b": 7, "a": 0}, None),
        (["a"], None),
        (["a", 2], None),
        (None, None),
        ("ab", None),
    ],
)
def test_parses_every_form_of_value_names(names: Any, expected: list[str] | None) -> None:
    assert names_of({"shape": [2], "names": names}) == expected


def cut_off(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def data_column(name: str, change: Callable[[list[Any]], list[Any]]) -> Callable[[Path], None]:
    """Changes a column of the frames; 12 of them are the first episode's."""

    def changed(folder: Path) -> None:
        column = pq.read_table(folder / DATA)[name]
        change_column(folder / DATA, name, pa.array(change(column.to_pylist()), column.type))

    return changed


def first_picture(value: Any) -> Callable[[Path], None]:
    return data_column(CAMERA, lambda pictures: [value, *pictures[1:]])


def later_frame(values: list[Any], value: Any, at: int = 5) -> list[Any]:
    return [*values[:at], value, *values[at + 1 :]]


@pytest.mark.parametrize(
    ("harm", "reason"),
    [
        (data_column("action", lambda v: later_frame(v, [0, float("nan"), 0, 0, 0])), "NaN or infinite"),
        (data_column("action", lambda v: later_frame(v, [0, 0, 0, float("inf"), 0])), "NaN or infinite"),
        (data_column("action", lambda v: later_frame(v, [0, 0.5, 0.01, 0, 0])), "leaves the photograph"),
        (data_column("timestamp", lambda v: later_frame(v, 0.0)), "times run backwards"),
        (data_column("timestamp", lambda v: later_frame(v, None)), "times at some points only"),
        (data_column("frame_index", lambda v: later_frame(v, 4)), "not numbered one after the other"),
        (data_column("episode_index", lambda v: later_frame(v, 7, at=11)), "another number of frames"),
        (first_picture({"bytes": b"\x89PNG torn", "path": None}), "a picture is unreadable"),
        (first_picture({"bytes": None, "path": "frame.png"}), "not embedded"),
        (first_picture(None), "not embedded"),
        (first_picture({"bytes": encode_png(np.zeros((8, 8, 3), np.uint8)), "path": None}), "another shape"),
        (
            lambda folder: change_column(folder / EPISODES, "data/file_index", pa.array([7, 0, 0])),
            "'data/chunk-000/file-007.parquet' is missing",
        ),
        (lambda folder: change_column(folder / EPISODES, "length", pa.array([11, 7, 9])), "another number of frames"),
    ],
)
def test_counts_unusable_episode_and_imports_the_others(
    harm: Callable[[Path], None], reason: str, tmp_path: Path
) -> None:
    folder = publish(tmp_path / "lines")
    harm(folder)
    imported = import_lerobot(folder, DESCRIPTION, tmp_path / "out")
    assert imported.rows == 2
    ((said, names),) = imported.refused.items()
    assert reason in said and names == ["0"] and said in (tmp_path / "out/README.md").read_text()
    assert [row["order"] for row in read_table(tmp_path / "out", CONTRACT).table.to_pylist()] == [1, 2]


def test_video_that_ends_early_loses_only_missing_episodes(tmp_path: Path) -> None:
    folder = publish(tmp_path / "lines", video=True)
    film(folder / VIDEO, range(2), without_last=3)
    imported = import_lerobot(folder, DESCRIPTION, tmp_path / "out")
    assert imported.rows == 1
    assert imported.refused == {"its video has no picture at its first or last frame": ["1", "2"]}


def column(name: str, values: pa.Array) -> Callable[[Path], None]:
    return lambda folder: change_column(folder / EPISODES, name, values)


def info(**values: Any) -> Callable[[Path], None]:
    return lambda folder: change_info(folder, **values)


def feature(name: str, **values: Any) -> Callable[[Path], None]:
    def changed(folder: Path) -> None:
        features = json.loads((folder / "meta/info.json").read_text())["features"]
        change_info(folder, features=features | {name: features.get(name, {}) | values})

    return changed


def text(content: str) -> Callable[[Path], None]:
    return lambda folder: (folder / "meta/info.json").write_text(content) and None


@pytest.mark.parametrize(
    ("harm", "says"),
    [
        (text("{"), "not readable as JSON"),
        (text("[" * 10_000), "not readable as JSON"),
        (text("[1]"), "no JSON object"),
        (lambda folder: (folder / "meta/info.json").unlink(), "info.json cannot be opened"),
        (info(codebase_version="v2.1"), "convert_dataset_v21_to_v30"),
        (info(codebase_version="v4.0"), "v3.0 is what can be read"),
        (info(codebase_version=None), "v3.0 is what can be read"),
        (info(fps=0), "fps is 0"),
        (info(fps="30"), "fps is '30'"),
        (info(fps=float("nan")), "fps is nan"),
        (info(features={}), "names no features"),
        (info(features=[1]), "names no features"),
        (info(data_path="../{chunk_index}/{file_index}.parquet"), "leaves the dataset's folder"),
        (info(data_path="/etc/{chunk_index}/{file_index}.parquet"), "leaves the dataset's folder"),
        (info(data_path="{chunk_index.__class__}"), "its fields can be"),
        (info(data_path="{file_index:999999999d}"), "its fields can be"),
        (info(data_path=None), "no path"),
        (feature(CAMERA, shape=[2**40, 2**40, 3]), "which is impossible"),
        (feature(CAMERA, shape=[400, 600]), "which is impossible"),
        (feature(CAMERA, shape="wide"), "which is none"),
        (feature(CAMERA, dtype=3), "does not say its dtype"),
        (feature("../outside", dtype="video", shape=[4, 4, 3]), "leaves its folder"),
        (feature(CAMERA, shape=[6, 4, 3]), "another shape than its feature"),
        (feature("action", shape=[5, 1]), "no feature 'action' that is a vector"),
        (lambda folder: cut_off(folder / DATA), "cannot be read"),
        (lambda folder: (folder / DATA).write_bytes(b"PAR1"), "cannot be read"),
        (lambda folder: (folder / DATA).unlink(), "is missing"),
        (lambda folder: cut_off(folder / EPISODES), "episodes cannot be read"),
        (lambda folder: (folder / EPISODES).unlink(), "lists the episodes"),
        (column("episode_index", pa.array([0, 1, 1])), "lists an episode twice"),
        (column("episode_index", pa.array([0, 1, None])), "not all whole numbers"),
        (column("data/chunk_index", pa.array([0, -1, 0])), "not all whole numbers"),
        (column("length", pa.array(["a", "b", "c"])), "not all whole numbers"),
        (data_column("episode_index", lambda v: [None] * len(v)), "another number of frames"),
        (lambda folder: change_column(folder / DATA, "action", pa.array([[0.5]] * sum(LENGTHS))), "not of the shape"),
        (lambda folder: change_column(folder / DATA, "action", pa.array(["a"] * sum(LENGTHS))), "not numbers"),
    ],
)
def test_rejects_malformed_dataset(harm: Callable[[Path], None], says: str, tmp_path: Path) -> None:
    folder = publish(tmp_path / "lines")
    harm(folder)
    with pytest.raises(ContractError, match=re.escape(says)) as caught:
        import_lerobot(folder, DESCRIPTION, tmp_path / "out")
    assert str(caught.value).endswith(".") and not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("harm", "says"),
    [
        (lambda folder: (folder / VIDEO).write_bytes(b"#EXTM3U\nframe.png\n"), "is no MP4 video"),
        (lambda folder: (folder / VIDEO).write_bytes(b"\0\0\0\x20ftypisom" + bytes(64)), "encode it again as H.264"),
        (lambda folder: (folder / VIDEO).unlink(), "is missing"),
        (feature(CAMERA, shape=[6, 4, 3]), "another shape than its feature"),
        (column(f"videos/{CAMERA}/from_timestamp", pa.array([float("nan"), -1.0, 1e9])), "no picture at its first"),
        (column(f"videos/{CAMERA}/from_timestamp", pa.array(["a", "b", "c"])), "not numbers"),
        (info(video_path="../{video_key}.mp4"), "leaves the dataset's folder"),
        (info(video_path=None), "video_path is None"),
    ],
)
def test_rejects_unreadable_video(harm: Callable[[Path], None], says: str, tmp_path: Path) -> None:
    folder = publish(tmp_path / "lines", video=True)
    harm(folder)
    with pytest.raises(ContractError, match=re.escape(says)):
        import_lerobot(folder, DESCRIPTION, tmp_path / "out")


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(
    st.lists(
        st.sampled_from(["..", "/", "{chunk_index:03d}", "{file_index}", "{video_key}", "{", "}", "a", ".", "\\", "\0"])
    ).map("".join)
)
def test_rejects_path_outside_the_dataset(tmp_path: Path, template: str) -> None:
    if not (tmp_path / "lines").exists():
        publish(tmp_path / "lines", video=True)
        (tmp_path / "0").write_bytes(b"")
    change_info(tmp_path / "lines", video_path=template)
    try:
        dataset = open_dataset(tmp_path / "lines")
        found = dataset.video_file(CAMERA, 0, 0)
    except PentimentoError:
        return
    assert found.resolve().is_relative_to((tmp_path / "lines").resolve()) and ".." not in found.parts


@pytest.mark.parametrize(
    ("description", "says"),
    [
        (DESCRIPTION._replace(action="x,y"), "three or four values"),
        (DESCRIPTION._replace(action="x,y,press"), "its names are 'gripper', 'x', 'y', 'z', 'yaw'"),
        (DESCRIPTION._replace(action="x,y,9"), "its numbers 0 to 4"),
        (DESCRIPTION._replace(action="x,y,y"), "three or four values"),
        (DESCRIPTION._replace(camera="observation.images.wrist"), f"no feature 'observation.images.wrist'.*'{CAMERA}'"),
        (None, "--tool"),
    ],
)
def test_asks_for_the_missing_description(description: Description | None, says: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=says):
        import_lerobot(publish(tmp_path / "lines"), description, tmp_path / "out")


def test_asks_for_a_camera_and_accepts_value_indices(tmp_path: Path) -> None:
    folder = publish(tmp_path / "lines")
    feature("observation.images.wrist", dtype="video", shape=[4, 4, 3])(folder)
    feature("action", names=None)(folder)
    with pytest.raises(ConfigError, match=f"--camera which shows the canvas: '{CAMERA}', 'observation.images.wrist'"):
        import_lerobot(folder, DESCRIPTION, tmp_path / "out")
    with pytest.raises(ConfigError, match="it has no names, its numbers 0 to 4"):
        import_lerobot(folder, DESCRIPTION._replace(camera=CAMERA), tmp_path / "out")
    assert len(rows_of(folder, tmp_path / "out", DESCRIPTION._replace(camera=CAMERA, action="1,2,3,4"))) == 3


def test_refuses_modified_rows_of_an_exported_dataset(tmp_path: Path) -> None:
    write_table(tmp_path / "rows", example_table(3), CONTRACT, "Strokes.")

    def changed(name: str, values: pa.Array) -> Path:
        shutil.rmtree(tmp_path / "set", ignore_errors=True)  # a changed dataset is not replaced
        export_lerobot(tmp_path / "rows", tmp_path / "set", 30)
        change_column(tmp_path / "set" / EPISODES, name, values)
        return tmp_path / "set"

    imported = import_lerobot(changed("pentimento_picture/width", pa.array([80, 0, 81])), None, tmp_path / "out")
    assert imported[:2] == (1, {"its pictures are smaller than the exported ones": ["1", "2"]})
    with pytest.raises(ContractError, match="column 'path' is string"):
        import_lerobot(changed("pentimento/path", pa.array(["a", "b", "c"])), None, tmp_path / "none")
    with pytest.raises(ContractError, match="tool is null"):
        import_lerobot(changed("pentimento/tool", pa.array(["a", None, "c"])), None, tmp_path / "none")
    with pytest.raises(ContractError, match="not all whole numbers"):
        import_lerobot(changed("pentimento_picture/grey", pa.array(["a", "b", "c"])), None, tmp_path / "none")
    with pytest.raises(ContractError, match="None of the 3 episodes"):
        import_lerobot(changed("pentimento_picture/width", pa.array([0, 0, 0])), None, tmp_path / "none")
    assert not (tmp_path / "none").exists()


def test_command_imports_a_folder_as_a_dataset(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = publish(tmp_path / "lines")
    data_column("action", lambda v: later_frame(v, [0, float("nan"), 0, 0, 0]))(folder)
    given = ["import", str(folder), "--tool", "quill", "--out", str(tmp_path / "out")]
    assert main([*given, "--scale", SCALE, "--units", "m", "--action", ",".join(NAMES[1:])]) == 0
    said = capsys.readouterr().out
    assert "2 strokes are in" in said and "Refused: 1 × a point is NaN or infinite (0)." in said
    for wrong, says in (
        ([], "needs --window or --scale"),
        (["--scale", SCALE, "--units", "deg"], "no unit of length"),
        (["--scale", SCALE, "--photos", str(tmp_path)], "no use for --photos"),
    ):
        assert main([*given, *wrong]) == 1
        assert says in capsys.readouterr().err
    (tmp_path / "paths.csv").write_text("stroke,x_mm,y_mm,z_mm\n")
    csv = ["import", str(tmp_path / "paths.csv"), "--out", str(tmp_path / "out")]
    assert main([*csv, "--scale", SCALE]) == 1 and "needs --photos, --tool" in capsys.readouterr().err
    both = ["--photos", str(tmp_path), "--tool", "quill", "--scale", SCALE]
    assert main([*csv, *both, "--camera", CAMERA]) == 1 and "no use for --camera" in capsys.readouterr().err
    assert main(["import", str(tmp_path / "out"), "--out", str(tmp_path / "other")]) == 1
    assert "info.json cannot be opened" in capsys.readouterr().err
