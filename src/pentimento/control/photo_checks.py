"""Looking at the canvas while painting, and not believing every picture.

A photograph is refused where it shows nothing or is the last one again, where the markers are not where they were, and
where much has changed that no stroke explains: a hand, or a sheet that has slid.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pentimento.calibration.observe import CameraCalibration, calibrate_camera, rectify
from pentimento.contracts.colour import to_float
from pentimento.contracts.errors import CalibrationError
from pentimento.contracts.frames import canvas_to_pixel
from pentimento.contracts.markers import MarkerLayout, markers_around
from pentimento.contracts.photo import Photo
from pentimento.control.faults import PaintingFault
from pentimento.robots.driver import Robot

FloatArray = NDArray[np.float64]
Picture = NDArray[np.uint8]

PATIENCE_S = 60.0
"""So long a hand may stay in the picture before the painting is stopped."""

_TRIES, _AGAIN_S = 3, 1.0
_SHOWS_NOTHING = 4.0  # standard deviation of a frame's values, of 255: markers alone make several times as much
_MOVED_M = 1e-3
_CELL_M = 3e-3
_CHANGED = 0.08  # of a cell's mean, sRGB
_MUCH = 0.02  # of the canvas
_BESIDE_M = 4e-3  # of a stroke's edge: where its paint may still run
_SLID_M = 1.5e-3
_FOUND = 0.3  # of what changed is left when a sheet that has slid is laid back


@dataclass(frozen=True, eq=False)
class Look:
    """One look at the canvas."""

    photo: Photo
    picture: Picture
    """[H, W, 3] sRGB of the whole canvas."""


class Eyes:
    """A camera over the canvas, and what it saw last."""

    def __init__(
        self,
        robot: Robot,
        size_m: tuple[float, float],
        pixels_per_m: float,
        calibrated: CameraCalibration | None = None,
    ) -> None:
        """Find the camera by the markers round the robot's canvas, to look at its lower left part of ``size_m``.

        Args:
            calibrated: where the markers were when the rig was calibrated, if it was: there they must be still.

        Raises:
            PaintingFault: no picture that shows them, or they have moved.
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
                "or calibrate the canvas anew.",
            )

    def look(self) -> Look:
        """The canvas as it is now, whatever is on it: at the start, and after a person's turn.

        Raises:
            PaintingFault: the camera shows nothing, shows the same again, or was moved.
        """
        photo = self._photo()
        shift_m = marker_shift_m(photo, self.calibration, self._layout)
        if shift_m is None or shift_m > _MOVED_M:
            photo = self._again(photo)
        window = (0.0, 0.0, *self._size_m)
        return Look(photo, rectify(photo, self.calibration, window, self._pixels_per_m))

    def look_after(self, before: Picture, paths: Sequence[FloatArray], width_m: float) -> Look:
        """The canvas after strokes of these paths [N, 5] and about this width were laid on ``before``.

        Where more has changed, waits for it to go away.

        Raises:
            PaintingFault: as ``look``; the sheet has slid; or something stays in the picture.
        """
        explained = explained_by(paths, width_m, before.shape[:2], self._size_m)
        waited_s = 0.0
        while True:
            seen = self.look()
            share = unexplained(before, seen.picture, explained, self._size_m)
            if share * 10 > _MUCH:
                slid_m = slide_m(before, seen.picture, explained, self._pixels_per_m)
                if slid_m is not None and slid_m > _SLID_M:
                    raise PaintingFault(
                        "slid",
                        f"The sheet has slid by about {1000 * slid_m:.1f} mm under the tool; lay it back or leave it, "
                        "fix it, and resume: the rest is planned on what the camera sees then.",
                    )
            if share <= _MUCH:
                return seen
            if waited_s >= PATIENCE_S:
                raise PaintingFault(
                    "hand",
                    f"Something covers {share:.0%} of the canvas since {waited_s:.0f} s that no stroke explains; take "
                    "your hand away, or leave what you have painted, and resume.",
                )
            self._robot.wait(_AGAIN_S)
            waited_s += _AGAIN_S

    def _photo(self) -> Photo:
        """A photograph that shows something new."""
        for tries in range(_TRIES):
            photo = self._robot.photo()
            if not is_blind(photo) and not is_frozen(photo, self._last):
                self._last = photo
                return photo
            if tries + 1 < _TRIES:
                self._robot.wait(_AGAIN_S)
        if is_blind(photo):
            raise PaintingFault(
                "camera",
                "The camera's picture shows nothing: black, or of one colour; see to its light, its lens cap and its "
                "cable, and resume.",
            )
        raise PaintingFault("camera", "The camera gives the same picture again and again; connect it anew, and resume.")

    def _again(self, photo: Photo) -> Photo:
        """Another photograph, with the markers where they were: they may have been covered, by a hand."""
        waited_s, shift_m = 0.0, marker_shift_m(photo, self.calibration, self._layout)
        while shift_m is None and waited_s < PATIENCE_S:
            self._robot.wait(_AGAIN_S)
            waited_s += _AGAIN_S
            photo = self._photo()
            shift_m = marker_shift_m(photo, self.calibration, self._layout)
        if shift_m is None:
            raise PaintingFault(
                "hand", "The camera sees fewer than 4 markers round the canvas; uncover them, and resume."
            )
        if shift_m > _MOVED_M:
            raise PaintingFault(
                "moved",
                f"The camera or the canvas has moved: the markers lie {1000 * shift_m:.1f} mm from where they were. If "
                "it was the canvas, put it back where the robot was calibrated; then resume.",
            )
        return photo


