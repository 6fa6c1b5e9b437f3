"""`pentimento import` of a CSV file with one video of each stroke by a camera that does not move.

The first frame shows the canvas before the stroke and the last frame after it. Markers register the camera.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.atomic import check_replaceable
from pentimento.contracts.errors import ConfigError
from pentimento.io.lerobot_episodes import opened_video
from pentimento.io.marker_views import read_markers, rectified
from pentimento.io.photo_pairs import import_strokes, read_paths
from pentimento.io.stroke_rows import COMMAND, Imported, Placement, RecordedPath, Refused, stroke_row

Picture = NDArray[np.uint8]

_ENDINGS: Final = (".mp4", ".mov")


def import_videos(paths: Path, videos: Path, markers: Path, placement: Placement, tool: str, out: Path) -> Imported:
    """Write the folder ``out`` as ``import_photo_pairs`` does, from videos.

    Args:
        videos: a folder with ``<stroke>.mp4``, or one such file if ``paths`` has one stroke.
        placement: by its edges; pictures are rectified to them, about as fine as the video is there.

    Raises:
        ContractError: a file cannot be read, or no stroke can be used; nothing is written.
        ConfigError: ``out`` holds what this command did not write, or one video is given for several strokes.
    """
    check_replaceable(out, COMMAND)
    strokes, layout = read_paths(paths), read_markers(markers, placement)
    if not videos.is_dir() and len(strokes) > 1:
        raise ConfigError(
            f"{paths} has {len(strokes)} strokes, and {videos} is one video; give a folder with <stroke>.mp4 of each."
        )
    window_m = np.array(placement.window_m((0, 0)))

    def row(_: int, stroke: RecordedPath, given: Mapping[str, Any]) -> dict[str, Any]:
        frames = first_and_last(_video(videos, stroke.name))
        before, after = rectified(frames, layout, window_m, one_camera=True)
        return stroke_row(stroke, before, after, placement, given)

    return import_strokes(paths, strokes, row, tool, out)


def _video(videos: Path, name: str) -> Path:
    if not videos.is_dir():
        return videos
    found = [file for file in sorted(videos.iterdir()) if file.stem == name and file.suffix.lower() in _ENDINGS]
    if len(found) != 1:
        raise Refused("there are several videos of it" if found else "there is no video of it")
    return found[0]


def first_and_last(file: Path) -> tuple[Picture, Picture]:
    """The first and the last picture [H, W, 3] of a video, sRGB.

    Raises:
        Refused: it cannot be read, or has one picture.
    """
    try:
        with opened_video(file) as capture:
            _, first = capture.retrieve()
            last = None
            while capture.grab():  # seeking is not exact
                shown, picture = capture.retrieve()
                last = picture if shown else last
    except OSError as error:
        raise Refused(f"its video cannot be opened ({error.strerror})") from error
    if first is None or last is None:
        raise Refused("its video has fewer than two pictures")
    return np.ascontiguousarray(first[..., ::-1]), np.ascontiguousarray(last[..., ::-1])
