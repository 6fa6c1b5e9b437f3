"""Height maps in 16-bit PNG: heights above the table in whole units, 0 = hole (nothing was measured there)."""

import math
from typing import Final

import numpy as np
import numpy.typing as npt

from pentimento.contracts.errors import ContractError, ImageError
from pentimento.contracts.frames import Window, canvas_to_pixel, check_window, pixel_to_canvas, pixels_per_m
from pentimento.contracts.images import decode_png, encode_png

_MAX_UNITS: Final = 65535
_NEAR_M: Final = (0.003, 0.005, 0.007, 0.010)


def encode_height_png(height_m: npt.ArrayLike, height_per_unit_m: float) -> bytes:
    """16-bit PNG of heights [H, W] above the table in metres; NaN, a hole, becomes 0.

    A measured height is at least one unit: the scanner's noise on the bare table must not become a hole.

    Raises:
        ContractError: not [H, W] or empty, an infinite height, a height beyond 65535 units, a unit that is no
            length.
    """
    unit_m = _checked_unit(height_per_unit_m)
    heights = np.asarray(height_m, dtype=np.float64)
    if heights.ndim != 2 or heights.size == 0:
        raise ContractError(f"A height map is [H, W] with at least one pixel, not of shape {heights.shape}.")
    if np.isinf(heights).any():
        raise ContractError("A height map holds an infinite height; mark what was not measured with NaN.")
    units = np.rint(heights / unit_m)
    if np.nanmax(units, initial=0.0) > _MAX_UNITS:
        raise ContractError(
            f"A height of {np.nanmax(heights):.6g} m is beyond the {_MAX_UNITS} units of {unit_m:.6g} m that 16 bits "
            "hold; check metres against millimetres, or use a larger unit."
        )
    holes = np.isnan(units)
    pixels = np.where(holes, 0.0, np.maximum(np.where(holes, 1.0, units), 1.0)).astype(np.uint16)
    return encode_png(pixels)


def decode_height_m(png: bytes, height_per_unit_m: float) -> npt.NDArray[np.float64]:
    """Heights float64[H, W] above the table in metres, NaN where the scanner saw nothing.

    Raises:
        ImageError: unreadable, 8 bits deep, or in colour.
        ContractError: nothing but holes, or a unit that is no length.
    """
    unit_m = _checked_unit(height_per_unit_m)
    pixels = decode_png(png)
    if pixels.ndim != 2:
        raise ImageError("A height map is a grey PNG, and this one is in colour; save the heights, not a picture.")
    if pixels.dtype != np.uint16:
        raise ImageError(
            f"A height map has 16 bits a pixel, and this PNG has {8 * pixels.dtype.itemsize}; 256 heights are too few."
        )
    if not pixels.any():
        raise ContractError("A height map holds nothing but holes (0); the scanner saw nothing, so leave the scan out.")
    return np.where(pixels == 0, np.nan, pixels * unit_m)


def _checked_unit(height_per_unit_m: float) -> float:
    unit_m = float(height_per_unit_m)
    if not (math.isfinite(unit_m) and unit_m > 0):
        raise ContractError(f"height_per_unit_m is {height_per_unit_m}; it is the metres of one unit, above zero.")
    return unit_m


def level(height_m: npt.NDArray[np.float64], window_m: Window, table_plane: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Heights [H, W] above the table of a scan in which the table lies at a x + b y + c (`table_plane` [3]).

    Raises:
        ContractError: a plane that is not three finite numbers, or a window that does not fit the pixels.
    """
    plane = np.asarray(table_plane, dtype=np.float64)
    if plane.shape != (3,) or not np.isfinite(plane).all():
        raise ContractError(f"A table plane is three finite numbers a, b, c (a x + b y + c), not {plane.tolist()}.")
    scale = pixels_per_m(height_m.shape, window_m)
    rows, columns = np.indices(height_m.shape)
    xy_m = pixel_to_canvas(np.stack([columns, rows], axis=-1), window_m, scale)
    return np.asarray(height_m - xy_m @ plane[:2] - plane[2])


def surface_at_m(height_m: npt.NDArray[np.float64], window_m: Window, x_m: float, y_m: float) -> float:
    """The surface's height at a place: the median of the levelled heights [H, W] within 3 mm of it, holes left out.

    This is the surface from which a push's depth counts. In a hole that wide the radius grows, up to 10 mm.

    Raises:
        ContractError: the place is outside the window, or nothing was measured within 10 mm of it.
    """
    x_min, y_min, x_max, y_max = check_window(window_m)
    if not (x_min <= x_m <= x_max and y_min <= y_m <= y_max):
        raise ContractError(
            f"The place ({x_m:.6g}, {y_m:.6g}) m is outside the scan's window {[x_min, y_min, x_max, y_max]} m."
        )
    scale = pixels_per_m(height_m.shape, window_m)
    column, row = canvas_to_pixel([x_m, y_m], window_m, scale)
    rows, columns = np.indices(height_m.shape)
    distance_m = np.hypot(rows - row, columns - column) / scale
    for radius_m in _NEAR_M:
        heights = height_m[(distance_m <= max(radius_m, 0.75 / scale)) & ~np.isnan(height_m)]
        if heights.size:
            return float(np.median(heights))
    raise ContractError(
        f"The scan has a hole of {2000 * _NEAR_M[-1]:g} mm at ({x_m:.6g}, {y_m:.6g}) m; push at another "
        "place, or scan again."
    )
