"""Pictures of a canvas with ArUco markers round it, rectified as in `pentimento calibrate`."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from pentimento.calibration.observe import calibrate_camera, rectify, window_in_camera
from pentimento.contracts.errors import CalibrationError, ContractError
from pentimento.contracts.markers import MarkerLayout
from pentimento.contracts.observations import Photo
from pentimento.io.stroke_rows import Placement, Refused

Picture = NDArray[np.uint8]
FloatArray = NDArray[np.float64]

_COLUMNS: Final = ("marker", "x_mm", "y_mm", "side_mm")
_MOVED_PX: Final = 1.0
"""Of a corner of the window between two pictures of one camera, above which it moved."""


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


def rectified(
    pictures: Sequence[Picture], layout: MarkerLayout, window_m: FloatArray, *, one_camera: bool
) -> list[Picture]:
    """The part of the canvas in a window [4] of pictures [H, W, 3], all at about the resolution of the first one.

    Args:
        one_camera: it did not move, and its pose is taken from the first picture.

    Raises:
        Refused: too few markers are seen, the camera moved though it should not, or the window lies out of its view.
    """
    try:
        photos = [Photo(each, np.nan, np.nan, white_balance=np.full(3, np.nan), t_s=np.nan) for each in pictures]
        cameras = [calibrate_camera(photo, layout) for photo in photos]
        boxes = [window_in_camera(camera, window_m) for camera in cameras]
        if one_camera:
            if max(float(np.abs(box - boxes[0]).max()) for box in boxes) > _MOVED_PX:
                raise Refused("the camera or the markers moved between its pictures")
            cameras = [cameras[0]] * len(photos)
        scale = float(((boxes[0][2:] - boxes[0][:2]) / (window_m[2:] - window_m[:2])).mean())
        pixels_per_m = float(f"{scale:.2g}")  # the same for all videos of a session
        return [rectify(photo, camera, window_m, pixels_per_m) for photo, camera in zip(photos, cameras, strict=True)]
    except (CalibrationError, ContractError) as error:
        raise Refused(f"its camera cannot be registered: {str(error).rstrip('.')}") from error
