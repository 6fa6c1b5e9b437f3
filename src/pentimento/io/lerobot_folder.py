"""The folder of a LeRobot v3.0 dataset: `meta/info.json`, its episodes, and the files of their frames.

Many episodes share a file. `meta/episodes/*/*.parquet` therefore holds for each episode the indices of a chunk and a
file, which the path templates of `info.json` turn into a file name. A dataset is untrusted input: its values are
checked before they name a file or a size.
"""

from __future__ import annotations

import json
import math
import os
import re
from pathlib import Path, PurePosixPath
from typing import Any, Final, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from pentimento.contracts.errors import ContractError
from pentimento.contracts.picture_files import MAX_PIXELS
from pentimento.contracts.schema import IMAGE
from pentimento.contracts.strokes import CONTRACT
from pentimento.contracts.tables import visible
from pentimento.io.stroke_rows import Refused

VERSION: Final = "v3.0"
INFO: Final = "meta/info.json"
STATISTICS: Final = "meta/stats.json"
TASKS: Final = "meta/tasks.parquet"
EPISODES: Final = "meta/episodes/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
DATA: Final = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"

ACTION: Final = "action"
CANVAS: Final = "observation.images.canvas"
"""The feature with the pictures of an exported dataset."""
OWN: Final = "pentimento/"
"""Prefix of the columns of `meta/episodes` that keep a row of the strokes contract."""
OWN_PICTURE: Final = "pentimento_picture/"
"""Prefix of the columns that describe a row's pictures before padding: height, width, grey."""

PICTURES: Final = ("image", "video")
_FIELD: Final = re.compile(r"\{(chunk_index|file_index)(?::(0?[1-9])d)?\}|\{(video_key)\}")
_MAX_NUMBER: Final = 2**31
"""Above any index of a chunk, a file or an episode."""
_MAX_FPS: Final = 1e5


class Dataset(NamedTuple):
    """The description of a dataset."""

    folder: Path
    fps: float
    features: dict[str, dict[str, Any]]
    data_path: str
    """A path template with the fields ``chunk_index`` and ``file_index``, relative to the folder and inside it."""
    video_path: str | None
    """The same for videos; it may have the field ``video_key``."""
    episodes: pa.Table
    """Sorted by ``episode_index``, which is unique; without columns of statistics."""

    @property
    def exported(self) -> bool:
        """Whether `pentimento export` wrote it and all required columns of the strokes contract are there."""
        kept = {f"{OWN}{column.name}" for column in CONTRACT.columns if column.required and column.type != IMAGE}
        return kept <= set(self.episodes.column_names)

    def whole_numbers(self, name: str) -> list[int]:
        """Return a column of the episodes.

        Raises:
            ContractError: it is missing, or not all whole numbers from 0.
        """
        return _whole(self.episodes, name, self.folder)

    def times_s(self, name: str) -> list[float]:
        """Return a column of the episodes; unknown and infinite values are NaN.

        Raises:
            ContractError: it is missing or not of numbers.
        """
        values = _column(self.episodes, name, self.folder)
        if not (pa.types.is_floating(values.type) or pa.types.is_integer(values.type)):
            raise ContractError(f"Column {name!r} of {self.folder}/meta/episodes is {values.type} and not numbers.")
        return [math.nan if value is None or not math.isfinite(value) else float(value) for value in values.to_pylist()]

    def data_file(self, chunk: int, number: int) -> Path:
        """Return the Parquet file of these indices.

        Raises:
            Refused: it does not exist.
        """
        return _file(self.folder, self.data_path, chunk, number, "")

    def video_file(self, camera: str, chunk: int, number: int) -> Path:
        """Return the MP4 file of these indices.

        Raises:
            Refused: it does not exist.
        """
        assert self.video_path is not None
        return _file(self.folder, self.video_path, chunk, number, camera)


