"""Colour calibration: a map fitted on a printed chart, and its correction of images.

In linear light a camera's colours are close to an affine map of the true ones: a matrix for filters, white balance and
exposure, an offset for stray light.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.colour import (
    delta_e_2000,
    linear_to_srgb,
    srgb_to_lab,
    srgb_to_linear,
    to_float,
    to_uint8,
)
from pentimento.contracts.errors import CalibrationError

FloatArray = NDArray[np.float64]
Image = NDArray[np.uint8]

COLUMNS, ROWS = 6, 5
_LEVELS = (0.15, 0.5, 0.85)
_INNER = 0.5  # share of a patch's sides that is looked at, about its middle
_CLIPPED = (1.5 / 255, 253.5 / 255)
_MIN_PATCHES = 12


def _patches() -> FloatArray:
    """[30, 3] sRGB: every mixture of three levels a channel, and three more greys; neighbours differ."""
    mixtures = np.array([[r, g, b] for r in _LEVELS for g in _LEVELS for b in _LEVELS])
    patches = np.concatenate((mixtures, [[0.3] * 3, [0.65] * 3, [0.95] * 3]))
    order = (np.arange(len(patches)) * 11) % len(patches)
    shuffled: FloatArray = patches[order]
    return shuffled


PATCHES_SRGB: Final = _patches()
"""[30, 3] sRGB of the chart, row by row from the top left."""


@dataclass(frozen=True, eq=False)
class ColourMap:
    """True linear light = matrix @ seen linear light + offset."""

    matrix: FloatArray
    """[3, 3]."""
    offset: FloatArray
    """[3]."""
    residual: float
    """Mean ΔE2000 of the chart's patches after the correction."""


def chart_image(pixels_per_patch: int) -> Image:
    """The chart to print, sRGB [H, W, 3]."""
    chart = to_uint8(PATCHES_SRGB.reshape(ROWS, COLUMNS, 3))
    return np.repeat(np.repeat(chart, pixels_per_patch, axis=0), pixels_per_patch, axis=1)


def patch_means(image: Image) -> FloatArray:
    """[30, 3]: mean linear light of the middle of each patch, of an image sRGB [H, W, 3] that the chart fills."""
    height, width = image.shape[:2]
    linear = srgb_to_linear(to_float(image).astype(np.float64))
    means = np.empty((ROWS * COLUMNS, 3))
    for index in range(len(means)):
        row, column = divmod(index, COLUMNS)
        rows = slice(*_middle(row, ROWS, height))
        columns = slice(*_middle(column, COLUMNS, width))
        means[index] = linear[rows, columns].reshape(-1, 3).mean(axis=0)
    return means


def find_colours(image: Image, true_srgb: FloatArray = PATCHES_SRGB) -> ColourMap:
    """The map from the chart's photographed colours to its true ones, by least squares on the patches.

    `image` is sRGB [H, W, 3], rectified so that the chart fills it. `true_srgb` [30, 3]: colours measured on the
    print, if they were measured. Patches at either end of the sensor's range are left out.

    Raises CalibrationError if fewer than twelve patches are left, or the chart lies wrong.
    """
    seen = patch_means(image)
    seen_srgb = linear_to_srgb(seen)
    usable = np.all((seen_srgb > _CLIPPED[0]) & (seen_srgb < _CLIPPED[1]), axis=1)
    if usable.sum() < _MIN_PATCHES:
        raise CalibrationError(
            f"{usable.sum()} of the chart's {len(seen)} patches are neither black nor burnt out and {_MIN_PATCHES} are "
            "needed; change the exposure or the light."
        )
    true = srgb_to_linear(np.asarray(true_srgb, dtype=np.float64))
    design = np.column_stack((seen, np.ones(len(seen))))[usable]
    # Errors of dark patches are more visible than those of bright ones: weights follow the slope of sRGB.
    weight = 1 / (0.05 + true[usable].mean(axis=1, keepdims=True))
    solution, *_ = np.linalg.lstsq(design * weight, true[usable] * weight, rcond=None)  # [4, 3]
    found = ColourMap(solution[:3].T, solution[3], 0.0)
    if np.linalg.matrix_rank(found.matrix) < 3 or np.any(np.diag(found.matrix) <= 0):
        raise CalibrationError("The colours seen do not follow the chart's; check that the chart lies upright.")
    corrected = np.clip(linear_to_srgb(seen[usable] @ found.matrix.T + found.offset), 0, 1)
    error = delta_e_2000(srgb_to_lab(corrected), srgb_to_lab(np.asarray(true_srgb)[usable]))
    return ColourMap(found.matrix, found.offset, float(error.mean()))


def true_colours(image: Image, colours: ColourMap) -> Image:
    """An image sRGB [..., 3] with corrected colours, clipped to sRGB."""
    linear = srgb_to_linear(to_float(image).astype(np.float64))
    corrected = linear @ colours.matrix.T + colours.offset
    return to_uint8(linear_to_srgb(np.clip(corrected, 0.0, 1.0)))


def _middle(index: int, count: int, size_px: int) -> tuple[int, int]:
    centre, half = (index + 0.5) / count * size_px, 0.5 * _INNER / count * size_px
    return round(centre - half), round(centre + half)
