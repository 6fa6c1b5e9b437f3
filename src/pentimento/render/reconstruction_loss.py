"""Reconstruction loss between an image and a target, and its gradient, compiled for use at each iteration of a plan.

A viewing distance is modelled by averaging linear light over squares before the comparison in sRGB. Images are
[H, W, 3] in linear light. Squares of ``distance`` pixels overlap by half. Incomplete squares at the edge are left out.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pentimento.render.coverage import compiled
from pentimento.render.errors import RenderInputError
from pentimento.render.fastmath import exp2, log2

Array = NDArray[Any]

_CHUNK = 1024
_KNEE = 0.0031308


def seen(image: Array, distance: int) -> Array:
    """Light averaged over squares, float[h, w, 3]."""
    return image if distance == 1 else _averaged(image, distance)


def srgb_of(light: Array) -> Array:
    """SRGB of linear light, of the same shape and precision (IEC 61966-2-1)."""
    return _srgb(np.ascontiguousarray(light).reshape(-1)).reshape(light.shape)


def squared_error(image: Array, target_srgb: Array, distance: int, gradient: Array, weight: float) -> float:
    """Mean squared difference in sRGB between ``image``, seen from a distance, and ``target_srgb`` [h, w, 3].

    ``weight`` times its gradient is added to ``gradient`` [H, W, 3].

    Raises:
        RenderInputError: image and target differ in size; compiled code would read out of bounds.
    """
    light = seen(image, distance)
    if light.shape != target_srgb.shape or gradient.shape != image.shape:
        raise RenderInputError(
            f"An image of {image.shape} shows {light.shape} from {distance} px, but the target shows "
            f"{target_srgb.shape}: give both the same size."
        )
    slope = np.empty(light.size, light.dtype)
    total = _compare(np.ascontiguousarray(light).reshape(-1), target_srgb.reshape(-1), slope)
    slope = (slope * image.dtype.type(weight / slope.size)).reshape(light.shape)
    if distance == 1:
        gradient += slope
    else:
        _spread(slope, distance, gradient)
    return float(total) / target_srgb.size


@compiled
def _srgb(light: Array) -> Array:
    knee, low, high = light.dtype.type(_KNEE), light.dtype.type(12.92), light.dtype.type(1.055)
    offset, power = light.dtype.type(0.055), light.dtype.type(1 / 2.4)
    out = np.empty_like(light)
    for i in range(light.size):
        v = light[i]
        curved = high * exp2(power * log2(max(v, knee))) - offset
        out[i] = curved if v > knee else low * v
    return out


@compiled
def _compare(light: Array, target: Array, slope: Array) -> float:
    """Sum of squared differences in sRGB. Its derivative with respect to light goes to ``slope``. All arrays are flat.

    The loop runs over ``scratch``, which holds light, target and slope of one chunk. Over the arrays themselves, it
    would be compiled in two versions with different orders of summation, chosen by whether the arrays may overlap in
    memory.
    """
    knee, low, high = light.dtype.type(_KNEE), light.dtype.type(12.92), light.dtype.type(1.055)
    offset, power, two = light.dtype.type(0.055), light.dtype.type(1 / 2.4), light.dtype.type(2.0)
    scratch = np.zeros(3 * _CHUNK, light.dtype)
    total = 0.0
    for start in range(0, light.size, _CHUNK):
        size = min(_CHUNK, light.size - start)
        scratch[:size] = light[start : start + size]
        scratch[_CHUNK : _CHUNK + size] = target[start : start + size]
        scratch[size:_CHUNK] = 0  # black against black: no difference
        scratch[_CHUNK + size : 2 * _CHUNK] = 0
        part = light.dtype.type(0.0)  # single precision within a chunk, double over all
        for i in range(_CHUNK):
            v = scratch[i]
            bounded = max(v, knee)
            lifted = high * exp2(power * log2(bounded))
            difference = (lifted - offset if v > knee else low * v) - scratch[_CHUNK + i]
            part += difference * difference
            scratch[2 * _CHUNK + i] = two * difference * (lifted * power / bounded if v > knee else low)
        total += part
        slope[start : start + size] = scratch[2 * _CHUNK : 2 * _CHUNK + size]
    return total


@compiled
def _averaged(image: Array, distance: int) -> Array:
    step = max(distance // 2, 1)
    rows, columns = (image.shape[0] - distance) // step + 1, (image.shape[1] - distance) // step + 1
    share = image.dtype.type(1.0 / (distance * distance))
    across = np.zeros((image.shape[0], columns, 3), image.dtype)
    for r in range(image.shape[0]):
        for k in range(distance):
            for c in range(columns):
                for i in range(3):
                    across[r, c, i] += image[r, c * step + k, i]
    out = np.zeros((rows, columns, 3), image.dtype)
    for r in range(rows):
        for k in range(distance):
            for c in range(columns):
                for i in range(3):
                    out[r, c, i] += share * across[r * step + k, c, i]
    return out


@compiled
def _spread(slope: Array, distance: int, gradient: Array) -> None:
    """The transpose of ``_averaged``, added to ``gradient``."""
    step = max(distance // 2, 1)
    rows, columns = slope.shape[0], slope.shape[1]
    share = slope.dtype.type(1.0 / (distance * distance))
    down = np.zeros((gradient.shape[0], columns, 3), slope.dtype)
    for r in range(rows):
        for k in range(distance):
            for c in range(columns):
                for i in range(3):
                    down[r * step + k, c, i] += share * slope[r, c, i]
    for r in range(gradient.shape[0]):
        for k in range(distance):
            for c in range(columns):
                for i in range(3):
                    gradient[r, c * step + k, i] += down[r, c, i]
