"""`pentimento import` of a CSV file with one video of each stroke by a camera that does not move.

The first frame shows the canvas before the stroke and the last frame after it. ArUco markers at known places register
the camera to the canvas, as in `pentimento calibrate`.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from pentimento.calibration.observe import calibrate_camera, rectify, window_in_camera
from pentimento.contracts.atomic import check_replaceable
from pentimento.contracts.errors import CalibrationError, ConfigError, ContractError
from pentimento.contracts.markers import MarkerLayout
from pentimento.contracts.observations import Photo
from pentimento.io.lerobot_episodes import opened_video
from pentimento.io.photo_pairs import import_strokes, read_paths
from pentimento.io.stroke_rows import COMMAND, Imported, Placement, RecordedPath, Refused, stroke_row

Picture = NDArray[np.uint8]
FloatArray = NDArray[np.float64]

_COLUMNS: Final = ("marker", "x_mm", "y_mm", "side_mm")
_ENDINGS: Final = (".mp4", ".mov")
_MOVED_PX: Final = 1.0
"""Of a corner of the window in the frame between the first and the last picture, above which the camera moved."""


def read_markers(path: Path, placement: Placement) -> MarkerLayout:
    """Read the places of ArUco markers (`DICT_4X4_50`) from a CSV: id, centre in the frame of the paths, side.

    Raises:
        ContractError: the file is no such table.
    """
    try:
        lines = list(csv.reader(path.read_text(encoding="utf-8-sig").splitlines(), skipinitialspace=True))
    except OSError as error:
        raise ContractError(f"{path} cannot be opened ({error.strerror}); check the path.") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise ContractError(f"{path} is not readable as CSV ({error}); save it as UTF-8 text with commas.") from error
    if not lines or tuple(name.strip() for name in lines[0]) != _COLUMNS:
        raise ContractError(f"{path} does not begin with the line {','.join(_COLUMNS)}; write it, and a line a marker.")
    ids: list[int] = []
    places_m: list[list[float]] = []  # x, y, side
    for number, line in enumerate(lines[1:], start=2):
        try:
            marker, *place = (float(value) for value in line)
            if len(place) != 3 or not np.isfinite(place).all() or place[2] <= 0 or marker != int(marker):
                raise ValueError
        except (ValueError, OverflowError):
            raise ContractError(f"{path}, line {number} is not a marker's number, x, y and side in mm.") from None
        ids.append(int(marker))
        places_m.append([1e-3 * value for value in place])
    if len(ids) < 4 or len(set(ids)) < len(ids) or len({place[2] for place in places_m}) > 1:
        raise ContractError(f"{path} needs four markers or more, all different and with one side; correct it.")
    centres = np.zeros((len(ids), 5))
    centres[:, 1:3] = np.array(places_m)[:, :2]
    assert placement.edges_m is not None  # so no picture's size is needed to turn y up
    return MarkerLayout(tuple(ids), placement.to_canvas(centres, (0, 0))[:, 1:3], places_m[0][2])


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
        before, after = rectified(*first_and_last(_video(videos, stroke.name)), layout, window_m)
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


def rectified(first: Picture, last: Picture, layout: MarkerLayout, window_m: FloatArray) -> tuple[Picture, Picture]:
    """The part of the canvas in a window [4] of two pictures by one camera, at about the camera's resolution.

    Raises:
        Refused: too few markers are seen, the camera moved, or the window lies out of its view.
    """
    try:
        cameras = [calibrate_camera(_photo(picture), layout) for picture in (first, last)]
        boxes = [window_in_camera(camera, window_m) for camera in cameras]
        if np.abs(boxes[1] - boxes[0]).max() > _MOVED_PX:
            raise Refused("the camera or the markers moved during its video")
        scale = float(((boxes[0][2:] - boxes[0][:2]) / (window_m[2:] - window_m[:2])).mean())
        pixels_per_m = max(float(f"{scale:.2g}"), 1.0)  # the same for all videos of a session
        before, after = (rectify(_photo(picture), cameras[0], window_m, pixels_per_m) for picture in (first, last))
    except (CalibrationError, ContractError) as error:
        raise Refused(f"its camera cannot be registered: {str(error).rstrip('.')}") from error
    return before, after


def _photo(picture: Picture) -> Photo:
    return Photo(picture, exposure_s=np.nan, gain=np.nan, white_balance=np.full(3, np.nan), t_s=np.nan)
