"""Rendering of strokes onto canvases, compiled with Numba: exact values and gradients, work only where ink falls.

The coverage of a pixel G by a segment u → v of a stroke is (thesis 5.1-5.5, corrected; lengths in px)

    T = clamp((G − u)·(v − u) / max(|v − u|², ε), 0, 1)      where on the segment
    D = |G − u − T (v − u)|                                  distance to the segment
    R = max((1 − T) r_u + T r_v, R_MIN)                      radius there; density ρ and softness c likewise
    edge = max(min(R, D + ½) + min(R, ½ − D), 0)             share of the pixel that lies within the rim
    coverage = ρ · min(max(R − D, RIM_PX) / R, 1)^c · edge

The edge is the average of a sharp rim over a pixel, along the way to the path. Without it a crisp mark (c near 0) would
change by whole pixels as it grows or moves, and its gradient would be wrong. A line thinner than a pixel covers it in
proportion to its width.

The coverage by a stroke is that of the segment with the smallest D/R among those with edge > 0, where density and
softness are equal along the stroke; it is the maximum over the segments, where they vary. Strokes are composited in
order, in linear light: image ← image + coverage · (colour − image). See ``composition`` for tools that pick up wet
paint.

The formula corrects two errors of the thesis as printed: its (5.1) takes the minimum of the distances to the *line* and
to both ends, which is the distance to an infinite line; its (5.2) drops the sign of the projection.

Each pixel under a stroke is stored as a *fragment* (place, coverage, segment, colour below). Memory therefore grows
with the inked area, not with strokes × canvas, and the backward pass visits only pixels with ink.

A canvas is divided into independent bands of rows, which threads can share. The bands are the same for any number of
threads, so the results are equal bit by bit.

Pixel coordinates are (column, row); the centre of pixel (r, c) is (c, r). See ``pentimento.contracts.frames``.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pentimento.render.backward import POINT_FIELDS, backward_band
from pentimento.render.errors import RenderInputError
from pentimento.render.forward import Fragments, expected_fragments, lay_band, reach_of_strokes
from pentimento.render.strokes import PixelStrokes
from pentimento.render.threads import in_threads

__all__ = [
    "Fragments",
    "RenderInputError",
    "StrokeGradients",
    "render",
    "render_backward",
]

_BAND_ROWS = 64
"""Rows of a band: the unit of work of a thread."""
_LARGEST = 1e9
"""Largest absolute value of an input. Larger ones are taken as errors."""
_MAX = np.iinfo(np.uint16).max
"""Largest number of a canvas's rows and columns and of a path's segments: a fragment stores them as uint16."""
_ASK_ABOUT_BYTES = 1 << 28
"""Fragments of less memory are not checked against the free memory."""

Array = NDArray[Any]


class StrokeGradients(NamedTuple):
    """∂loss/∂input, each of its input's shape."""

    points: Array
    radius: Array
    density: Array
    softness: Array
    color: Array
    canvas: Array
    pickup: Array | None


def render(
    strokes: PixelStrokes[Array], canvas: Array, *, threads: int = 1
) -> tuple[Array, tuple[tuple[Fragments, ...], ...]]:
    """Composite strokes onto canvases, in order.

    Args:
        canvas: float[B, H, W, 3], linear light; it is not changed. With ``strokes.pickup`` float[B, H, W, 4]: the last
            channel is the wetness of the canvas, 0 to 1.
        threads: number of threads.

    Returns:
        The images, of the canvas's shape, and the fragments of each painting for ``render_backward``.

    Raises:
        RenderInputError: a shape does not fit, a value is not finite, a canvas has more than 65,535 rows or columns, a
            path more segments than that, or the fragments exceed the free memory. The message names the first one.
    """
    check_inputs(strokes, canvas, threads)
    reach = [reach_of_strokes(*painting) for painting in zip(strokes.points, strokes.radius, strict=True)]
    _check_memory(reach, canvas)
    image = np.array(canvas, copy=True, order="C")
    none = np.empty(0, image.dtype)

    def lay(part: tuple[int, int, int]) -> Fragments:
        b, top, end = part
        *own, pickup = strokes.at(b)
        return Fragments(top, *lay_band(*own, none if pickup is None else pickup, reach[b], image[b, top:end], top))

    paintings = len(image)
    parts = [(b, *band) for b in range(paintings) for band in _bands(canvas, strokes)]
    laid = in_threads(lay, parts, threads)
    per_painting = len(parts) // max(paintings, 1)
    return image, tuple(tuple(laid[b * per_painting : (b + 1) * per_painting]) for b in range(paintings))


class _BandGradients(NamedTuple):
    """Gradients of one band's strokes; see ``backward_band``."""

    touched: Array
    points: Array
    color: Array
    pickup: Array


