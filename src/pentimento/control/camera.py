"""Observing the canvas while painting, with checks that reject photographs which cannot be trusted.

A photograph is rejected where it is blank or equals the last one, where the markers have moved, and where much has
changed that no stroke explains: a hand in the picture, or a sheet that has slid.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from pentimento.calibration.observe import CameraCalibration, calibrate_camera, rectify
from pentimento.contracts.colour import srgb_to_linear, to_float
from pentimento.contracts.errors import CalibrationError, PentimentoError
from pentimento.contracts.frames import canvas_to_pixel
from pentimento.contracts.markers import MarkerLayout, markers_around
from pentimento.contracts.observations import Photo
from pentimento.robots.driver import Robot

FloatArray = NDArray[np.float64]
Mask = NDArray[np.bool_]
Picture = NDArray[np.uint8]

PATIENCE_S = 60.0
"""A hand may stay in the picture for this time before the painting is stopped."""

_TRIES = 3
"""Photographs that are tried before an observation fails."""
_RETRY_S = 1.0
"""Time between two of them."""
_BLANK = 4.0  # standard deviation of a frame's values, of 255: markers alone give several times as much
_MOVED_M = 1e-3
_CELL_M = 3e-3
_CHANGED = 0.08  # of a cell's mean, sRGB
_MAX_UNEXPLAINED = 0.02  # of the canvas
_MARGIN_M = 4e-3  # paint may run this far beyond a stroke's edge
_SLID_M = 1.5e-3
_RESIDUAL = 0.3  # of the change may be left when a sheet that has slid is shifted back
_FAINT = 0.02
"""Root of the summed squares of a predicted change, over that of one pixel from white to black: below, the camera's
noise dominates."""
_MIN_PIXELS = 6
"""A visible share needs at least this many pixels that are predicted to change."""

Kind = Literal["camera", "moved", "slid", "hand", "no mark"]


class PaintingFault(PentimentoError):
    """The painting cannot go on without a person. The tool is up; the state is on disk."""

    def __init__(self, kind: Kind, message: str) -> None:
        super().__init__(message)
        self.kind = kind


@dataclass(frozen=True, eq=False)
class Observation:
    """One look at the canvas."""

    photo: Photo
    picture: Picture
    """[H, W, 3] sRGB of the whole canvas."""


class Camera:
    """A camera over the canvas, and its last photograph."""

    def __init__(
        self,
        robot: Robot,
        size_m: tuple[float, float],
        pixels_per_m: float,
        *,
        calibrated: CameraCalibration | None = None,
    ) -> None:
        """Calibrate the camera by the markers around the robot's canvas.

        Args:
            size_m: of the canvas's lower left part that is observed.
            calibrated: where the markers were when the rig was calibrated, if it was: they must still be there.

        Raises:
            PaintingFault: no photograph shows the markers, or they have moved.
        """
        self._robot, self._size_m, self._pixels_per_m = robot, size_m, pixels_per_m
        self._layout: MarkerLayout = markers_around(robot.canvas_size_m)
        self._last: Photo | None = None
        photo = self._photo()
        try:
            self.calibration: CameraCalibration = calibrate_camera(photo, self._layout)
        except CalibrationError as error:
            raise PaintingFault("camera", f"The canvas cannot be found in the camera's picture. {error}") from error
        shift_m = 0.0 if calibrated is None else marker_shift_m(photo, calibrated, self._layout)
        if shift_m is not None and shift_m > _MOVED_M:
            raise PaintingFault(
                "moved",
                f"The camera or the canvas has moved by {1000 * shift_m:.1f} mm since it was calibrated; put it back, "
                "or calibrate the canvas again.",
            )

    def observe(self) -> Observation:
        """The canvas as it is now, whatever is on it: at the start, and after a person's turn.

        Raises:
            PaintingFault: the photograph is blank, the same as before, or the camera was moved.
        """
        photo = self._photo()
        shift_m = marker_shift_m(photo, self.calibration, self._layout)
        if shift_m is None or shift_m > _MOVED_M:
            photo = self._photo_with_markers(photo)
        window = (0.0, 0.0, *self._size_m)
        return Observation(photo, rectify(photo, self.calibration, window, self._pixels_per_m))

    def observe_strokes(self, before: Picture, paths: Sequence[FloatArray], width_m: float) -> Observation:
        """The canvas after strokes along paths [N, 5] of about this width were painted on ``before`` [H, W, 3].

        Waits where more has changed than the strokes explain.

        Raises:
            PaintingFault: as ``observe``; the sheet has slid; or something stays in the picture.
        """
        explained = stroke_mask(paths, width_m, before.shape[:2], self._size_m)
        waited_s = 0.0
        while True:
            seen = self.observe()
            share = unexplained_share(before, seen.picture, explained, self._size_m)
            if share * 10 > _MAX_UNEXPLAINED:
                slid_m = sheet_shift_m(before, seen.picture, explained, self._pixels_per_m)
                if slid_m is not None and slid_m > _SLID_M:
                    raise PaintingFault(
                        "slid",
                        f"The sheet has slid by about {1000 * slid_m:.1f} mm under the tool; lay it back or leave it, "
                        "fix it, and resume: the rest is planned on what the camera sees then.",
                    )
            if share <= _MAX_UNEXPLAINED:
                return seen
            if waited_s >= PATIENCE_S:
                raise PaintingFault(
                    "hand",
                    f"Something covers {share:.0%} of the canvas since {waited_s:.0f} s that no stroke explains; take "
                    "your hand away, or leave what you have painted, and resume.",
                )
            self._robot.wait(_RETRY_S)
            waited_s += _RETRY_S

    def _photo(self) -> Photo:
        """A photograph that is neither blank nor the last one."""
        for tries in range(_TRIES):
            photo = self._robot.photo()
            if not is_blank(photo) and not is_frozen(photo, self._last):
                self._last = photo
                return photo
            if tries + 1 < _TRIES:
                self._robot.wait(_RETRY_S)
        if is_blank(photo):
            raise PaintingFault(
                "camera",
                "The camera's picture shows nothing: black, or of one colour; see to its light, its lens cap and its "
                "cable, and resume.",
            )
        raise PaintingFault("camera", "The camera repeats the same picture; reconnect it, and resume.")

    def _photo_with_markers(self, photo: Photo) -> Photo:
        """Another photograph, with the markers in place; waits while a hand covers them."""
        waited_s, shift_m = 0.0, marker_shift_m(photo, self.calibration, self._layout)
        while shift_m is None and waited_s < PATIENCE_S:
            self._robot.wait(_RETRY_S)
            waited_s += _RETRY_S
            photo = self._photo()
            shift_m = marker_shift_m(photo, self.calibration, self._layout)
        if shift_m is None:
            raise PaintingFault(
                "hand", "The camera sees fewer than 4 markers around the canvas; uncover them, and resume."
            )
        if shift_m > _MOVED_M:
            raise PaintingFault(
                "moved",
                f"The camera or the canvas has moved: the markers lie {1000 * shift_m:.1f} mm from where they were. If "
                "it was the canvas, put it back where the robot was calibrated; then resume.",
            )
        return photo


def is_blank(photo: Photo) -> bool:
    """Whether a frame shows nothing: black, white, or a lens cap."""
    return float(photo.frame[::4, ::4].std()) < _BLANK


def is_frozen(photo: Photo, last: Photo | None) -> bool:
    """Whether a frame equals the last one to the bit, which a sensor's noise excludes."""
    return last is not None and bool(np.array_equal(photo.frame, last.frame))


