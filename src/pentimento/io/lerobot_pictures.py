"""The first and the last picture of each episode of a LeRobot dataset, out of Parquet files or videos.

A video is read from its beginning, frame by frame: that is exact where seeking is not, and only two pictures
of an episode are converted.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from pentimento.contracts.errors import ImageError
from pentimento.contracts.images import decode_image
from pentimento.io.stroke_rows import Refused

Picture = NDArray[np.uint8]
Pair = tuple[Picture, Picture]

_MP4: Final = b"ftyp"
"""In the bytes 4 to 8 of every MP4 file. FFmpeg would also open playlists, which name other files."""


def embedded_pairs(file: Path, camera: str, shape: list[int], rows: list[tuple[int, int]]) -> Iterator[Pair | Refused]:
    """For each pair of ``rows`` of a Parquet file, ascending: the two pictures, or why there are none.

    Raises:
        Refused: the file cannot be read from here on.
    """
    try:
        # As a dictionary, a picture that many frames share is in memory once.
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
    except ImageError:
        return Refused("a picture is unreadable")
    if not (_agrees(before.shape, shape) and _agrees(after.shape, shape)):
        return Refused("a picture has another shape than its feature")
    return before, after


def video_pairs(
    file: Path, shape: list[int], fps: float, times_s: list[tuple[float, float]]
) -> Iterator[Pair | Refused]:
    """For each pair of times in a video, ascending: the two pictures that are nearest, or why there are none.

    Raises:
        Refused: this OpenCV cannot decode the file, or its pictures are of another shape.
    """
    with file.open("rb") as opened:
        if opened.read(8)[4:] != _MP4:
            raise Refused(f"its file {file.name} is no MP4 video")
    capture = cv2.VideoCapture(str(file.absolute()), cv2.CAP_FFMPEG)  # absolute: no name then begins with a protocol
    try:
        size = [int(capture.get(which)) for which in (cv2.CAP_PROP_FRAME_HEIGHT, cv2.CAP_PROP_FRAME_WIDTH)]
        if not (capture.isOpened() and capture.grab()):
            raise Refused(
                f"its video {file.name} cannot be decoded by this build of OpenCV; encode it again as H.264, or keep "
                "the feature as images"
            )
        if not _agrees((*size, 3), shape):
            raise Refused(f"its video {file.name} has another shape than its feature")
        for first_s, last_s in times_s:
            pair = [_at(capture, time_s, 0.5 / fps) for time_s in (first_s, last_s)]
            before, after = pair
            yield (
                (before, after)
                if before is not None and after is not None
                else Refused("its video has no picture at its first or last frame")
            )
    finally:
        capture.release()


def _at(capture: Any, time_s: float, within_s: float) -> Picture | None:
    """The picture at a time, from the one that is grabbed onwards."""
    while (now_s := capture.get(cv2.CAP_PROP_POS_MSEC) / 1000) < time_s - within_s:
        if not capture.grab():
            return None
    if not now_s <= time_s + within_s:
        return None
    shown, picture = capture.retrieve()
    return np.ascontiguousarray(picture[..., ::-1]) if shown else None


def _agrees(shape: tuple[int, ...], told: list[int]) -> bool:
    """Whether a picture [H, W, 3] is of a feature's shape, whose channels may come first or last and may be one."""
    height, width, _ = shape
    return told[:2] == [height, width] or told[1:] == [height, width]
