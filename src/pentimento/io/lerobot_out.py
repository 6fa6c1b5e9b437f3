"""`pentimento export`: a table of strokes as a LeRobot v3.0 dataset, one episode a stroke.

The frames of an episode sample the commanded path at a fixed rate. Its pictures show the canvas before the stroke, and
on the last frame the canvas after it. Where windows differ in size, pictures are padded with the colour of the paper at
the right and below. All other columns of a row are kept in `meta/episodes`; other readers ignore unknown columns.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from pentimento.contracts.atomic import check_replaceable, command_folder
from pentimento.contracts.errors import ConfigError, ContractError
from pentimento.contracts.images import decode_png, encode_png
from pentimento.contracts.schema import IMAGE, vector
from pentimento.contracts.strokes import CONTRACT
from pentimento.contracts.tables import Quarantined, read_table
from pentimento.io.lerobot_folder import (
    ACTION,
    CANVAS,
    DATA,
    EPISODES,
    INFO,
    OWN,
    OWN_PICTURE,
    STATISTICS,
    TASKS,
    VERSION,
)

FloatArray = NDArray[np.float64]

_COMMAND: Final = "pentimento export"
_STATE: Final = "observation.state"
_AXES: Final = ["x", "y", "z", "yaw"]
_COUNTS: Final = ("frame_index", "episode_index", "index", "task_index")
_SCHEMA: Final = pa.schema(
    [(CANVAS, IMAGE), (_STATE, vector(4)), (ACTION, vector(4)), ("timestamp", pa.float32())]
    + [(name, pa.int64()) for name in _COUNTS]
)
_FILES_A_CHUNK: Final = 1000
_FILE_BYTES: Final = 100 * 2**20
"""LeRobot's default for both."""
_MAX_FRAMES: Final = 100_000
"""Of a stroke; more means that its times are not in seconds."""
_SAME_FRAME: Final = 1e-3
"""Tolerance as a fraction of a frame: times are float32."""


class Exported(NamedTuple):
    """Counts of an export."""

    episodes: int
    frames: int
    quarantined: tuple[Quarantined, ...]
    """Rows that break the contract and were left out."""


class _Stroke(NamedTuple):
    """A row with its frames."""

    row: dict[str, Any]
    state: FloatArray
    """[F, 4] x_m, y_m, z_m, yaw_rad; likewise the action."""
    action: FloatArray
    file: int
    """Index of its data file."""
    first: int
    """Its first frame's ``index``."""


def export_lerobot(rows: Path, folder: Path, fps: int) -> Exported:
    """Write the dataset ``folder``; on an error nothing is written.

    Args:
        rows: a Parquet file in the strokes contract, or a folder of shards.
        fps: frames a second.

    Raises:
        ContractError: the rows cannot be read, there are none, or one has too many frames at ``fps``.
        ConfigError: ``fps`` is not above 0, or ``folder`` holds what this command did not write.
    """
    if fps < 1:
        raise ConfigError(f"--fps {fps} is not above 0; write frames a second, such as 30.")
    check_replaceable(folder, _COMMAND)
    checked = read_table(rows, CONTRACT)
    table = checked.table
    if table.num_rows == 0:
        raise ContractError(f"{rows} holds no strokes to export.")
    shapes, grey = _shapes(table)
    whole = int(shapes[:, 0].max()), int(shapes[:, 1].max())
    strokes = _strokes(table, fps)
    tasks = list(dict.fromkeys(_task(stroke.row) for stroke in strokes))
    with command_folder(folder, _COMMAND) as out:
        statistics = _write_frames(out, strokes, whole, tasks, fps)
        own = {f"{OWN_PICTURE}{name}": value for name, value in zip(("height", "width"), shapes.T, strict=True)}
        own[f"{OWN_PICTURE}grey"] = grey
        _write_episodes(out, table, strokes, statistics, own)
        _write_tasks(out, tasks)
        total = {name: pooled([each[name] for each in statistics]).as_json() for name in statistics[0]}
        _write_json(out / STATISTICS, total)
        frames = strokes[-1].first + len(strokes[-1].action)
        _write_json(out / INFO, _info(fps, whole, len(strokes), frames, len(tasks)))
    return Exported(len(strokes), frames, checked.quarantined)


