"""What residuals may depend on: recorded columns, and what a commanded path says of itself (length, press, heading,
place, speed).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.covariates import CARRIED
from pentimento.diagnosis.strokes.measured import Measured

Array = NDArray[Any]


def covariates_shown(measured: Measured) -> dict[str, Array]:
    """Recorded ones and those of the path that are known of all strokes and vary, float64[B] each; of paint that is
    carried along, how much, and not its colour's channels.
    """
    recorded = {name: values for name, values in measured.covariates.items() if name not in CARRIED[1:]}
    known = {name: values for name, values in recorded.items() if np.isfinite(values).all() and np.ptp(values) > 1e-9}
    return known | path_covariates(measured)


def path_covariates(measured: Measured) -> dict[str, Array]:
    """Those that vary, float64[B] each."""
    path = measured.samples.path.double().numpy()
    steps = np.hypot(*np.diff(path[..., 1:3], axis=1).transpose(2, 0, 1))
    chord = path[:, -1, 1:3] - path[:, 0, 1:3]
    heading = np.arctan2(chord[:, 1], chord[:, 0])
    found = {
        "length_m": steps.sum(1),
        "press_m": np.maximum(-path[..., 3], 0).mean(1),
        "heading_cos": np.cos(heading),
        "heading_sin": np.sin(heading),
        "place_x_m": path[..., 1].mean(1),
        "place_y_m": path[..., 2].mean(1),
    }
    duration = path[:, -1, 0] - path[:, 0, 0]
    if np.isfinite(duration).all() and (duration > 0).all():
        found["speed_m_s"] = found["length_m"] / duration
    return {name: values for name, values in found.items() if np.ptp(values) > 1e-6}
