"""Episodes of a LeRobot dataset, file by file: the numbers of their frames, and their first and last pictures.

Episodes that cannot be used are left out and recorded with the reason in ``refused``. A video is read frame by frame
from its beginning, because seeking is not exact; only two pictures of each episode are converted.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO, Final, NamedTuple

import cv2
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from pentimento.contracts.images import decode_image
from pentimento.contracts.picture_files import PictureError
from pentimento.io.lerobot_folder import Dataset, read_numbers, rows_by_episode
from pentimento.io.pyav_video import pyav_capture
from pentimento.io.stroke_rows import Refused

Picture = NDArray[np.uint8]
Pair = tuple[Picture, Picture]

_MP4: Final = b"ftyp"
"""Bytes 4 to 8 of every MP4 file. They are checked because FFmpeg would also open playlists, which name other files."""


def embedded_pairs(file: Path, camera: str, shape: list[int], rows: list[tuple[int, int]]) -> Iterator[Pair | Refused]:
    """Yield the two pictures of each pair of ``rows`` of a Parquet file (ascending), or the reason why there are none.

    Raises:
        Refused: the file cannot be read from here on.
    """
    try:
        # With dictionary encoding, a picture that many frames share is in memory once.
        with pq.ParquetFile(file, read_dictionary=[f"{camera}.bytes"]) as opened:
            sizes = [opened.metadata.row_group(group).num_rows for group in range(opened.num_row_groups)]
            ends, held, column = np.cumsum(sizes), -1, []
            for pair in rows:
                found = []
                for row in pair:
                    group = int(np.searchsorted(ends, row, side="right"))
                    if group != held:
                        column, held = opened.read_row_group(group, columns=[camera]).column(camera), group
                    found.append(column[row - int(ends[group]) + sizes[group]].as_py())
                yield _decoded(found, shape)
    except (OSError, pa.ArrowException, KeyError, IndexError) as error:
        raise Refused(f"the pictures in its file {file.name} cannot be read") from error


def _decoded(pair: list[Any], shape: list[int]) -> Pair | Refused:
    if not all(isinstance(picture, dict) and isinstance(picture.get("bytes"), bytes) for picture in pair):
        return Refused("a picture is not embedded in its file")
    try:
        before, after = (decode_image(picture["bytes"], "A picture") for picture in pair)
    except PictureError as error:
        return Refused(f"a picture is unreadable ({error.reason})")
    if not (_agrees(before.shape, shape) and _agrees(after.shape, shape)):
        return Refused("a picture has another shape than its feature")
    return before, after


@contextmanager
def opened_video(file: Path) -> Iterator[Any]:
    """An MP4 file as OpenCV's capture, which has grabbed its first picture; as `pyav_video.Capture` where OpenCV cannot
    decode it and PyAV is installed (extra `video`).

    Raises:
        Refused: it is none, it is cut off, or it cannot be decoded here.
    """
    with file.open("rb") as opened:
        if opened.read(8)[4:] != _MP4:
            raise Refused(f"its file {file.name} is no MP4 video")
        if not _is_whole(opened):
            raise Refused(f"its file {file.name} is cut off; copy it again")
    capture: Any = cv2.VideoCapture(str(file.absolute()), cv2.CAP_FFMPEG)  # absolute: no name begins with a protocol
    try:
        if not (capture.isOpened() and capture.grab()):
            capture.release()
            capture = pyav_capture(file)
        yield capture
    finally:
        capture.release()


def _is_whole(file: BinaryIO) -> bool:
    """Whether the boxes of an MP4 file end where it ends; players show what is there of one that was cut off."""
    end, at = file.seek(0, os.SEEK_END), 0
    while at + 8 <= end:
        file.seek(at)
        head = file.read(16)
        size = int.from_bytes(head[:4])
        size = int.from_bytes(head[8:16]) if size == 1 else size or end - at
        if size < 8:
            return False
        at += size
    return at == end


class Span(NamedTuple):
    """Where an episode lies in its video, by the table."""

    first_s: float
    """Time of its first frame; likewise of its last one."""
    last_s: float
    frames: int


def video_pairs(file: Path, shape: list[int], fps: float, spans: list[Span]) -> Iterator[Pair | Refused]:
    """Yield the first and the last picture of each span of a video (ascending), or the reason why there are none.

    Pictures are found by their own times in the video. Their numbers must agree with these times at the rate ``fps``,
    and with the number of the episode's frames, and none may be in the episode before it.

    Raises:
        Refused: this OpenCV cannot decode the file, or its pictures have another shape.
    """
    with opened_video(file) as capture:
        size = [int(capture.get(which)) for which in (cv2.CAP_PROP_FRAME_HEIGHT, cv2.CAP_PROP_FRAME_WIDTH)]
        if not _agrees((*size, 3), shape):
            raise Refused(f"its video {file.name} has another shape than its feature")
        film, before = _Film(capture), -1
        for span in spans:
            first = film.at(span.first_s, 0.5 / fps)
            start = film.number
            last = film.at(span.last_s, 0.5 / fps)
            if first is None or last is None:
                yield Refused("its video has no picture at its first or last frame")
            elif film.number - start + 1 != span.frames or start != round(span.first_s * fps):
                yield Refused("its video shows another number of pictures than it has frames: fps is not the video's")
            elif start <= before:
                yield Refused("its first picture in the video is one of another episode")
            else:
                yield first, last
            before = film.number


class _Film:
    """A video that is read forwards."""

    def __init__(self, capture: Any) -> None:
        """``capture`` has grabbed its first picture."""
        self._capture = capture
        self.number = 0
        """Of the picture, from 0."""

    def at(self, time_s: float, within_s: float) -> Picture | None:
        """The picture at a time; None where there is none within `within_s`."""
        while (now_s := self._capture.get(cv2.CAP_PROP_POS_MSEC) / 1000) < time_s - within_s:
            if not self._capture.grab():
                return None
            self.number += 1
        if not now_s <= time_s + within_s:
            return None
        shown, picture = self._capture.retrieve()
        return np.ascontiguousarray(picture[..., ::-1]) if shown else None


def _agrees(shape: tuple[int, ...], expected: list[int]) -> bool:
    """Whether a picture [H, W, 3] has a feature's shape, whose one or three channels may come first or last."""
    height, width, _ = shape
    return expected[:2] == [height, width] or expected[1:] == [height, width]


