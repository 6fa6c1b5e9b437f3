"""The strongest trivial stroke model: the commanded path drawn with one width and one opacity, fitted to the strokes.

Every figure of a stroke model stands beside this one's. It is Traj2Stroke with nothing left to learn but its pen.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import torch
from scipy.optimize import minimize_scalar
from torch import Tensor

from pentimento.dynamics.strokes.samples import StrokeSamples
from pentimento.dynamics.strokes.traj2stroke import Traj2StrokeParameters

HARD_EDGE = 1e-3


def constant_width(half_width_m: float, opacity: float) -> Traj2StrokeParameters:
    """A polyline pen with a hard edge, in Traj2Stroke's terms."""
    return Traj2StrokeParameters((1.0, 1.0), (0.0, 0.0), 1e-4, half_width_m, HARD_EDGE, opacity)


def fit_polyline(error: Callable[[Traj2StrokeParameters], float]) -> Traj2StrokeParameters:
    """The pen whose ``error`` on the strokes at hand is least."""
    width, opacity = 2e-3, 0.95
    for _ in range(2):  # width and opacity hardly interact: two rounds of line searches settle them
        found = minimize_scalar(
            lambda log_width, o=opacity: error(constant_width(math.exp(log_width), o)),
            bounds=(math.log(2e-4), math.log(2e-2)),
            method="bounded",
            options={"xatol": 0.05},
        )
        width = math.exp(found.x)
        found = minimize_scalar(
            lambda o, w=width: error(constant_width(w, o)),
            bounds=(0.3, 0.99),
            method="bounded",
            options={"xatol": 0.05},
        )
        opacity = float(found.x)
    return constant_width(width, opacity)


def blank(samples: StrokeSamples) -> Tensor:
    """The prediction that nothing happens, sRGB [B, H, W, 3]."""
    return torch.clone(samples.before)
