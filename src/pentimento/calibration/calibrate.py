"""Calibration of a rig: lens, canvas pose, colours, and surface height.

Each function computes a `Calibration` (robots/calibration.py) from photographs or touches; only `calibrate_touch` moves
the robot. `calibrate` guides a person through one calibration and writes the result.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from pentimento.calibration.colour_chart import ColourMap, find_colours
from pentimento.calibration.lens import Lens, find_lens, straightened
from pentimento.calibration.observe import CameraCalibration, calibrate_camera, rectify
from pentimento.calibration.touch import touch_height, touch_plane
from pentimento.contracts.colour import srgb_to_linear, to_float
from pentimento.contracts.errors import CalibrationError
from pentimento.contracts.frames import canvas_to_pixel, image_shape
from pentimento.contracts.markers import markers_around
from pentimento.contracts.observations import Photo
from pentimento.robots.calibration import Calibration, Kind, digest_of, read_calibration, write_calibration
from pentimento.robots.driver import Robot
from pentimento.robots.motion import timed_path
from pentimento.robots.rig import Rig
from pentimento.robots.tools import Tool

FloatArray = NDArray[np.float64]

CHART_M: Final = (0.12, 0.1)
"""Width and height of the printed colour chart; it lies in the canvas's lower left corner."""
BOARD_PHOTOS: Final = 12
_CHART_PX_PER_M = 1500.0

TOUCH_FROM_M: Final = 0.003
"""Height above the rig file's surface at which the search starts; the rig file is measured with a ruler."""
_TOUCH_STEP_M = 5e-4
"""Step of the search for the surface."""
_TOUCH_WITHIN_M = 5e-5
"""Precision of the found height."""
_LINE_M = 0.006
"""Length of the lines that are drawn at each place."""
_LINES_APART_M = 0.004
"""Distance between them, at least."""
_TOUCH_PX_PER_M = 2000.0
_DARKER = 0.012
"""Min relative darkening that counts as a mark: several times that of the camera's noise."""


def calibrate_lens(photos: Sequence[Photo], rig: Rig, now_unix_s: float) -> Calibration:
    """The lens, from photographs of the ChArUco board (calibration/lens.py)."""
    lens = find_lens(photos)
    values = {
        "matrix": lens.matrix.tolist(),
        "distortion": lens.distortion.tolist(),
        "frame_size_px": list(lens.frame_size_px),
    }
    made_from = digest_of(*(photo.frame for photo in photos))
    return Calibration("lens", rig.digest, now_unix_s, made_from, lens.residual_px, values)


def calibrate_canvas(photo: Photo, lens: Lens | None, rig: Rig, now_unix_s: float) -> Calibration:
    """The canvas's homography, from one photograph of the markers round it.

    With a lens, the homography holds for photographs that were straightened by it.
    """
    seen = photo if lens is None else straightened(photo, lens)
    camera = calibrate_camera(seen, markers_around(rig.canvas_size_m))
    values = {
        "camera_from_canvas": camera.camera_from_canvas.tolist(),
        "frame_size_px": list(camera.frame_size_px),
        "straightened": lens is not None,
    }
    return Calibration("canvas", rig.digest, now_unix_s, digest_of(photo.frame), camera.reprojection_px, values)


def calibrate_colours(photo: Photo, camera: CameraCalibration, rig: Rig, now_unix_s: float) -> Calibration:
    """The camera's colours, from one photograph of the chart in the canvas's lower left corner.

    `photo` is straightened where `camera` is of straightened photographs.
    """
    chart = rectify(photo, camera, (0.0, 0.0, *CHART_M), _CHART_PX_PER_M)
    found = find_colours(chart)
    values = {"matrix": found.matrix.tolist(), "offset": found.offset.tolist()}
    return Calibration("colour", rig.digest, now_unix_s, digest_of(photo.frame), found.residual, values)


