"""A photograph of a recording sheet as the picture of its canvas: registered, checked, in even light and true colours.

The paper is flat and the lens draws straight lines: one homography, fitted to the corners of eight markers, all of
which must lie where it puts them. Light is smooth over the sheet: a polynomial in x and y, fitted for each channel to
the logarithm of the bare paper. Colours are corrected by the printed chart.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from pentimento.calibration.colour_chart import PATCHES_SRGB, find_colours, true_colours
from pentimento.calibration.observe import (
    CameraCalibration,
    calibrate_camera,
    marker_detector,
    rectify,
)
from pentimento.collection.recording_sheet import (
    CHART_WINDOW_M,
    CODES,
    PAPER_M,
    PRINT_PX_PER_M,
    Recording,
    paper_window,
    sheet_markers,
    sheet_name,
)
from pentimento.contracts.colour import linear_to_srgb, srgb_to_linear, to_float, to_uint8
from pentimento.contracts.errors import CalibrationError
from pentimento.contracts.frames import crop, image_shape, snap_window
from pentimento.contracts.markers import DICTIONARY, MARGIN_M, SIDE_M
from pentimento.contracts.observations import Photo

FloatArray = NDArray[np.float64]
Picture = NDArray[np.uint8]

PIXELS_PER_M: Final = 6000.0
PAPER: Final = 0.88
"""Linear light of paper in the pictures: what white office paper reflects, with room for noise above it."""

_OUTSIDE_M: Final = (MARGIN_M + SIDE_M) / 2 + 0.001
"""Width of the margin that is read around the canvas: to 1 mm beyond the markers' black."""
_MIN_PX_PER_M: Final = 3000.0
_MAX_MISS_M: Final = 2e-4
"""Of a marker's middle. A lens that bends lines misses by up to 1.3 times as much in the canvas."""
_MAX_BLUR_M: Final = 3e-4
_MAX_COLOUR_RESIDUAL: Final = 8.0
"""Mean ΔE2000 of the chart above which the print does not show the chart's colours."""
_DEGREE: Final = 4  # of the polynomial of light
_EVERY: Final = 5  # pixels between samples of the light
_ROUNDS: Final = 8
_BARE: Final = 254  # in the printed sheet
_BRIGHT: Final = 0.5  # below the median logarithm of light: too dark for the first fit, which paper should decide
_NOISE: Final = 0.02  # in the logarithm of the paper's light: no outlier


@dataclass(frozen=True, eq=False)
class SheetPicture:
    """What a photograph shows of a sheet."""

    sheet: int
    """Which one, from 0."""
    canvas: Picture
    """sRGB [H, W, 3] of the canvas at PIXELS_PER_M."""
    calibration: CameraCalibration
    colour_residual: float | None
    """Mean ΔE2000 of the chart after correction; None: the chart was not used, as it is not printed in its colours."""


def read_sheet(frame: Picture, recording: Recording, printed: dict[str, Picture], name: str) -> SheetPicture:
    """The sheet that a photograph [H, W, 3] shows.

    Args:
        printed: the sheets as they were printed, by file name, at PRINT_PX_PER_M.
        name: of the photograph, in messages.

    Raises:
        CalibrationError: the photograph is mirrored, a marker is hidden, the sheet is none of this recording, or the
            photograph is too small, too blurred or too bent.
    """
    photo = Photo(frame, 0.0, 1.0, np.ones(3), 0.0)
    calibration = _registered(photo, recording, name)
    whole = _window(recording)
    try:
        picture = rectify(photo, calibration, whole, PIXELS_PER_M)
    except CalibrationError as error:
        raise CalibrationError(f"{name} cuts off a marker's white edge; show the whole sheet.") from error
    sheet = _sheet_of(picture, recording, name)
    blur_m = _blur_m(picture, recording)
    if blur_m > _MAX_BLUR_M:
        raise CalibrationError(
            f"{name} is blurred: its edges are {1e3 * blur_m:.2f} mm wide (standard deviation) and at most "
            f"{1e3 * _MAX_BLUR_M:.1f} mm are allowed; hold the camera still, focus on the sheet, and use more light."
        )
    even = _in_even_light(picture, _printed(printed[sheet_name(sheet)], recording))
    true, residual = _in_true_colours(even, whole)
    canvas = np.array([0.0, 0.0, *recording.canvas_size_m])
    return SheetPicture(sheet, crop(true, whole, canvas).copy(), calibration, residual)