def open_dataset(folder: Path) -> Dataset:
    """Read the description of the dataset in ``folder``; its frames are not read.

    Raises:
        ContractError: there is no dataset, it has another version, or a value is impossible.
    """
    where = folder / INFO
    info = _info(where)
    version = info.get("codebase_version")
    if version != VERSION:
        older = isinstance(version, str) and version.startswith(("v1.", "v2."))
        convert = (
            " Convert it with LeRobot's own script first: "
            "python -m lerobot.scripts.convert_dataset_v21_to_v30 --repo-id=NAME --root=FOLDER "
            "--push-to-hub=false."
        )
        raise ContractError(
            f"{where} is of version {_short(version)}, and {VERSION} is what can be read.{convert if older else ''}"
        )
    fps = info.get("fps")
    if isinstance(fps, bool) or not isinstance(fps, int | float) or not 0 < fps <= _MAX_FPS:
        raise ContractError(f"{where}: fps is {_short(fps)}, and not a number of frames a second above 0.")
    features = _features(info.get("features"), where)
    data_path = _template(info.get("data_path"), "data_path", where)
    has_videos = any(feature["dtype"] == "video" for feature in features.values())
    video_path = _template(info.get("video_path"), "video_path", where) if has_videos else None
    return Dataset(folder, float(fps), features, data_path, video_path, _episodes(folder))


def names_of(feature: dict[str, Any]) -> list[str] | None:
    """Return the names of a vector's values in their order; None where they are missing or incomplete.

    LeRobot writes a list of names, lists by group, or indices by name.
    """
    names, (width, *_) = feature.get("names"), feature["shape"]
    if isinstance(names, dict) and set(map(repr, names.values())) == set(map(repr, range(len(names)))):
        names = sorted(names, key=names.__getitem__)
    elif isinstance(names, dict) and all(isinstance(group, list) for group in names.values()):
        names = [name for group in names.values() for name in group]
    named = isinstance(names, list) and len(names) == width and all(isinstance(name, str) for name in names)
    return names if named else None


def rows_by_episode(episode: NDArray[np.float64]) -> dict[int, NDArray[np.intp]]:
    """Return the rows of each episode, in their order, from the column ``episode_index`` of a data file."""
    order = np.argsort(episode, kind="stable")
    found, starts = np.unique(episode[order], return_index=True)
    return {int(e): rows for e, rows in zip(found, np.split(order, starts[1:]), strict=False) if np.isfinite(e)}


def read_numbers(file: Path, names: list[str]) -> dict[str, NDArray[np.float64]]:
    """Read columns of a data file: [N] for a number in each frame, [N, D] for a vector.

    Raises:
        Refused: the file cannot be read, or a column is missing or does not hold numbers.
    """
    try:
        with pq.ParquetFile(file) as opened:
            table = opened.read(columns=names)
        return {name: _numbers(table, name) for name in names}
    except (OSError, pa.ArrowException, ValueError) as error:
        raise Refused(f"its file {file.name} cannot be read ({_first_line(error)})") from error


def _numbers(table: pa.Table, name: str) -> NDArray[np.float64]:
    if name not in table.column_names:
        raise Refused(f"its file has no column {name!r}")
    values, width = table.column(name).combine_chunks(), None
    if pa.types.is_list(values.type) or pa.types.is_fixed_size_list(values.type) or pa.types.is_large_list(values.type):
        lengths = values.value_lengths().unique().to_pylist() if len(values) else []
        if len(lengths) != 1 or not lengths[0] or values.null_count:
            raise Refused(f"{name!r} of its file has not the same number of values in each frame")
        (width,), values = lengths, values.flatten()
    if not (pa.types.is_floating(values.type) or pa.types.is_integer(values.type)):
        raise Refused(f"{name!r} of its file is {values.type} and not numbers")
    numbers = values.to_numpy(zero_copy_only=False).astype(np.float64)
    return numbers if width is None else numbers.reshape(-1, width)


def _info(where: Path) -> dict[str, Any]:
    try:
        info = json.loads(where.read_text(encoding="utf-8"))
    except OSError as error:
        raise ContractError(
            f"{where} cannot be opened ({error.strerror}); a LeRobot dataset is named by the folder that holds meta/."
        ) from error
    except (ValueError, RecursionError) as error:
        raise ContractError(f"{where} is not readable as JSON ({_first_line(error)}); copy it again.") from error
    if not isinstance(info, dict):
        raise ContractError(f"{where} holds no JSON object, and so says nothing of a dataset; copy it again.")
    return info


