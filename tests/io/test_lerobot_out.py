"""Tests of the export as a LeRobot dataset, and of its round trip."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pentimento.cli.main import main
from pentimento.contracts.errors import ConfigError, ContractError
from pentimento.contracts.images import decode_png, encode_png
from pentimento.contracts.strokes import CONTRACT, example_table
from pentimento.contracts.tables import read_table, write_table
from pentimento.io import lerobot_out
from pentimento.io.lerobot_in import import_lerobot
from pentimento.io.lerobot_out import export_lerobot, frame_times, resampled
from tests.test_cli import rows_with

FPS = 30


def exported(folder: Path, table: pa.Table, fps: int = FPS) -> Path:
    write_table(folder / "rows", table, CONTRACT, "Strokes.")
    export_lerobot(folder / "rows", folder / "dataset", fps)
    return folder / "dataset"


def there_and_back(folder: Path, table: pa.Table) -> tuple[pa.Table, pa.Table]:
    """The rows as they are read, and after an export and an import."""
    dataset = exported(folder, table)
    imported = import_lerobot(dataset, None, folder / "back")
    assert imported.rows == table.num_rows and not imported.refused
    return read_table(folder / "rows", CONTRACT).table, read_table(folder / "back", CONTRACT).table


def same(one: Any, other: Any) -> bool:
    """Equal, where unknown numbers are equal to each other."""
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(same(one[key], other[key]) for key in one)
    if isinstance(one, list):
        return len(one) == len(other) and all(map(same, one, other))
    return one == other or (one != one and other != other)


def covariates(table: pa.Table) -> pa.Table:
    """The same with columns that the contract does not know, some of whose names others use for themselves."""
    count = table.num_rows
    table = table.append_column("humidity", pa.array(np.linspace(0.3, 0.5, count), pa.float32()))
    table = table.append_column("height", pa.array(range(count), pa.int16()))
    return table.append_column("length", pa.array([None] + [0.25] * (count - 1)))


def test_export_and_import_return_equal_rows(tmp_path: Path) -> None:
    before, after = there_and_back(tmp_path, covariates(example_table(7)))
    assert before.schema.equals(after.schema, check_metadata=True)
    assert all(map(same, before.to_pylist(), after.to_pylist()))


def test_pads_windows_with_paper_and_crops_them_on_import(tmp_path: Path) -> None:
    rows = example_table(3).to_pylist()
    picture = decode_png(rows[1]["after"]["bytes"])
    for when in ("before", "after"):
        rows[1][when]["bytes"] = encode_png(decode_png(rows[1][when]["bytes"])[10:, :60])
        rows[2][when]["bytes"] = encode_png(decode_png(rows[2][when]["bytes"])[..., 0])
    x, y, _, _ = rows[1]["window_m"]
    rows[1]["window_m"] = [x, y, x + 0.060, y + 0.046]
    rows[2]["encoding"] = "ink"
    before, after = there_and_back(tmp_path, pa.Table.from_pylist(rows, schema=example_table(1).schema))
    assert all(map(same, before.to_pylist(), after.to_pylist()))
    assert decode_png(after["after"][2].as_py()["bytes"]).ndim == 2
    shown = pq.read_table(next((tmp_path / "dataset/data").rglob("*.parquet")))
    last = [decode_png(value["bytes"]) for value in shown["observation.images.canvas"].to_pylist()]
    assert {one.shape for one in last} == {picture.shape}
    episode = np.array(shown["episode_index"])
    padded = last[np.flatnonzero(episode == 1)[-1]]
    np.testing.assert_array_equal(padded[:46, :60], picture[10:, :60])
    paper = np.median(picture[10:, :60].reshape(-1, 3), axis=0)
    assert (np.abs(padded[46:] - paper) < 3).all() and len(np.unique(padded[46:].reshape(-1, 3), axis=0)) == 1


def test_round_trip_keeps_untimed_paths_points_and_missing_values(tmp_path: Path) -> None:
    rows = example_table(4).to_pylist()
    for point in rows[0]["path"]:
        point[0] = math.nan
    rows[1]["path"] = rows[1]["path"][:1]
    rows[2]["measured_path"] = None
    before, after = there_and_back(tmp_path, pa.Table.from_pylist(rows, schema=example_table(1).schema))
    assert all(map(same, before.to_pylist(), after.to_pylist()))
    data = pq.read_table(next((tmp_path / "dataset/data").rglob("*.parquet")))
    episode = np.array(data["episode_index"])
    action, state = (np.array(data[name].to_pylist()) for name in ("action", "observation.state"))
    np.testing.assert_array_equal(action[episode == 0], np.array(before["path"][0].as_py())[:, 1:])
    assert (episode == 1).sum() == 2
    np.testing.assert_array_equal(state[episode == 2], action[episode == 2])
    assert np.abs(state[episode == 3] - action[episode == 3]).max() > 1e-6


def test_exported_dataset_follows_the_format(tmp_path: Path) -> None:
    rows = exported(tmp_path, example_table(9)).parent / "rows"
    folder = tmp_path / "dataset"
    info = json.loads((folder / "meta/info.json").read_text())
    episodes = pq.read_table(folder / "meta/episodes/chunk-000/file-000.parquet").to_pylist()
    tables = [pq.read_table(file) for file in sorted((folder / "data").glob("*/*.parquet"))]
    data = pa.concat_tables(tables)
    assert info["codebase_version"] == "v3.0" and info["fps"] == FPS and info["splits"] == {"train": "0:9"}
    assert (info["total_episodes"], info["total_frames"]) == (len(episodes), data.num_rows) == (9, data.num_rows)
    assert set(info["features"]) == set(data.column_names)
    np.testing.assert_array_equal(data["index"], np.arange(data.num_rows))
    assert [e["dataset_from_index"] for e in episodes] == [0] + [e["dataset_to_index"] for e in episodes[:-1]]
    paths = [np.array(path) for path in read_table(rows, CONTRACT).table["path"].to_pylist()]
    for number, episode in enumerate(episodes):
        part = data.slice(episode["dataset_from_index"], episode["length"])
        assert episode["episode_index"] == number and episode["tasks"] == ["Paint one stroke with the round_brush."]
        assert episode["dataset_to_index"] - episode["dataset_from_index"] == episode["length"]
        assert set(part["episode_index"].to_pylist()) == {number}
        np.testing.assert_array_equal(part["frame_index"], np.arange(part.num_rows))
        np.testing.assert_allclose(part["timestamp"], np.arange(part.num_rows) / FPS, atol=1e-5)
        file = info["data_path"].format(chunk_index=episode["data/chunk_index"], file_index=episode["data/file_index"])
        assert number in pq.read_table(folder / file, columns=["episode_index"])["episode_index"].to_pylist()
        action = np.array(part["action"].to_pylist())
        np.testing.assert_array_equal(action[[0, -1]], paths[number][[0, -1], 1:])
        assert paths[number][-1, 0] - 1e-4 <= (part.num_rows - 1) / FPS < paths[number][-1, 0] + 1 / FPS
        pictures = [value["bytes"] for value in part["observation.images.canvas"].to_pylist()]
        assert len(set(pictures)) == 2 and len(set(pictures[:-1])) == 1
    for name, feature in info["features"].items():
        kind = data.schema.field(name).type
        if feature["dtype"] == "image":
            first = data[name][0].as_py()
            assert list(decode_png(first["bytes"]).shape) == feature["shape"]
        elif feature["shape"] == [1]:
            assert kind == getattr(pa, feature["dtype"])()
        else:
            assert kind == pa.list_(pa.float32(), feature["shape"][0]) and len(feature["names"]) == kind.list_size
    tasks = pd.read_parquet(folder / "meta/tasks.parquet")
    assert tasks.index.tolist() == ["Paint one stroke with the round_brush."] and tasks["task_index"].tolist() == [0]
    assert info["total_tasks"] == len(tasks)


def test_statistics_cover_all_frames(tmp_path: Path) -> None:
    folder = exported(tmp_path, example_table(4))
    description = json.loads((folder / "meta/stats.json").read_text())
    data = pq.read_table(folder / "data/chunk-000/file-000.parquet")
    for name in data.column_names:
        values = data[name].to_pylist()
        if name == "observation.images.canvas":
            frames = np.stack([decode_png(value["bytes"]) for value in values]) / 255
            pixels = frames.reshape(-1, 3)
        else:
            pixels = np.array(values, dtype=np.float64).reshape(len(values), -1)
        for statistic, expected in (
            ("min", pixels.min(0)), ("max", pixels.max(0)), ("mean", pixels.mean(0)), ("std", pixels.std(0))
        ):  # fmt: skip
            np.testing.assert_allclose(np.ravel(description[name][statistic]), expected, rtol=1e-6, atol=1e-9)
        assert description[name]["count"] == [data.num_rows]
    assert np.shape(description["observation.images.canvas"]["mean"]) == (3, 1, 1)
    episode = pq.read_table(folder / "meta/episodes/chunk-000/file-000.parquet").to_pylist()[1]
    own = np.array(data["action"].to_pylist())[np.array(data["episode_index"]) == 1]
    np.testing.assert_allclose(episode["stats/action/std"], own.std(0), rtol=1e-6, atol=1e-9)


def test_shared_picture_is_stored_once(tmp_path: Path) -> None:
    """A picture of a megabyte and more, as photographs are."""
    noise = np.random.default_rng(0).integers(0, 256, (640, 640, 3)).astype(np.uint8)
    pictures = {when: {"bytes": encode_png(noise), "path": None} for when in ("before", "after")}
    folder = exported(tmp_path, rows_with(example_table(1), **pictures, window_m=[0.0, 0.0, 0.08, 0.08]), fps=60)
    (file,) = (folder / "data").rglob("*.parquet")
    assert file.stat().st_size < 1.5 * sum(path.stat().st_size for path in (tmp_path / "rows").glob("*.parquet"))


def test_large_table_is_split_into_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    table = example_table(6)
    monkeypatch.setattr(lerobot_out, "_FILE_BYTES", 30_000)
    monkeypatch.setattr(lerobot_out, "_FILES_A_CHUNK", 2)
    before, after = there_and_back(tmp_path / "many", table)
    files = sorted(
        str(path.relative_to(tmp_path / "many/dataset/data")) for path in tmp_path.glob("many/dataset/data/*/*")
    )
    assert files[:3] == ["chunk-000/file-000.parquet", "chunk-000/file-001.parquet", "chunk-001/file-000.parquet"]
    assert all(map(same, before.to_pylist(), after.to_pylist()))


@given(st.lists(st.integers(1, 400), min_size=1, max_size=12), st.integers(1, 120), st.integers(0, 9))
def test_frames_sample_the_whole_path(steps: list[int], fps: int, start: int) -> None:
    times = start + np.cumsum([0, *steps]) / 1000
    points = np.random.default_rng(steps).normal(size=(len(times), 4))
    path = np.float32(np.column_stack([times, points])).astype(np.float64)
    at = frame_times(path, fps)
    frames = resampled(path, at)
    assert len(at) >= 2
    np.testing.assert_allclose(at, at[0] + np.arange(len(at)) / fps, atol=2e-3 / fps)
    assert at[-1] >= path[-1, 0] and (len(at) == 2 or at[-2] < path[-1, 0])
    np.testing.assert_array_equal(frames[[0, -1], :3], path[[0, -1], 1:4])
    turned = frames[-1, 3] - path[-1, 4]
    assert abs(turned / (2 * math.pi) - round(turned / (2 * math.pi))) < 1e-9
    before = np.clip(np.searchsorted(path[:, 0], at, side="right") - 1, 0, len(path) - 2)
    share = np.clip((at - path[before, 0]) / (path[before + 1, 0] - path[before, 0]), 0, 1)[:, None]
    np.testing.assert_allclose(
        frames[:, :3], (1 - share) * path[before, 1:4] + share * path[before + 1, 1:4], atol=1e-9
    )


def test_rounding_adds_no_frame_at_the_end() -> None:
    path = np.array([[0.0, 0, 0, 0, 0], [0.10003, 1, 1, 1, 1]])
    np.testing.assert_array_equal(resampled(path, frame_times(path, 10)), [[0, 0, 0, 0], [1, 1, 1, 1]])


def test_yaw_is_unwrapped_between_points() -> None:
    path = np.array([[0.0, 0, 0, 0, 3.1], [1.0, 0, 0, 0, -3.1]])
    yaw = resampled(path, frame_times(path, 20))[:, 3]
    assert (np.abs(np.diff(yaw)) < 0.01).all() and yaw[-1] == pytest.approx(2 * math.pi - 3.1)


@pytest.mark.parametrize(
    ("change", "fps", "error", "says"),
    [
        ({}, 0, ConfigError, "frames a second"),
        ({"path": [[0.0, 0.1, 0.1, 0.0, 0.0], [1e6, 0.1, 0.1, 0.0, 0.0]]}, 30, ContractError, "times in seconds"),
        (
            {when: {"bytes": encode_png(np.zeros((56, 80), np.uint16)), "path": None} for when in ("before", "after")},
            30, ContractError, "16 bits",
        ),
    ],
)  # fmt: skip
def test_rejects_rows_that_cannot_be_exported(
    change: dict[str, Any], fps: int, error: type[Exception], says: str, tmp_path: Path
) -> None:
    table = rows_with(example_table(2), **change)
    with pytest.raises(error, match=says):
        exported(tmp_path, table, fps)
    assert not (tmp_path / "dataset").exists()


def test_command_exports_and_imports(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_table(tmp_path / "rows", example_table(2), CONTRACT, "Strokes.")
    assert main(["export", str(tmp_path / "rows"), "--lerobot", str(tmp_path / "set"), "--fps", "10"]) == 0
    assert "2 strokes are in" in capsys.readouterr().out
    assert main(["import", str(tmp_path / "set"), "--out", str(tmp_path / "back")]) == 0
    given = ["--tool", "quill", "--scale", "1 px/mm"]
    assert main(["import", str(tmp_path / "set"), *given, "--out", str(tmp_path / "other")]) == 1
    assert "describes them itself" in capsys.readouterr().err
    assert main(["export", str(tmp_path / "nowhere"), "--lerobot", str(tmp_path / "none")]) == 1
    assert not (tmp_path / "none").exists() and not (tmp_path / "other").exists()