def marker_shift_m(photo: Photo, calibration: CameraCalibration, layout: MarkerLayout) -> float | None:
    """Median shift of the markers since the calibration, on the canvas; None where fewer than 4 are seen."""
    try:
        now = calibrate_camera(photo, layout)
    except CalibrationError:
        return None
    corners_m = layout.corners_m().reshape(-1, 2)
    moved_px = np.linalg.norm(now.to_camera(corners_m) - calibration.to_camera(corners_m), axis=1)
    centre = corners_m.mean(axis=0)
    step_m = np.array([[-0.005, 0.0], [0.005, 0.0]])
    px_per_m = np.linalg.norm(np.diff(calibration.to_camera(centre + step_m), axis=0)) / 0.01
    return float(np.median(moved_px) / px_per_m)


def stroke_mask(
    paths: Sequence[FloatArray], width_m: float, shape: tuple[int, int], canvas_size_m: tuple[float, float]
) -> Mask:
    """[H, W]: the pixels that strokes along paths [N, 5] may have changed."""
    mask = np.zeros(shape, np.uint8)
    scale = shape[1] / canvas_size_m[0]
    for path in paths:
        fixed = np.rint(canvas_to_pixel(path[:, 1:3], (0.0, 0.0, *canvas_size_m), scale)).astype(np.int32)
        cv2.polylines(mask, [fixed.reshape(-1, 1, 2)], False, (1,), max(round((width_m + 2 * _MARGIN_M) * scale), 1))
    return mask.astype(bool)