def _window(recording: Recording) -> FloatArray:
    """The window [4] of the canvas and the markers around it."""
    margin = round(_OUTSIDE_M * PIXELS_PER_M) / PIXELS_PER_M
    return np.array([-margin, -margin, *(np.array(recording.canvas_size_m) + margin)])


def _registered(photo: Photo, recording: Recording, name: str) -> CameraCalibration:
    layout = sheet_markers(recording.canvas_size_m)
    seen = _markers(photo.frame, DICTIONARY)
    missing = sorted(set(layout.ids) - seen.keys())
    mirrored = _markers(photo.frame[:, ::-1], DICTIONARY) if missing else {}
    if len(mirrored.keys() & set(layout.ids)) > len(layout.ids) - len(missing):
        raise CalibrationError(f"{name} is mirrored; switch off the mirroring in the camera's app and take it again.")
    if missing:
        raise CalibrationError(
            f"{name} does not show {len(missing)} of the sheet's {len(layout.ids)} markers ({missing}); take it again "
            "with the whole sheet in view, in focus, and nothing on its black squares."
        )
    try:
        calibration = calibrate_camera(photo, layout)
    except CalibrationError as error:
        raise CalibrationError(f"{name}: {error}") from error
    width, height = recording.canvas_size_m
    around = calibration.to_camera(np.array([[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]]))
    px_per_m = float(np.sqrt(cv2.contourArea(around.astype(np.float32)) / (width * height)))
    if px_per_m < _MIN_PX_PER_M:
        raise CalibrationError(
            f"{name} shows the sheet with {px_per_m / 1e3:.1f} pixels a millimetre and {_MIN_PX_PER_M / 1e3:g} are "
            "needed; go nearer, until the sheet fills the picture, or send the photograph in its full size."
        )
    shown = np.stack([seen[marker] for marker in layout.ids]).mean(axis=1)  # [K, 2], the mean of each one's corners
    expected = calibration.to_camera(layout.corners_m()).mean(axis=1)
    miss_m = float(np.linalg.norm(shown - expected, axis=1).max()) / px_per_m
    if miss_m > _MAX_MISS_M:
        raise CalibrationError(
            f"In {name} the markers miss a flat sheet by {1e3 * miss_m:.2f} mm and at most {1e3 * _MAX_MISS_M:.1f} mm "
            "are allowed; tape the sheet flat to the table, go farther away, and do not use the wide-angle lens."
        )
    return calibration


def _markers(frame: Picture, dictionary: str) -> dict[int, FloatArray]:
    """Corners [4, 2] (column, row) of the markers of a dictionary that a picture shows, by their ids."""
    grey = cv2.cvtColor(np.ascontiguousarray(frame), cv2.COLOR_RGB2GRAY)
    corners, ids, _ = marker_detector(dictionary).detectMarkers(grey)
    if len(corners) == 0:  # then ids is None
        return {}
    return {int(marker): np.asarray(at[0], dtype=np.float64) for marker, at in zip(ids.ravel(), corners, strict=True)}


def _sheet_of(picture: Picture, recording: Recording, name: str) -> int:
    codes = sorted(_markers(picture, CODES))
    if len(codes) != 1:
        raise CalibrationError(
            f"{name} shows {len(codes)} codes of a sheet and one is needed; uncover the code beside the lower edge."
        )
    sheet = recording.sheet_of(codes[0])
    if sheet is None:
        raise CalibrationError(
            f"{name} shows a sheet of another recording (code {codes[0]}; this one has {recording.code} and "
            f"{recording.sheets - 1} more); give the folder from which it was printed."
        )
    return sheet