def resampled(path: FloatArray, at_s: FloatArray) -> FloatArray:
    """Interpolate a path [N, 5] (t_s, x_m, y_m, z_m, yaw_rad) at times [F] (s); yaw is unwrapped. Returns [F, 4]."""
    columns = [*path[:, 1:4].T, np.unwrap(path[:, 4])]
    return np.stack([np.interp(at_s, path[:, 0], column) for column in columns], axis=1)


def frame_times(path: FloatArray, fps: int) -> FloatArray:
    """Return the times (s) of a path's frames [F], at least two, 1 / fps apart.

    The first frame is at the path's first point, the last one not before its last point.
    """
    start_s, end_s = path[0, 0], path[-1, 0]
    times_s = start_s + np.arange(max(math.ceil((end_s - start_s) * fps - _SAME_FRAME), 1) + 1) / fps
    times_s[-1] = max(times_s[-1], end_s)
    return times_s


def _strokes(table: pa.Table, fps: int) -> list[_Stroke]:
    strokes: list[_Stroke] = []
    first, size = 0, 0
    for number, row in enumerate(_rows(table)):
        state, action = _frames(row, fps, number)
        size += sum(len(row[when]["bytes"]) for when in ("before", "after"))
        # File numbers must be consecutive, however large one stroke is.
        file = min(size // _FILE_BYTES, strokes[-1].file + 1) if strokes else 0
        strokes.append(_Stroke(row, state, action, file, first))
        first += len(action)
    return strokes


def _rows(table: pa.Table) -> Iterator[dict[str, Any]]:
    wanted = [name for name in ("tool", "path", "measured_path", "before", "after") if name in table.column_names]
    for batch in table.select(wanted).to_batches(max_chunksize=64):
        yield from batch.to_pylist()


def _frames(row: dict[str, Any], fps: int, number: int) -> tuple[FloatArray, FloatArray]:
    """Return state and action of each frame. A path without times has one frame for each point."""
    path = np.array(row["path"], dtype=np.float64)
    if np.isnan(path[:, 0]).any():
        action = path[:, 1:] if len(path) > 1 else np.repeat(path[:, 1:], 2, axis=0)
        return action, action
    if (path[-1, 0] - path[0, 0]) * fps > _MAX_FRAMES:
        raise ContractError(
            f"Stroke {number} lasts {path[-1, 0] - path[0, 0]:g} s, which is more than {_MAX_FRAMES} frames at {fps} "
            "a second; are its times in seconds? A smaller --fps makes fewer."
        )
    at_s = frame_times(path, fps)
    action = resampled(path, at_s)
    measured = np.array(row.get("measured_path") or np.zeros((0, 5)), dtype=np.float64)
    return (resampled(measured, at_s) if np.isfinite(measured).all() and len(measured) else action), action


def _shapes(table: pa.Table) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return height and width of each row's pictures [N, 2] in pixels, and whether both are grey [N]."""
    shapes, grey = [], []
    for number, row in enumerate(_rows(table)):
        pictures = [decode_png(row[when]["bytes"]) for when in ("before", "after")]
        if any(picture.dtype != np.uint8 for picture in pictures):
            raise ContractError(f"Stroke {number} has pictures of 16 bits, which no LeRobot image holds; use 8.")
        shapes.append(pictures[0].shape[:2])
        grey.append(int(all(picture.ndim == 2 for picture in pictures)))
    return np.array(shapes, dtype=np.int64), np.array(grey, dtype=np.int64)


def _padded(row: dict[str, Any], whole: tuple[int, int]) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Return before and after [H, W, 3], padded to the dataset's shape with the colour of the row's paper."""
    before, after = (_colour(decode_png(row[when]["bytes"])) for when in ("before", "after"))
    paper = np.median(before.reshape(-1, 3), axis=0).astype(np.uint8)
    padded = np.tile(paper, (2, *whole, 1))
    padded[:, : before.shape[0], : before.shape[1]] = before, after
    return padded[0], padded[1]


def _colour(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return picture if picture.ndim == 3 else np.repeat(picture[..., None], 3, axis=2)


def _write_frames(
    folder: Path, strokes: list[_Stroke], whole: tuple[int, int], tasks: list[str], fps: int
) -> list[dict[str, Statistics]]:
    """Write the data files, one row group for each episode; return the statistics of each episode."""
    statistics = []
    for file, group in groupby(enumerate(strokes), key=lambda numbered: numbered[1].file):
        path = folder / DATA.format(chunk_index=file // _FILES_A_CHUNK, file_index=file % _FILES_A_CHUNK)
        path.parent.mkdir(parents=True, exist_ok=True)
        with pq.ParquetWriter(path, _SCHEMA, compression="zstd") as writer:
            for episode, stroke in group:
                before, after = _padded(stroke.row, whole)
                numbers = _numbers(stroke, episode, tasks.index(_task(stroke.row)), fps)
                frames = len(stroke.action)
                shown = [encode_png(before)] * (frames - 1) + [encode_png(after)]
                pictures = pa.array([{"bytes": png, "path": None} for png in shown], IMAGE)
                writer.write_table(pa.table([pictures, *map(_arrow, numbers.values())], schema=_SCHEMA))
                seen = pooled([of_picture(before, frames - 1), of_picture(after, 1)])
                statistics.append({CANVAS: seen} | {name: of_numbers(values) for name, values in numbers.items()})
    return statistics


def _numbers(stroke: _Stroke, episode: int, task: int, fps: int) -> dict[str, NDArray[Any]]:
    """Return the columns [F, D] of an episode's frames except pictures, in the order of the schema."""
    frame = np.arange(len(stroke.action))
    counts = (frame, np.full_like(frame, episode), stroke.first + frame, np.full_like(frame, task))
    columns = {_STATE: stroke.state.astype(np.float32), ACTION: stroke.action.astype(np.float32)}
    columns["timestamp"] = (frame / fps).astype(np.float32)[:, None]
    return columns | {name: values[:, None] for name, values in zip(_COUNTS, counts, strict=True)}


def _arrow(values: NDArray[Any]) -> pa.Array:
    flat = pa.array(values.ravel())
    return flat if values.shape[1] == 1 else pa.FixedSizeListArray.from_arrays(flat, values.shape[1])


def _task(row: dict[str, Any]) -> str:
    return f"Paint one stroke with the {row['tool']}."


def _write_episodes(
    folder: Path,
    table: pa.Table,
    strokes: list[_Stroke],
    statistics: list[dict[str, Statistics]],
    pictures: dict[str, NDArray[np.int64]],
) -> None:
    first = np.array([stroke.first for stroke in strokes])
    length = np.array([len(stroke.action) for stroke in strokes])
    files = np.array([stroke.file for stroke in strokes])
    columns: dict[str, Any] = {
        "episode_index": np.arange(len(strokes)),
        "tasks": [[_task(stroke.row)] for stroke in strokes],
        "length": length,
        "data/chunk_index": files // _FILES_A_CHUNK,
        "data/file_index": files % _FILES_A_CHUNK,
        "dataset_from_index": first,
        "dataset_to_index": first + length,
        "meta/episodes/chunk_index": np.zeros_like(files),
        "meta/episodes/file_index": np.zeros_like(files),
        **pictures,
    }
    columns |= {f"{OWN}{name}": table[name] for name in table.column_names if name not in ("before", "after")}
    as_json = [{name: each.as_json() for name, each in episode.items()} for episode in statistics]
    for name, values in as_json[0].items():
        columns |= {f"stats/{name}/{value}": [episode[name][value] for episode in as_json] for value in values}
    path = folder / EPISODES.format(chunk_index=0, file_index=0)
    path.parent.mkdir(parents=True)
    pq.write_table(pa.table(columns), path, compression="zstd")


def _write_tasks(folder: Path, tasks: list[str]) -> None:
    """Write the tasks as the index of a data frame; pandas reads that from a note in the Parquet schema."""
    columns = [
        {"name": name, "field_name": name, "pandas_type": kind, "numpy_type": numpy_kind, "metadata": None}
        for name, kind, numpy_kind in (("task_index", "int64", "int64"), ("task", "unicode", "object"))
    ]
    note = {"index_columns": ["task"], "column_indexes": [], "columns": columns, "pandas_version": "2.0.0"}
    schema = pa.schema([("task_index", pa.int64()), ("task", pa.string())], {"pandas": json.dumps(note)})
    pq.write_table(pa.table([list(range(len(tasks))), tasks], schema=schema), folder / TASKS)


def _info(fps: int, whole: tuple[int, int], episodes: int, frames: int, tasks: int) -> dict[str, Any]:
    picture = {"dtype": "image", "shape": [*whole, 3], "names": ["height", "width", "channels"]}
    axes = {"dtype": "float32", "shape": [len(_AXES)], "names": _AXES}
    features: dict[str, dict[str, Any]] = {CANVAS: picture, _STATE: axes, ACTION: axes}
    features["timestamp"] = {"dtype": "float32", "shape": [1], "names": None}
    features |= {name: {"dtype": "int64", "shape": [1], "names": None} for name in _COUNTS}
    return {
        "codebase_version": VERSION,
        "robot_type": None,
        "total_episodes": episodes,
        "total_frames": frames,
        "total_tasks": tasks,
        "chunks_size": _FILES_A_CHUNK,
        "data_files_size_in_mb": _FILE_BYTES // 2**20,
        "video_files_size_in_mb": _FILE_BYTES // 2**20,
        "fps": fps,
        "splits": {"train": f"0:{episodes}"},
        "data_path": DATA,
        "video_path": None,
        "features": features,
    }


def _write_json(path: Path, value: dict[str, Any]) -> None:
    path.write_text(json.dumps(value, indent=4) + "\n", encoding="utf-8")


Array = NDArray[np.float64]


class Statistics(NamedTuple):
    """LeRobot's normalisation statistics of a feature: arrays [D] for numbers, [3, 1, 1] for pictures in [0, 1]."""

    minimum: Array
    maximum: Array
    mean: Array
    variance: Array
    frames: int

    def as_json(self) -> dict[str, Any]:
        """Return them under LeRobot's names, as lists."""
        values = {"min": self.minimum, "max": self.maximum, "mean": self.mean, "std": np.sqrt(self.variance)}
        return {name: value.tolist() for name, value in values.items()} | {"count": [self.frames]}


def of_numbers(values: Array) -> Statistics:
    """Statistics of numbers [N, D], one row for each frame."""
    return Statistics(values.min(0), values.max(0), values.mean(0), values.var(0), len(values))


def of_picture(picture: NDArray[np.uint8], frames: int) -> Statistics:
    """Statistics of a picture [H, W, 3] that `frames` frames show."""
    one = of_numbers(picture.reshape(-1, 3) / 255.0)
    minimum, maximum, mean, variance = (value.reshape(3, 1, 1) for value in one[:4])
    return Statistics(minimum, maximum, mean, variance, frames)


def pooled(parts: Sequence[Statistics]) -> Statistics:
    """Statistics of the frames of all parts together."""
    frames = [part.frames for part in parts]
    mean = np.average([part.mean for part in parts], axis=0, weights=frames)
    return Statistics(
        np.min([part.minimum for part in parts], axis=0),
        np.max([part.maximum for part in parts], axis=0),
        mean,
        np.average([part.variance + (part.mean - mean) ** 2 for part in parts], axis=0, weights=frames),
        sum(frames),
    )
