"""The target picture: a photograph from a file or by name, fitted to the canvas and, for a pen, to its tones."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.colour import linear_to_srgb, srgb_to_linear, to_float
from pentimento.contracts.errors import ImageError
from pentimento.contracts.images import read_image

FloatArray = NDArray[np.float64]

PHOTOGRAPHS = ("astronaut", "chelsea", "coffee", "rocket", "retina")
"""Photographs that scikit-image ships inside its wheel."""
_LIGHT = srgb_to_linear(to_float(np.arange(256, dtype=np.uint8)).astype(np.float64))
"""Linear light of each of the 256 levels."""
_BAND = 128
"""Rows of a picture that are averaged at a time."""


def load_photograph(name_or_path: str) -> NDArray[np.uint8]:
    """RGB [H, W, 3] of a file, or of one of ``PHOTOGRAPHS``.

    Raises:
        ImageError: the name is unknown and no readable file, or scikit-image is not installed.
    """
    if name_or_path in PHOTOGRAPHS:
        return read_image(next(_samples().glob(f"{name_or_path}.*")))
    if not Path(name_or_path).is_file():
        raise ImageError(
            f"There is no photograph {name_or_path!r}: give the path of an image file or one of "
            f"{', '.join(PHOTOGRAPHS)}."
        )
    return read_image(Path(name_or_path))


def _samples() -> Path:
    """The folder of scikit-image's photographs. The lean core is installed without scikit-image."""
    found = find_spec("skimage")
    if found is None or found.origin is None:
        raise ImageError(
            f"The photographs {', '.join(PHOTOGRAPHS)} come with scikit-image, which is not installed: install "
            "pentimento[train], or give the path of an image file."
        )
    return Path(found.origin).parent / "data"


@dataclass(frozen=True)
class Part:
    """A rectangle of a picture, from its upper left corner, in shares of its width and height."""

    left: float
    top: float
    right: float
    bottom: float

    def __post_init__(self) -> None:
        if not (0 <= self.left < self.right <= 1 and 0 <= self.top < self.bottom <= 1):
            raise ValueError(
                f"left, top, right, bottom are {self.left}, {self.top}, {self.right}, {self.bottom}; they are shares "
                "from 0 to 1, with left below right and top below bottom."
            )

    def of(self, photo: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """The part [H', W', 3] of a picture [H, W, 3]; at least one pixel."""
        (top, bottom), (left, right) = (
            (min(int(start * size), size - 1), max(round(end * size), int(start * size) + 1))
            for start, end, size in (
                (self.top, self.bottom, photo.shape[0]),
                (self.left, self.right, photo.shape[1]),
            )
        )
        return np.ascontiguousarray(photo[top:bottom, left:right])


def fit_to_canvas(photo: NDArray[np.uint8], shape: tuple[int, int]) -> FloatArray:
    """The largest centred part of the photograph with the canvas's proportions, linear light [H, W, 3] at ``shape``."""
    height, width = shape
    scale = max(height / photo.shape[0], width / photo.shape[1])
    crop_h, crop_w = round(height / scale), round(width / scale)
    top, left = (photo.shape[0] - crop_h) // 2, (photo.shape[1] - crop_w) // 2
    part = photo[top : top + crop_h, left : left + crop_w]
    if crop_h >= height:
        return np.clip(averaged_light(part, shape), 0.0, 1.0)
    return np.clip(cv2.resize(_LIGHT[part], (width, height), interpolation=cv2.INTER_CUBIC), 0.0, 1.0)


def averaged_light(photo: NDArray[np.uint8], shape: tuple[int, int]) -> FloatArray:
    """Linear light [h, w, 3] of a picture, sRGB [H, W, 3], averaged down to ``shape``, at most its own.

    It is done in bands of rows, because floating point takes eight times the memory of a photograph.
    """
    height, width = shape
    narrow = np.empty((len(photo), width, 3))
    for start in range(0, len(photo), _BAND):
        band = _LIGHT[photo[start : start + _BAND]]
        narrow[start : start + _BAND] = cv2.resize(band, (width, len(band)), interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.resize(narrow, (width, height), interpolation=cv2.INTER_AREA))


def fit_to_ink(target: FloatArray, darkest: float) -> FloatArray:
    """Grey tones that a pen can reach, linear light [H, W, 3].

    A pen cannot fill a dark photograph with a few hundred lines. The picture's lightness (the sRGB curve of its
    luminance) from the 2nd to the 98th percentile is mapped to ``darkest`` (0 to 1) up to white. A picture of one tone
    keeps it.
    """
    luminance = target @ np.array([0.2126, 0.7152, 0.0722])
    lightness = linear_to_srgb(np.clip(luminance, 0.0, 1.0))
    low, high = np.percentile(lightness, [2, 98])
    stretched = np.clip((lightness - low) / (high - low), 0.0, 1.0) if high - low > 1e-3 else lightness
    tones = srgb_to_linear(darkest + (1 - darkest) * stretched)
    return np.repeat(tones[..., None], 3, axis=-1)