def calibrate_touch(
    robot: Robot, tool: Tool, rig: Rig, marked: Callable[[FloatArray], bool], clock: Callable[[], float]
) -> Calibration:
    """The surface, from the heights at which short lines begin to leave a mark, at five places.

    The robot holds the tool; one that dips is dipped into paint 0 at each place. Commands go through the guard.
    `marked(path)` draws the line and returns whether it left a mark. The result replaces the rig's surface and is dated
    by `clock()` (Unix time, s) after the last line.

    Raises CalibrationError where the tool touches too early or never; the robot's own errors pass through.
    """
    places_m = _touch_places(rig.canvas_size_m)
    lowest_m = -tool.press_range_m[1]
    heights_m = np.empty(len(places_m))
    for index, place_m in enumerate(places_m):
        lines = 0
        if tool.dips:
            robot.dip(0)

        def touches(height_m: float, place_m: FloatArray = place_m) -> bool:
            nonlocal lines
            path = _line(place_m, lines, height_m, tool)
            lines += 1
            return marked(path)

        highest_m = min(TOUCH_FROM_M, rig.travel_height_m)
        heights_m[index] = touch_height(touches, highest_m, lowest_m, _TOUCH_STEP_M, _TOUCH_WITHIN_M)
    plane, residual_m = touch_plane(places_m, heights_m)
    surface = [old + new for old, new in zip(rig.surface, plane, strict=True)]
    values = {"surface": surface, "tool": tool.name, "heights_m": heights_m.tolist()}
    return Calibration("touch", rig.digest, clock(), digest_of(places_m, heights_m), residual_m, values)


def marks_on_photos(
    robot: Robot, photograph: Callable[[], Photo], camera: CameraCalibration, lens: Lens | None
) -> Callable[[FloatArray], bool]:
    """For calibrate_touch: draws a line and detects it by photographs before and after.

    The paint must be darker than the sheet.
    """

    def seen(window_m: FloatArray) -> FloatArray:
        photo = photograph()
        image = rectify(photo if lens is None else straightened(photo, lens), camera, window_m, _TOUCH_PX_PER_M)
        return srgb_to_linear(to_float(image)).mean(axis=2).astype(np.float64)

    def marked(path: FloatArray) -> bool:
        reach_m = 0.004
        low, high = path[:, 1:3].min(axis=0) - reach_m, path[:, 1:3].max(axis=0) + reach_m
        window_m = np.array([*low, *high])
        before = seen(window_m)
        robot.move(path)
        darker = before - seen(window_m)
        line, beside = _masks(path, window_m)
        return bool(darker[line].mean() - np.median(darker[beside]) > _DARKER * before[line].mean())

    return marked