def unexplained_share(before: Picture, now: Picture, explained: Mask, canvas_size_m: tuple[float, float]) -> float:
    """Share of the canvas's cells that changed outside ``explained`` [H, W]. A change of light as a whole is none."""
    free = (~explained).astype(np.float32)
    difference = (to_float(now) - to_float(before)) * free[..., None]
    columns, rows = (max(round(length / _CELL_M), 1) for length in canvas_size_m)
    weight = cv2.resize(free, (columns, rows), interpolation=cv2.INTER_AREA)
    cells = cv2.resize(difference, (columns, rows), interpolation=cv2.INTER_AREA)
    compared = weight > 0.5
    if not compared.any():
        return 0.0
    change = cells[compared] / weight[compared, None]
    change = change - np.median(change, axis=0)
    return float((np.abs(change).max(axis=1) > _CHANGED).sum() / (rows * columns))


def sheet_shift_m(before: Picture, now: Picture, explained: Mask, pixels_per_m: float) -> float | None:
    """Distance by which the sheet has slid; None where a shift does not explain what has changed."""
    dark = [np.where(explained, 0, 1 - to_float(picture).mean(axis=2)).astype(np.float32) for picture in (before, now)]
    window = cv2.createHanningWindow((before.shape[1], before.shape[0]), cv2.CV_32F)
    (columns, rows), _ = cv2.phaseCorrelate(dark[0], dark[1], window)
    back = cv2.warpAffine(
        dark[1], np.array([[1, 0, -columns], [0, 1, -rows]], np.float32), (before.shape[1], before.shape[0]),
        borderMode=cv2.BORDER_REPLICATE,
    )  # fmt: skip
    changed, residual = (float(np.square(image - dark[0])[~explained].sum()) for image in (dark[1], back))
    if residual > _RESIDUAL * changed:
        return None
    return float(np.hypot(columns, rows) / pixels_per_m)


def visible_share(before: Picture, now: Picture, predicted: NDArray[np.float32]) -> float | None:
    """The share of a predicted change that a picture shows: about 1 where it happened, 0 where nothing did.

    This is the least-squares factor c of now − before = c · (predicted − before), in linear light. The median change
    of the pixels without a predicted change is subtracted first, because the light may change as a whole.

    Args:
        before, now: uint8 sRGB [H, W, 3].
        predicted: [H, W, 3] linear light, from ``before``.

    Returns:
        None where the predicted change is too small to tell.
    """
    start = srgb_to_linear(to_float(before))
    expected = predicted - start
    where = np.abs(expected).max(axis=2) > _FAINT
    if where.sum() < _MIN_PIXELS:
        return None
    change = srgb_to_linear(to_float(now)) - start
    if not where.all():
        change = change - np.median(change[~where], axis=0)
    return float((change[where] * expected[where]).sum() / np.square(expected[where]).sum())


def visible_mark(before: Picture, now: Picture, predicted: NDArray[np.float32], *, pixels: float) -> float | None:
    """`visible_share` of what a stroke was predicted to darken; None where that is less than a number of pixels.

    Light paint may vanish in wet dark paint, so only what gets darker tells that the tool gives paint. A stroke that
    mostly lies on dark paint darkens only its rim, and a brush that lags misses it.
    """
    start = srgb_to_linear(to_float(before))
    darker = np.minimum(predicted, start)
    if (np.abs(darker - start).max(axis=2) > _FAINT).sum() < pixels:
        return None
    return visible_share(before, now, darker)
