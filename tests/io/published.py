"""A foreign LeRobot v3.0 dataset for tests: three strokes of a quill seen by one camera."""

import json
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from pentimento.contracts.images import encode_png
from tests.io.photographed import PIXELS_PER_MM, SHEET_MM, line_mm, sheet

FPS = 20
CAMERA = "observation.images.top"
SCALE = f"{PIXELS_PER_MM} px/mm"
LENGTHS = (12, 7, 9)
ROWS_A_GROUP = 11
NAMES = ["gripper", "x", "y", "z", "yaw"]

Picture = NDArray[np.uint8]


def action(number: int, frame: int) -> list[float]:
    """As `NAMES` says, in metres; every number is told from every other."""
    x, y = line_mm(number, LENGTHS[number])[frame] / 1000
    return [0.5, x, y, -0.001 - 1e-5 * frame, 0.1 * number]


def corner(number: int, frame: int) -> int:
    """How red a picture's upper left corner is, which tells frames apart; it is half green and half blue."""
    return 20 + 50 * number + 12 * frame


def pictures(number: int) -> list[Picture]:
    """Of each frame: the blank sheet with its corner; on the last, a line under the path."""
    shown = []
    for frame in range(LENGTHS[number]):
        picture = sheet()
        picture[:40, :40] = (corner(number, frame), 128, 128)
        shown.append(picture)
    pixels = np.round(line_mm(number) * [1, -1] * PIXELS_PER_MM + [0, SHEET_MM[1] * PIXELS_PER_MM]).astype(np.int32)
    cv2.polylines(shown[-1], [pixels], False, (20, 20, 30), thickness=12)
    return shown


@cache
def encoded(number: int) -> list[bytes]:
    return [encode_png(picture) for picture in pictures(number)]


def publish(folder: Path, video: bool = False) -> Path:
    """Write the dataset, with its pictures in Parquet or in an MP4; returns its folder."""
    shape = list(sheet().shape)
    features: dict[str, Any] = {
        "action": {"dtype": "float32", "shape": [5], "names": {"motors": NAMES}},
        CAMERA: {"dtype": "video" if video else "image", "shape": shape, "names": ["height", "width", "channels"]},
        "timestamp": {"dtype": "float32", "shape": [1], "names": None},
    }
    features |= {
        name: {"dtype": "int64", "shape": [1], "names": None}
        for name in ("frame_index", "episode_index", "index", "task_index")
    }
    first = np.cumsum([0, *LENGTHS])
    frames = [(number, frame) for number, length in enumerate(LENGTHS) for frame in range(length)]
    columns: dict[str, pa.Array] = {
        "action": pa.array([action(*at) for at in frames], pa.list_(pa.float32())),
        "timestamp": pa.array([frame / FPS for _, frame in frames], pa.float32()),
        "frame_index": pa.array([frame for _, frame in frames]),
        "episode_index": pa.array([number for number, _ in frames]),
        "index": pa.array(range(len(frames))),
        "task_index": pa.array([0] * len(frames)),
    }
    episodes: dict[str, Any] = {
        "episode_index": list(range(len(LENGTHS))),
        "tasks": [["draw"]] * len(LENGTHS),
        "length": list(LENGTHS),
        "data/chunk_index": [0] * len(LENGTHS),
        "data/file_index": [0] * len(LENGTHS),
        "dataset_from_index": first[:-1],
        "dataset_to_index": first[1:],
        "stats/action/min": [[0.0] * 5] * len(LENGTHS),
    }
    if video:
        episodes |= {f"videos/{CAMERA}/{of}_index": [0] * len(LENGTHS) for of in ("chunk", "file")}
        episodes[f"videos/{CAMERA}/from_timestamp"] = first[:-1] / FPS
        episodes[f"videos/{CAMERA}/to_timestamp"] = first[1:] / FPS
        film(folder / f"videos/{CAMERA}/chunk-000/file-000.mp4", range(len(LENGTHS)))
    else:
        kept = [{"bytes": png, "path": "frame.png"} for number in range(len(LENGTHS)) for png in encoded(number)]
        columns[CAMERA] = pa.array(kept, pa.struct([("bytes", pa.binary()), ("path", pa.string())]))
    write_parquet(folder / "data/chunk-000/file-000.parquet", columns, row_group_size=ROWS_A_GROUP)
    write_parquet(folder / "meta/episodes/chunk-000/file-000.parquet", episodes)
    info = {
        "codebase_version": "v3.0",
        "robot_type": "somebody's",
        "total_episodes": len(LENGTHS),
        "total_frames": len(frames),
        "total_tasks": 1,
        "chunks_size": 1000,
        "fps": FPS,
        "splits": {"train": "0:3"},
        "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
        "video_path": "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4",
        "features": features,
    }
    (folder / "meta/info.json").write_text(json.dumps(info))
    return folder


def write_parquet(path: Path, columns: dict[str, Any], **options: Any) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    pq.write_table(pa.table(columns), path, **options)


def change_info(folder: Path, **values: Any) -> None:
    path = folder / "meta/info.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | values))


def change_column(path: Path, name: str, values: Any) -> None:
    table = pq.read_table(path)
    at = table.column_names.index(name)
    pq.write_table(table.set_column(at, name, values), path, row_group_size=ROWS_A_GROUP)


def film(path: Path, episodes: Iterable[int], without_last: int = 0, fps: float = FPS) -> None:
    """The pictures of episodes as one video, but for so many at its end."""
    path.parent.mkdir(parents=True, exist_ok=True)
    shown = [picture for number in episodes for picture in pictures(number)]
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), fps, shown[0].shape[1::-1])
    assert writer.isOpened()
    for picture in shown[: len(shown) - without_last]:
        writer.write(np.ascontiguousarray(picture[..., ::-1]))
    writer.release()
