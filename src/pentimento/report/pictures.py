"""Pictures out of photographs: differences and the time-lapse."""

from __future__ import annotations

import io
from collections.abc import Sequence

import cv2
import numpy as np
import PIL.Image
from numpy.typing import NDArray

from pentimento.contracts.colour import linear_to_srgb, srgb_to_linear, to_float

FloatArray = NDArray[np.float64]
Image = NDArray[np.uint8]

_HOLD = 12  # the finished painting stays for as many frames


def difference(predicted: Image, real: Image) -> FloatArray:
    """Root mean squared difference over the channels, sRGB in [0, 1], [H, W] of `predicted`.

    A `real` photograph of another resolution is brought to that of `predicted`, averaging in linear light.
    """
    squared = np.square(to_float(predicted).astype(np.float64) - resized(real, predicted.shape))
    return np.asarray(np.sqrt(squared.mean(axis=-1)))


def resized(image: Image, shape: Sequence[int]) -> FloatArray:
    """An sRGB image as floats [h, w, 3] at `shape` (h, w, ...)."""
    srgb = to_float(image).astype(np.float64)
    if image.shape[:2] == tuple(shape[:2]):
        return srgb
    linear = cv2.resize(srgb_to_linear(srgb), (shape[1], shape[0]), interpolation=cv2.INTER_AREA)
    return linear_to_srgb(np.asarray(linear, dtype=np.float64))


def time_lapse(frames: Sequence[Image], frame_ms: int) -> bytes:
    """An endless GIF of sRGB frames [H, W, 3], holding on the last one.

    All frames share one palette of 256 colours, taken from all of them, so that nothing flickers.
    """
    strip = PIL.Image.fromarray(np.concatenate(list(frames)))
    palette = strip.quantize(256, method=PIL.Image.Quantize.MEDIANCUT)
    pages = [PIL.Image.fromarray(frame).quantize(palette=palette, dither=PIL.Image.Dither.NONE) for frame in frames]
    durations = [frame_ms] * (len(pages) - 1) + [frame_ms * _HOLD]
    data = io.BytesIO()
    pages[0].save(data, "GIF", save_all=True, append_images=pages[1:], duration=durations, loop=0)
    return data.getvalue()
