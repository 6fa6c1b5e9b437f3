"""Strokes of a pen from a file without photographs: what the readers of InkML, UNIPEN and SVG return."""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


_FULL: Final = 1.0 + 1e-6
"""Pressure, up to rounding."""


class PenStroke(NamedTuple):
    """From touch-down to lift-off."""

    points: FloatArray
    """[K, 5] t_s, x_m, y_m, z_m (height over the paper), pressure in 0..1, along the file's own axes. NaN: not
    recorded."""
    about: dict[str, Any]
    """What else is known of it, by the names of the strokes contract; other numbers are covariates."""


class PenFile(NamedTuple):
    """All strokes of a file, in its order."""

    strokes: list[PenStroke]
    y_down: bool
    """Whether y grows downwards in it."""
    assumed: list[str]
    """What the file does not say and was assumed, as sentences."""


def with_pressures(strokes: list[PenStroke], full: list[float]) -> list[str]:
    """Divide forces by those at full pressure [strokes], NaN where a stroke's file has none: then by the largest force.

    Pressures are written into the strokes' points. Returns a sentence where the largest force was assumed to be full.

    Raises:
        ValueError: a pressure is below 0 or above 1.
    """
    unknown = [stroke for stroke, limit in zip(strokes, full, strict=True) if np.isnan(limit)]
    forces = [force[np.isfinite(force)] for force in (stroke.points[:, 4] for stroke in unknown)]
    largest = max((float(force.max()) for force in forces if len(force)), default=0.0)
    for stroke, limit in zip(strokes, full, strict=True):
        divisor = largest if np.isnan(limit) else limit
        stroke.points[:, 4] = stroke.points[:, 4] / divisor if divisor > 0 else np.nan
        if (stroke.points[:, 4] < 0).any() or (stroke.points[:, 4] > _FULL).any():
            raise ValueError("it has forces below 0 or above its own largest one")
    if largest <= 0:
        return []
    return [f"Full pressure is not given: the largest force in the file, {largest:g}, counts as 1."]