def render_backward(
    strokes: PixelStrokes[Array],
    fragments: tuple[tuple[Fragments, ...], ...],
    image_gradient: Array,
    *,
    threads: int = 1,
) -> StrokeGradients:
    """Gradients of a loss with respect to all inputs of ``render``, from ∂loss/∂image, of the image's shape."""
    g_canvas = np.array(image_gradient, copy=True, order="C")
    none = np.empty(0, strokes.points.dtype)

    def pull(part: tuple[int, Fragments]) -> _BandGradients:
        b, band = part
        *own, pickup = strokes.at(b)
        g_color = np.zeros_like(strokes.color[b])
        g_pickup = none if pickup is None else np.zeros_like(pickup)
        rows = min(_BAND_ROWS, g_canvas.shape[1] - band.top) if pickup is None else g_canvas.shape[1]
        touched, g_points = backward_band(
            *own, none if pickup is None else pickup, band.top, band.start, band.column, band.row, band.segment,
            band.coverage, band.below, g_canvas[b, band.top : band.top + rows], g_color, g_pickup,
        )  # fmt: skip
        return _BandGradients(touched, g_points, g_color, g_pickup)

    parts = [(b, band) for b, bands in enumerate(fragments) for band in bands]
    g_all = np.zeros((*strokes.radius.shape, POINT_FIELDS), strokes.points.dtype)
    g_color = np.zeros_like(strokes.color)
    g_pickup = None if strokes.pickup is None else np.zeros_like(strokes.pickup)
    for (b, _), of_band in zip(parts, in_threads(pull, parts, threads), strict=True):
        g_all[b, of_band.touched] += of_band.points
        g_color[b] += of_band.color
        if g_pickup is not None:
            g_pickup[b] += of_band.pickup
    g_xy, g_radius, g_density, g_softness = g_all[..., :2], g_all[..., 2], g_all[..., 3], g_all[..., 4]
    return StrokeGradients(g_xy, g_radius, g_density, g_softness, g_color, g_canvas, g_pickup)


def _bands(canvas: Array, strokes: PixelStrokes[Array]) -> list[tuple[int, int]]:
    """The rows top:end of each band. There is one band where strokes carry paint, since they carry it across bands."""
    height = canvas.shape[1]
    rows = _BAND_ROWS if strokes.pickup is None else height
    return [(top, min(top + rows, height)) for top in range(0, height, rows)]


def check_inputs(strokes: PixelStrokes[Array], canvas: Array, threads: int) -> None:
    """Refuse inputs that compiled code would read out of bounds, or that are invalid; see ``render``."""
    given = {**strokes._asdict(), "canvas": canvas}
    for name, array in given.items():
        if not isinstance(array, np.ndarray) and not (name == "pickup" and array is None):
            raise RenderInputError(
                f"The renderer's {name} is of type {type(array).__name__}; give a NumPy array, such as "
                "np.array(…, dtype=np.float64)."
            )
    points = strokes.points
    if points.dtype not in (np.float32, np.float64):
        raise RenderInputError(f"The renderer's points are {points.dtype}; give arrays of float32, or all of float64.")
    if points.ndim != 4 or points.shape[-1] != 2 or points.shape[2] == 0 or canvas.ndim != 4 or canvas.size == 0:
        raise RenderInputError(
            f"The renderer needs points [B, S, N, 2] and a canvas [B, H, W, 3]; got {points.shape} and {canvas.shape}."
        )
    height, width = canvas.shape[1:3]
    if max(height, width) > _MAX:
        raise RenderInputError(
            f"The renderer's canvas has {height} x {width} pixels; it takes sides up to {_MAX}: render it in "
            "parts, or at a lower resolution."
        )
    if points.shape[2] - 1 > _MAX:
        raise RenderInputError(
            f"The renderer's paths have {points.shape[2] - 1} segments; it takes up to {_MAX} in a path: give fewer "
            "points, or divide the strokes."
        )
    if threads < 1:
        raise RenderInputError(f"The renderer was asked for {threads} threads; it needs at least one.")
    batch, count, n, _ = points.shape
    wanted = {
        "radius": (strokes.radius, (batch, count, n)),
        "density": (strokes.density, (batch, count, n)),
        "softness": (strokes.softness, (batch, count, n)),
        "color": (strokes.color, (batch, count, 3)),
        "canvas": (canvas, (batch, *canvas.shape[1:3], 3 if strokes.pickup is None else 4)),
        "points": (points, points.shape),
    }
    if strokes.pickup is not None:
        wanted["pickup"] = (strokes.pickup, (batch, count))
    for name, (array, shape) in wanted.items():
        if array.shape != shape:
            raise RenderInputError(f"The renderer's {name} must have shape {shape}, not {array.shape}.")
        if array.dtype != points.dtype:
            raise RenderInputError(f"The renderer's {name} is {array.dtype}, but points are {points.dtype}.")
        if array.size and not max(array.max(), -array.min()) <= _LARGEST:  # false for NaN
            index = tuple(int(i) for i in np.argwhere(~(np.abs(array) <= _LARGEST))[0])
            raise RenderInputError(
                f"The renderer's {name}{list(index)} is {array[index]}: every value must be finite and within "
                f"±{_LARGEST:g}."
            )


def _check_memory(reach: list[Array], canvas: Array) -> None:
    """Refuse inputs whose fragments exceed the free memory."""
    height, width, channels = canvas.shape[1:]
    per_fragment = 3 * 2 + (1 + channels) * canvas.itemsize
    needed = sum(expected_fragments(painting, 0, height, width) for painting in reach) * per_fragment
    if needed < _ASK_ABOUT_BYTES or needed < (free := _free_bytes()):
        return
    b, s = max(
        ((b, int(p[:, 2].argmax())) for b, p in enumerate(reach) if len(p)), key=lambda at: reach[at[0]][at[1], 2]
    )
    raise RenderInputError(
        f"The strokes would leave about {needed / 1e9:.1f} GB of ink to remember, but {free / 1e9:.1f} GB of memory "
        f"are free: render fewer or smaller ones at once. Most comes from points[{b}, {s}]: about "
        f"{reach[b][s, 2]:.3g} px."
    )


def _free_bytes() -> int:
    """Available memory. On Linux it includes the file cache that the system can release."""
    try:
        lines = Path("/proc/meminfo").read_text(encoding="utf-8").splitlines()
    except FileNotFoundError:
        lines = []
    available = [int(line.split()[1]) * 1024 for line in lines if line.startswith("MemAvailable:")]
    return available[0] if available else os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