def _blur_m(picture: Picture, recording: Recording) -> float:
    """Standard deviation of the blur: the median over the markers' four edges, each averaged along the edge.

    A step of height h, blurred by a Gaussian of standard deviation s, has the largest slope h / (s sqrt(2 pi)).
    """
    linear = srgb_to_linear(to_float(picture)).mean(axis=2)
    whole, layout = _window(recording), sheet_markers(recording.canvas_size_m)
    half, reach = layout.side_m / 2, 0.0015
    found = []
    for x, y in layout.centres_m:
        for dx, dy in ((1, 0), (-1, 0), (0, 1), (0, -1)):
            edge = np.array([x + dx * half, y + dy * half])
            along = np.array([reach, half / 2]) if dx else np.array([half / 2, reach])
            low, high = np.maximum(edge - along, whole[:2]), np.minimum(edge + along, whole[2:])
            around = snap_window(np.concatenate([low, high]), whole, linear.shape)
            profile = crop(linear, whole, around).mean(axis=0 if dx else 1)
            steepest = float(np.abs(np.diff(profile)).max()) * PIXELS_PER_M
            found.append((profile.max() - profile.min()) / (steepest * np.sqrt(2 * np.pi)))
    return float(np.median(found))


def _printed(sheet: Picture, recording: Recording) -> Picture:
    """The printed sheet in the window of the photograph, at its scale."""
    paper, whole = paper_window(recording.canvas_size_m), _window(recording)
    scale = PIXELS_PER_M / PRINT_PX_PER_M
    height, width = image_shape(np.array([0.0, 0.0, *PAPER_M]), PIXELS_PER_M)
    assert scale * sheet.shape[0] == height
    small = np.asarray(cv2.resize(sheet, (width, height), interpolation=cv2.INTER_AREA), dtype=np.uint8)
    return crop(small, paper, whole)


def _in_even_light(picture: Picture, printed: Picture) -> Picture:
    """A picture sRGB [H, W, 3] whose bare paper has the linear light PAPER all over.

    Paint makes the paper darker, so what is darker than the fit is left out of the next one.
    """
    height, width = picture.shape[:2]
    bare = cv2.erode((printed.min(axis=2) >= _BARE).astype(np.uint8), np.ones((9, 9), np.uint8)) > 0
    linear = srgb_to_linear(to_float(picture))
    across, down = (np.vander(np.linspace(-1, 1, side), _DEGREE + 1, increasing=True) for side in (width, height))
    some = slice(None, None, _EVERY)
    used = bare[some, some]
    powers = [(i, j) for i in range(_DEGREE + 1) for j in range(_DEGREE + 1 - i)]  # up to the total degree
    terms = np.stack([np.outer(down[some, j], across[some, i])[used] for i, j in powers], axis=1)  # [N, K]
    seen = np.log(np.maximum(linear[some, some][used], 1e-3)).astype(np.float64)  # [N, 3]
    bright = seen.mean(axis=1)
    kept = bright >= np.median(bright) - _BRIGHT
    for _ in range(_ROUNDS):
        fit, *_ = np.linalg.lstsq(terms[kept], seen[kept], rcond=None)  # [K, 3]
        miss = (seen - terms @ fit).mean(axis=1)
        kept = np.abs(miss) < max(_NOISE, 4 * float(np.median(np.abs(miss[kept]))))
    factors = np.zeros((_DEGREE + 1, _DEGREE + 1, 3))  # of power j of y and i of x
    for (i, j), factor in zip(powers, fit, strict=True):
        factors[j, i] = factor
    light = np.stack([np.exp(down @ factors[..., channel] @ across.T) for channel in range(3)], axis=-1)
    return to_uint8(linear_to_srgb(np.clip(PAPER * linear / light.astype(np.float32), 0.0, 1.0)))


def _in_true_colours(even: Picture, whole: FloatArray) -> tuple[Picture, float | None]:
    """The picture with the chart's true colours, and the residual; unchanged and None where the chart is not coloured.

    The printed inks lie on paper: the chart's colours are those of the file times what the paper reflects.
    """
    chart = crop(even, whole, snap_window(CHART_WINDOW_M, whole, even.shape))
    true = linear_to_srgb(PAPER * srgb_to_linear(PATCHES_SRGB))
    try:
        colours = find_colours(chart, true)
    except CalibrationError:  # a chart in black and white fixes no colours
        return even, None
    if colours.residual > _MAX_COLOUR_RESIDUAL:
        return even, None
    return true_colours(even, colours), colours.residual
