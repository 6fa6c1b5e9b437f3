"""What rises beside a tool: where from, which way a heap leans, how high. One pass over the pixels each, compiled."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[Any]


def forward(maps: Array, heading_rad: Array) -> Array:
    """Minus the slope of maps [B, H, W] along the travel, per pixel: positive ahead of a heap."""
    found = np.empty_like(maps)
    _forward(maps, np.cos(heading_rad).astype(np.float32), np.sin(heading_rad).astype(np.float32), found)
    return found


def source(kept: Array, inside: Array, pressed: Array, before: Array, evenly: float) -> Array:
    """What rises around each place before it is spread: what stays pressed there, or, by the share ``evenly``, as deep
    as the tool goes below the surface at the start.

    What a wall loses does not all rise behind it: below that surface, the tool itself tells where.

    Args:
        kept, inside, pressed, before: float32[B, H, W] metres, inside of 0 to 1.
    """
    found = np.empty_like(kept)
    _source(kept, inside, pressed, before, np.float32(evenly), found)
    return found


def raised(near: Array, far: Array, ahead: Array, progress: Array, inside: Array, shape: tuple[float, ...]) -> Array:
    """Rims and a heap, outside the contact alone and of no volume yet, float32[B, H, W].

    Args:
        near, far: what is spread narrowly and widely.
        ahead: how much higher that is behind each place than ahead of it, per pixel.
        progress: -1 before the start of travel, 1 beyond its end.
        shape: share of the far one, height of the heap in pixels, and by how much rims grow along the travel.
    """
    far_share, heap, lean = map(np.float32, shape)
    found = np.exp(lean * progress)
    _raised(near, far, ahead, inside, far_share, heap, found)
    return found


@njit(cache=True, error_model="numpy", nogil=True)
def _forward(maps: Array, cosine: Array, sine: Array, found: Array) -> None:
    pushes, rows, columns = maps.shape
    half = np.float32(0.5)
    for b in range(pushes):
        for i in range(rows):
            above, below = max(i - 1, 0), min(i + 1, rows - 1)
            down = sine[b] / np.float32(below - above)
            right = cosine[b] * half
            for j in range(1, columns - 1):
                slope = down * (maps[b, below, j] - maps[b, above, j])
                found[b, i, j] = slope - right * (maps[b, i, j + 1] - maps[b, i, j - 1])
            for j, left in ((0, 0), (columns - 1, columns - 2)):
                slope = down * (maps[b, below, j] - maps[b, above, j])
                found[b, i, j] = slope - cosine[b] * (maps[b, i, left + 1] - maps[b, i, left])


@njit(cache=True, error_model="numpy", nogil=True)
def _source(kept: Array, inside: Array, pressed: Array, before: Array, evenly: float, found: Array) -> None:
    nothing = np.float32(0)
    for b in range(kept.shape[0]):
        for i in range(kept.shape[1]):
            for j in range(kept.shape[2]):
                tool = inside[b, i, j] * max(pressed[b, i, j] - before[b, i, j], nothing)
                found[b, i, j] = kept[b, i, j] + evenly * (tool - kept[b, i, j])


@njit(cache=True, error_model="numpy", nogil=True)
def _raised(near: Array, far: Array, ahead: Array, inside: Array, far_share: float, heap: float, found: Array) -> None:
    one = np.float32(1)
    for b in range(near.shape[0]):
        for i in range(near.shape[1]):
            for j in range(near.shape[2]):
                rim = (one - far_share) * near[b, i, j] + far_share * far[b, i, j] + heap * ahead[b, i, j]
                found[b, i, j] *= rim * (one - inside[b, i, j])
