"""An analytic plough: what a push leaves by the geometry of the end-effector alone, with eight fitted numbers.

With the dent d, how deep the swept end-effector cuts into the surface (``param2deform.clearance_mm``), and its
clearance c above it, the change of height in a push's own pose is

    -(1 - b) d + r (1 - b) V w / W,    w = (G * d) / (1 + exp(-c / e)).

b is the share of the dent that springs back, and r the share of the remaining volume V = sum d that is heaped up around
the groove. G is a Gaussian that is shifted ahead; W = sum w. The rest of the volume is compacted.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from scipy.optimize import least_squares
from torch import Tensor

from pentimento.dynamics.pushes.measured import PushSamples
from pentimento.dynamics.pushes.param2deform import Underside, clearance_mm
from pentimento.dynamics.pushes.pose import Crop, PoseSamples, in_pose, to_canvas

_EDGE_MM = 0.3
"""e: clearance within which rims begin."""
_TINY = 1e-9
"""Avoids a division by zero where nothing is pressed."""
_STEP = 1e-3
"""Of the finite differences, in units of ``_SCALE``: heights are in single precision, too coarse for a smaller one."""


class Plough(NamedTuple):
    """The fitted numbers."""

    along_mm: float
    """Reach of the underside in the direction of travel; see ``param2deform.Underside``."""
    across_mm: float
    """Likewise to the side."""
    power: float
    """Of the distance, by which the underside rises."""
    sinking: float
    """Depth that the tip reaches, as a share of the commanded depth."""
    rebound: float
    """Share of the dent that springs back."""
    rim: float
    """Share of the remaining volume that is heaped up."""
    width_mm: float
    """Standard deviation of the Gaussian."""
    ahead_mm: float
    """Shift of the Gaussian in the direction of travel."""


_START = Plough(8.0, 8.0, 2.0, 1.0, 0.1, 0.5, 5.0, 0.0)
_BOUNDS = (Plough(2.0, 2.0, 1.2, 0.4, 0.0, 0.0, 1.0, -10.0), Plough(30.0, 30.0, 8.0, 2.0, 0.9, 1.0, 20.0, 10.0))
_SCALE = Plough(8.0, 8.0, 2.0, 1.0, 0.1, 0.5, 5.0, 5.0)
"""Typical sizes."""


def footprint(plough: Plough, state_m: Tensor, length_m: Tensor, depth_m: Tensor, crop: Crop) -> Tensor:
    """Change of height [B, side, side] in metres, in the constant pose.

    Args:
        state_m: [B, side, side] height above the surface at the start of the push.
        length_m, depth_m: [B].
    """
    *underside, rebound, rim, width_mm, ahead_mm = plough
    x_mm, y_mm = (1e3 * crop.places_m()).unbind(-1)
    tool = Underside(*(torch.full_like(length_m, number) for number in underside))
    clearance = clearance_mm(x_mm, y_mm, length_mm=1e3 * length_m, depth_mm=1e3 * depth_m, tool=tool) - 1e3 * state_m
    dent = (-clearance).clamp(min=0.0)
    spread = _gaussian(y_mm[:, 0], width_mm, 0.0) @ dent @ _gaussian(x_mm[0], width_mm, ahead_mm).T
    weight = spread * torch.sigmoid(clearance / _EDGE_MM)
    heaped = rim * dent.sum((1, 2)) / (weight.sum((1, 2)) + _TINY)
    return 1e-3 * (1.0 - rebound) * (heaped[:, None, None] * weight - dent)


def fit_plough(seen: PoseSamples, crop: Crop) -> Plough:
    """Least squares: the mean of L_3D over pushes of ``above_start``."""
    weight = seen.known.float()
    weight = (weight / weight.sum((1, 2), keepdim=True).clamp(min=1.0) / len(weight)).sqrt()

    def residuals(numbers: np.ndarray) -> np.ndarray:
        change = footprint(Plough(*map(float, numbers)), seen.state, seen.length_m, seen.depth_m, crop)
        return (1e3 * weight * (change - seen.change)).flatten().double().numpy()

    def jacobian(numbers: np.ndarray) -> np.ndarray:
        at, steps = residuals(numbers), _STEP * np.array(_SCALE)
        return np.stack([(residuals(numbers + e) - at) / e.sum() for e in np.diag(steps)], axis=1)

    fitted = least_squares(residuals, _START, jacobian, bounds=_BOUNDS, x_scale=_SCALE, ftol=1e-4, xtol=1e-4)
    return Plough(*map(float, fitted.x))


def ploughed(plough: Plough, samples: PushSamples, crop: Crop) -> Tensor:
    """Heights [N, H, W] after each push, over the whole window, metres."""
    seen = above_start(samples, crop)
    change = footprint(plough, seen.state, seen.length_m, seen.depth_m, crop)
    window, action = (torch.from_numpy(array.astype(np.float32)) for array in (samples.window_m, samples.action))
    _, height, width = samples.before.shape
    return torch.from_numpy(samples.before) + to_canvas(change, window, action, shape=(height, width), crop=crop)


def above_start(samples: PushSamples, crop: Crop) -> PoseSamples:
    """The pushes in the constant pose, with heights above the surface at their starts."""
    seen = in_pose(samples, crop)
    return seen._replace(state=seen.state - torch.from_numpy(samples.surface_m.astype(np.float32))[:, None, None])


def _gaussian(places_mm: Tensor, width_mm: float, ahead_mm: float) -> Tensor:
    """[P, P]: how much of what is displaced at a place (second axis) comes up at another (first axis)."""
    return torch.exp(-(((places_mm[:, None] - places_mm - ahead_mm) / width_mm).square()) / 2)