def _features(features: Any, where: Path) -> dict[str, dict[str, Any]]:
    if not isinstance(features, dict) or not features:
        raise ContractError(f"{where} names no features, and so there is nothing to read.")
    for key, feature in features.items():
        if not isinstance(feature, dict) or not isinstance(feature.get("dtype"), str):
            raise ContractError(f"{where}: feature {_short(key)} does not say its dtype.")
        if "/" in key or key in ("", ".", ".."):
            raise ContractError(f"{where}: feature {_short(key)} has a name that leaves its folder.")
        picture = feature["dtype"] in PICTURES
        if not picture and key != ACTION:
            continue  # not read; its shape may be of any kind
        shape = feature.get("shape")
        if not isinstance(shape, list) or not shape or not all(type(size) is int for size in shape):
            raise ContractError(f"{where}: feature {_short(key)} has the shape {_short(shape)}, which is none.")
        if min(shape) < 0 or math.prod(shape) > 4 * MAX_PIXELS or (picture and (len(shape) != 3 or min(shape) < 1)):
            raise ContractError(f"{where}: feature {_short(key)} has the shape {_short(shape)}, which is impossible.")
    return features


def _template(template: Any, name: str, where: Path) -> str:
    if not isinstance(template, str) or not template:
        raise ContractError(f"{where}: {name} is {_short(template)} and no path of files, such as {DATA}.")
    plain = PurePosixPath(_FIELD.sub("0", template))
    if any(mark in str(plain) for mark in "{}\\\0"):
        raise ContractError(
            f"{where}: {name} is {_short(template)}; its fields can be chunk_index, file_index and video_key, "
            f"as in {DATA}."
        )
    if plain.is_absolute() or ".." in plain.parts:
        raise ContractError(
            f"{where}: {name} is {_short(template)}, which leaves the dataset's folder; do not trust it."
        )
    return template


def _file(folder: Path, template: str, chunk: int, number: int, camera: str) -> Path:
    numbers = {"chunk_index": chunk, "file_index": number}

    def filled(field: re.Match[str]) -> str:
        return camera if field[3] else format(numbers[field[1]], f"{field[2] or ''}d")

    relative = _FIELD.sub(filled, template)
    if not os.path.isfile(folder / relative):  # unlike Path.is_file, it returns False for names that no file can have
        raise Refused(f"its file {relative!r} is missing")
    return folder / relative


def _episodes(folder: Path) -> pa.Table:
    files = sorted(visible((folder / "meta/episodes").glob("*/*.parquet")))
    if not files:
        raise ContractError(f"{folder}/meta/episodes holds no */*.parquet, which lists the episodes; copy it again.")
    try:
        table = pa.concat_tables([_without_statistics(file) for file in files], promote_options="permissive")
    except (OSError, pa.ArrowException, ValueError) as error:
        raise ContractError(
            f"{folder}/meta/episodes cannot be read as Parquet ({_first_line(error)}); copy it again."
        ) from error
    if len(set(table.column_names)) < table.num_columns:
        raise ContractError(f"{folder}/meta/episodes has two columns of one name; write it again.")
    index = _whole(table, "episode_index", folder)
    if len(set(index)) < len(index):
        raise ContractError(f"{folder}/meta/episodes lists an episode twice; remove the file that is left over.")
    return table.take(np.argsort(index)) if index else table


def _without_statistics(file: Path) -> pa.Table:
    with pq.ParquetFile(file) as opened:
        return opened.read(columns=[name for name in opened.schema_arrow.names if not name.startswith("stats/")])


def _column(table: pa.Table, name: str, folder: Path) -> pa.ChunkedArray:
    if name not in table.column_names:
        raise ContractError(f"{folder}/meta/episodes has no column {name!r}; it is not laid out as {VERSION} is.")
    return table.column(name)


def _whole(table: pa.Table, name: str, folder: Path) -> list[int]:
    values = _column(table, name, folder)
    numbers: list[int] = values.to_pylist() if pa.types.is_integer(values.type) and values.null_count == 0 else [-1]
    if not all(0 <= number < _MAX_NUMBER for number in numbers):
        raise ContractError(f"Column {name!r} of {folder}/meta/episodes is not all whole numbers from 0.")
    return numbers


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 80 else f"{text[:80]}…"


def _first_line(error: BaseException) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0][:120].rstrip(".")