def marks_seen_by_a_person(robot: Robot, ask_yes: Callable[[str], bool]) -> Callable[[FloatArray], bool]:
    """For calibrate_touch without a camera: draws a line and asks the person whether it left a mark."""

    def marked(path: FloatArray) -> bool:
        robot.move(path)
        x_mm, y_mm = 1000 * path[len(path) // 2, 1:3]
        return ask_yes(f"Is there a new mark at x = {x_mm:.0f} mm, y = {y_mm:.0f} mm of the canvas?")

    return marked


def lens_of(calibration: Calibration) -> Lens:
    """The lens of a calibration."""
    matrix, distortion = (np.array(_value(calibration, "lens", key)) for key in ("matrix", "distortion"))
    width, height = _value(calibration, "lens", "frame_size_px")
    return Lens(matrix, distortion, (width, height), calibration.residual)


def camera_of(calibration: Calibration) -> CameraCalibration:
    """The canvas's homography of a calibration."""
    width, height = _value(calibration, "canvas", "frame_size_px")
    homography = np.array(_value(calibration, "canvas", "camera_from_canvas"))
    return CameraCalibration(homography, calibration.residual, (width, height))


def colours_of(calibration: Calibration) -> ColourMap:
    """The camera's colours, of a calibration."""
    matrix, offset = (np.array(_value(calibration, "colour", key)) for key in ("matrix", "offset"))
    return ColourMap(matrix, offset, calibration.residual)


def calibrate(
    kind: Kind,
    rig: Rig,
    folder: Path,
    *,
    photograph: Callable[[], Photo] | None,
    robot: Robot | None,
    tool: Tool,
    ask: Callable[[str], None],
    ask_yes: Callable[[str], bool],
    clock: Callable[[], float],
) -> Calibration:
    """Make one calibration with a person's help and write it into `folder`.

    Kinds build on each other where the rig has a camera: lens, canvas, then colour and touch.

    Args:
        photograph: the rig's camera without corrections; None where it has none.
        robot: for the touch alone: guarded, and with its palette laid out where the tool dips.
        ask, ask_yes: put a request, or a question, to the person.
        clock: the Unix time [s]; read when the measurements are made, since a person may need minutes for them.
    """
    found = _calibrated(
        kind,
        rig,
        folder,
        photograph=photograph,
        robot=robot,
        tool=tool,
        ask=ask,
        ask_yes=ask_yes,
        clock=clock,
    )
    write_calibration(folder, found)
    return found


def _calibrated(
    kind: Kind,
    rig: Rig,
    folder: Path,
    *,
    photograph: Callable[[], Photo] | None,
    robot: Robot | None,
    tool: Tool,
    ask: Callable[[str], None],
    ask_yes: Callable[[str], bool],
    clock: Callable[[], float],
) -> Calibration:
    if kind == "touch" and robot is None:
        raise CalibrationError("A touch calibration needs the robot.")
    if kind == "touch" and robot is not None and photograph is None:
        return calibrate_touch(robot, tool, rig, marks_seen_by_a_person(robot, ask_yes), clock)
    if photograph is None:
        raise CalibrationError(f"The rig {rig.name} has no camera, and a {kind} calibration needs one.")
    if kind == "lens":
        photos = []
        for number in range(1, BOARD_PHOTOS + 1):
            ask(f"Hold the ChArUco board into the picture, at a new tilt and place ({number}/{BOARD_PHOTOS}).")
            photos.append(photograph())
        return calibrate_lens(photos, rig, clock())
    lens = lens_of(read_calibration(folder, "lens"))
    if kind == "canvas":
        ask("Take everything off the canvas and its markers.")
        return calibrate_canvas(photograph(), lens, rig, clock())
    camera = camera_of(read_calibration(folder, "canvas"))
    if kind == "colour":
        ask("Lay the colour chart upright into the canvas's lower left corner.")
        return calibrate_colours(straightened(photograph(), lens), camera, rig, clock())
    assert robot is not None  # refused above
    ask("Take everything off the canvas; the robot is going to draw short lines at five places.")
    return calibrate_touch(robot, tool, rig, marks_on_photos(robot, photograph, camera, lens), clock)


def _value(calibration: Calibration, kind: Kind, key: str) -> Any:
    if calibration.kind != kind or key not in calibration.values:
        raise CalibrationError(f"This {calibration.kind} calibration has no {key} of a {kind}; calibrate again.")
    return calibration.values[key]


def _touch_places(canvas_size_m: tuple[float, float]) -> FloatArray:
    """[5, 2]: near the corners and in the middle."""
    shares = np.array([[0.15, 0.15], [0.85, 0.15], [0.5, 0.5], [0.15, 0.85], [0.85, 0.85]])
    return shares * np.array(canvas_size_m)


def _line(place_m: FloatArray, number: int, height_m: float, tool: Tool) -> FloatArray:
    """The number-th of several short lines around a place, at one height, in rows of four."""
    row, column = divmod(number, 4)
    apart_m = max(_LINES_APART_M, 1.2 * tool.nominal_width_m)
    corner = place_m + np.array([(column - 1.5) * (_LINE_M + apart_m), (row - 2.0) * apart_m])
    s = np.linspace(0.0, 1.0, 9)
    line = np.column_stack((corner[0] + _LINE_M * s, np.full(9, corner[1]), np.full(9, height_m), np.zeros(9)))
    return timed_path(line, tool.speed_range_m_s[0])


def _masks(path: FloatArray, window_m: FloatArray) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Masks of the window's image: the line's middle, and the pixels that the line cannot reach."""
    shape = image_shape(window_m, _TOUCH_PX_PER_M)
    ends = np.rint(canvas_to_pixel(path[[0, -1], 1:3], window_m, _TOUCH_PX_PER_M)).astype(int)
    drawn = []
    for width_m in (0.001, 0.006):
        mask = np.zeros(shape, np.uint8)
        begin, end = ((int(column), int(row)) for column, row in ends)
        cv2.line(mask, begin, end, (1,), round(width_m * _TOUCH_PX_PER_M))
        drawn.append(mask.astype(bool))
    return drawn[0], ~drawn[1]