def is_blind(photo: Photo) -> bool:
    """Whether a frame shows nothing: black, white, or a lens cap."""
    return float(photo.frame[::4, ::4].std()) < _SHOWS_NOTHING


def is_frozen(photo: Photo, last: Photo | None) -> bool:
    """Whether a frame is the last one to the bit, which a sensor's noise forbids."""
    return last is not None and bool(np.array_equal(photo.frame, last.frame))


def marker_shift_m(photo: Photo, calibration: CameraCalibration, layout: MarkerLayout) -> float | None:
    """By how much the markers have moved since the calibration, on the canvas; None where fewer than 4 are seen."""
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


def explained_by(
    paths: Sequence[FloatArray], width_m: float, shape: tuple[int, int], canvas_size_m: tuple[float, float]
) -> NDArray[np.bool_]:
    """[H, W] where strokes along paths [N, 5] may have changed the canvas."""
    mask = np.zeros(shape, np.uint8)
    scale = shape[1] / canvas_size_m[0]
    for path in paths:
        fixed = np.rint(canvas_to_pixel(path[:, 1:3], (0.0, 0.0, *canvas_size_m), scale)).astype(np.int32)
        cv2.polylines(mask, [fixed.reshape(-1, 1, 2)], False, (1,), max(round((width_m + 2 * _BESIDE_M) * scale), 1))
    return mask.astype(bool)


def unexplained(
    before: Picture, now: Picture, explained: NDArray[np.bool_], canvas_size_m: tuple[float, float]
) -> float:
    """Share of the canvas that has changed, cell by cell, where nothing explains it. Light may change as a whole."""
    free = (~explained).astype(np.float32)
    difference = (to_float(now) - to_float(before)) * free[..., None]
    columns, rows = (max(round(length / _CELL_M), 1) for length in canvas_size_m)
    weight = cv2.resize(free, (columns, rows), interpolation=cv2.INTER_AREA)
    cells = cv2.resize(difference, (columns, rows), interpolation=cv2.INTER_AREA)
    judged = weight > 0.5
    if not judged.any():
        return 0.0
    change = cells[judged] / weight[judged, None]
    change = change - np.median(change, axis=0)
    return float((np.abs(change).max(axis=1) > _CHANGED).sum() / (rows * columns))


def slide_m(before: Picture, now: Picture, explained: NDArray[np.bool_], pixels_per_m: float) -> float | None:
    """By how much what was on the sheet has slid; None where a slide does not explain what has changed."""
    dark = [np.where(explained, 0, 1 - to_float(picture).mean(axis=2)).astype(np.float32) for picture in (before, now)]
    window = cv2.createHanningWindow((before.shape[1], before.shape[0]), cv2.CV_32F)
    (columns, rows), _ = cv2.phaseCorrelate(dark[0], dark[1], window)
    back = cv2.warpAffine(
        dark[1], np.array([[1, 0, -columns], [0, 1, -rows]], np.float32), (before.shape[1], before.shape[0]),
        borderMode=cv2.BORDER_REPLICATE,
    )  # fmt: skip
    apart, laid_back = (float(np.square(image - dark[0])[~explained].sum()) for image in (dark[1], back))
    if laid_back > _FOUND * apart:
        return None
    return float(np.hypot(columns, rows) / pixels_per_m)
