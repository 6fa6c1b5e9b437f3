"""Height of the surface: the tool descends in small steps until it touches, then the last step is bisected.

The tool never goes deeper than the first touch. The caller defines a touch: a mark on a photograph, a probe's contact.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.errors import CalibrationError

FloatArray = NDArray[np.float64]


def touch_height(
    touches: Callable[[float], bool], high_m: float, low_m: float, step_m: float, within_m: float
) -> float:
    """Height at which the tool begins to touch, to half of `within_m`.

    `touches(z)` sends the tool to height z and returns whether it touched. It is called from `high_m` down in steps of
    `step_m`, never below `low_m`, and after the first touch only between the last height without and it.

    Raises CalibrationError if the tool touches already at `high_m`, or never.
    """
    if not (low_m < high_m and 0 < within_m <= step_m):
        raise CalibrationError(f"A touch is looked for downwards, from {high_m} m to {low_m} m in steps of {step_m} m.")
    if touches(high_m):
        raise CalibrationError(f"The tool touches already at {1000 * high_m:.2f} mm; begin higher.")
    above_m = high_m
    while above_m > low_m:
        below_m = max(above_m - step_m, low_m)
        if touches(below_m):
            break
        above_m = below_m
    else:
        raise CalibrationError(
            f"The tool does not touch down to {1000 * low_m:.2f} mm; check the tool, its ink and the canvas's place."
        )
    while above_m - below_m > within_m:
        middle_m = (above_m + below_m) / 2
        if touches(middle_m):
            below_m = middle_m
        else:
            above_m = middle_m
    return (above_m + below_m) / 2


def touch_plane(places_m: FloatArray, heights_m: FloatArray) -> tuple[tuple[float, float, float], float]:
    """The plane z = a + b x + c y through touches at places_m[K, 2], and the max distance of a touch from it.

    Raises CalibrationError for fewer than four places, or places on one line: a plane through three places has no
    residual.
    """
    design = np.column_stack((np.ones(len(places_m)), places_m))
    spread = np.linalg.svd(places_m - places_m.mean(axis=0), compute_uv=False) if len(places_m) > 3 else np.zeros(2)
    if spread[-1] < 1e-3:
        raise CalibrationError("A plane needs touches at four places or more that do not lie on one line.")
    plane, *_ = np.linalg.lstsq(design, heights_m, rcond=None)
    a, b, c = (float(value) for value in plane)
    return (a, b, c), float(np.abs(design @ plane - heights_m).max())