_MIN_FRAMES: Final = 2

Reasons = dict[str, list[str]]
"""Indices of the episodes that were left out, by reason."""


class Episode(NamedTuple):
    """An episode with all its frames."""

    place: int
    """Row of the dataset's table of episodes."""
    number: int
    """Its ``episode_index``."""
    rows: NDArray[np.intp]
    """Rows of its data file."""


def leave_out(refused: Reasons, reason: object, numbers: Iterable[int]) -> None:
    """Record why episodes are left out."""
    refused.setdefault(str(reason), []).extend(str(number) for number in numbers)


def sound_episodes(
    dataset: Dataset, names: list[str], refused: Reasons
) -> Iterator[tuple[Path, dict[str, NDArray[np.float64]], list[Episode]]]:
    """Yield for each data file its path, its columns ``names`` with those of the indices, and its episodes in order.

    Raises:
        ContractError: the columns that locate the episodes are missing.
    """
    index, length = (dataset.whole_numbers(name) for name in ("episode_index", "length"))
    by_file: dict[tuple[int, int], list[int]] = {}
    numbers = zip(*(dataset.whole_numbers(f"data/{of}_index") for of in ("chunk", "file")), strict=True)
    for place, file_number in enumerate(numbers):
        by_file.setdefault(file_number, []).append(place)
    for file_number, places in by_file.items():
        try:
            file = dataset.data_file(*file_number)
            columns = read_numbers(file, ["episode_index", "frame_index", *names])
        except Refused as reason:
            leave_out(refused, reason, (index[place] for place in places))
            continue
        rows = rows_by_episode(columns["episode_index"])
        episodes = [Episode(place, index[place], rows.get(index[place], np.zeros(0, np.intp))) for place in places]
        faults = [_fault(episode, columns["frame_index"], length[episode.place]) for episode in episodes]
        for episode, fault in zip(episodes, faults, strict=True):
            if fault is not None:
                leave_out(refused, fault, [episode.number])
        sound = [episode for episode, fault in zip(episodes, faults, strict=True) if fault is None]
        yield file, columns, sorted(sound, key=lambda episode: int(episode.rows[0]))


def _fault(episode: Episode, frame_index: NDArray[np.float64], length: int) -> str | None:
    if len(episode.rows) != length:
        return "it has another number of frames than meta/episodes says"
    if length < _MIN_FRAMES:
        return f"it has fewer than {_MIN_FRAMES} frames"
    numbered = np.array_equal(frame_index[episode.rows], np.arange(length))
    return None if numbered else "its frames are not numbered one after the other"


def first_and_last_pictures(
    dataset: Dataset,
    camera: str,
    file: Path,
    episodes: list[Episode],
    refused: Reasons,
    timestamp_s: NDArray[np.float64] | None = None,
) -> Iterator[tuple[Episode, Pair]]:
    """Yield the first and the last picture [H, W, 3], sRGB, of each episode of a data file that has them.

    Args:
        timestamp_s: of each row of the data file, from the episode's start; None or NaN: by the rate of the dataset.

    Raises:
        ContractError: the columns that locate the videos are missing.
    """
    shape = dataset.features[camera]["shape"]
    if dataset.features[camera]["dtype"] == "image":
        rows = [(int(episode.rows[0]), int(episode.rows[-1])) for episode in episodes]
        yield from _noted(embedded_pairs(file, camera, shape, rows), episodes, refused)
        return
    start_s = dataset.times_s(f"videos/{camera}/from_timestamp")
    numbers = list(
        zip(*(dataset.whole_numbers(f"videos/{camera}/{of}_index") for of in ("chunk", "file")), strict=True)
    )
    for video_number in dict.fromkeys(numbers[episode.place] for episode in episodes):
        part = [episode for episode in episodes if numbers[episode.place] == video_number]
        part.sort(key=lambda episode: start_s[episode.place])
        try:
            video = dataset.video_file(camera, *video_number)
        except Refused as reason:
            leave_out(refused, reason, (episode.number for episode in part))
            continue
        spans = [_span(episode, start_s[episode.place], dataset.fps, timestamp_s) for episode in part]
        yield from _noted(video_pairs(video, shape, dataset.fps, spans), part, refused)


def _span(episode: Episode, start_s: float, fps: float, timestamp_s: NDArray[np.float64] | None) -> Span:
    frames = len(episode.rows)
    last_s = (frames - 1) / fps
    times = np.array([0.0, last_s]) if timestamp_s is None else timestamp_s[episode.rows[[0, -1]]]
    first_s, last_s = times if np.isfinite(times).all() else (0.0, last_s)
    return Span(start_s + float(first_s), start_s + float(last_s), frames)


def _noted(
    pairs: Iterator[Pair | Refused], episodes: list[Episode], refused: Reasons
) -> Iterator[tuple[Episode, Pair]]:
    done = 0
    try:
        for pair in pairs:
            episode = episodes[done]
            done += 1
            if isinstance(pair, Refused):
                leave_out(refused, pair, [episode.number])
            else:
                yield episode, pair
    except Refused as reason:
        leave_out(refused, reason, (episode.number for episode in episodes[done:]))
