"""Measured pushes as a diagnosis uses them: windows around each push, covariates, denoised scans."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pentimento.dynamics.pushes.measured import PushSamples
from pentimento.dynamics.pushes.measured_scene import scene_of, smoothed_periods
from pentimento.planning.pushes.analytic.scene import PushScene

Array = NDArray[Any]
PIXELS_PER_M = 640.0
"""Finer scans are averaged down to about this; a footprint is then about ten pixels wide."""
_SIDE_PX = 64
"""Side of the windows around the pushes."""
_MIN_BLOCKS = 12
"""Below this number of smoothings, each action is its own block."""


@dataclass(frozen=True)
class MeasuredPushes:
    """B pushes that can be compared with a model's predictions."""

    samples: PushSamples
    """Cropped to windows of one size around the pushes."""
    scene: PushScene
    """With ``before`` denoised."""
    after: Array
    """float32[B, H, W] metres above the surface at the start of each push."""
    block: Array
    """int64[B]: pushes of one block share a surface; a block lies between two smoothings."""
    turn: Array
    """int64[B]: rank in the order of execution, session by session."""
    weight: Array
    """float32[B, H, W]: weight of each pixel's squared error in fits; 1 unless set by ``fit.equalised``."""
    learned_mm: Array
    """float32[B, H, W]: prediction of the learned residual model (``learned_residual``), added to that of any analytic
    model, mm."""

    def __len__(self) -> int:
        return len(self.block)

    @property
    def action(self) -> Array:
        """int64[B]: rows with equal values repeat one command."""
        return self.samples.action_id

    @property
    def valid(self) -> Array:
        """bool[B, H, W]: measured before and after."""
        return self.samples.known

    @property
    def covariates(self) -> dict[str, Array]:
        """float64[B] each: every numeric column except identities; NaN where unknown."""
        return {name: v for name, v in self.scene.covariates.items() if not name.endswith("_id")}

    def pick(self, rows: Array | slice) -> MeasuredPushes:
        """The pushes with these indices."""
        return MeasuredPushes(
            self.samples.pick(rows), self.scene.pick(rows), self.after[rows], self.block[rows], self.turn[rows],
            self.weight[rows], self.learned_mm[rows],
        )  # fmt: skip


def measure(samples: PushSamples, half_width_m: float | None = None) -> MeasuredPushes:
    """Measured pushes with windows around each, ``before`` denoised.

    Args:
        half_width_m: half-width of the footprint; by default estimated from these pushes.

    Raises:
        ContractError: there are pinches among them, or a push starts outside its window.
    """
    near = cropped(samples)
    scene = scene_of(near, half_width_m, np.stack([_denoised(height) for height in near.before]))
    after = (near.after - near.surface_m[:, None, None]).astype(np.float32)
    turn = np.argsort(np.lexsort((near.covariates["order"], near.session)))
    return MeasuredPushes(near, scene, after, _blocks(near), turn, np.ones_like(after), np.zeros_like(after))


def cropped(samples: PushSamples, side_px: int = _SIDE_PX) -> PushSamples:
    """Windows of at most ``side_px`` pixels a side, centred on each push, on the pixels of the scan."""
    rows, columns = (min(side, side_px) for side in samples.before.shape[1:])
    k, action, window = samples.pixels_per_m, samples.action, samples.window_m.copy()
    travel = action[:, 3] / 2
    x, y = action[:, 0] + travel * np.cos(action[:, 2]), action[:, 1] + travel * np.sin(action[:, 2])
    left = _first(x - window[:, 0], k, columns, samples.before.shape[2])
    top = _first(window[:, 3] - y, k, rows, samples.before.shape[1])
    parts = [(slice(t, t + rows), slice(c, c + columns)) for t, c in zip(top, left, strict=True)]
    window[:, 0] += left / k
    window[:, 3] -= top / k
    window[:, 2], window[:, 1] = window[:, 0] + columns / k, window[:, 3] - rows / k
    before, after, known = (
        np.stack([image[part] for image, part in zip(images, parts, strict=True)])
        for images in (samples.before, samples.after, samples.known)
    )
    return samples._replace(before=before, after=after, known=known, window_m=window)


def _first(middle_m: Array, k: float, size: int, whole: int) -> Array:
    """First pixel of a part of ``size`` pixels around a place, inside the whole."""
    return np.clip(np.rint(middle_m * k - size / 2).astype(int), 0, whole - size)


def _blocks(samples: PushSamples) -> Array:
    period = smoothed_periods(samples)
    if period is None or period.max() + 1 < _MIN_BLOCKS:  # hardly ever smoothed: each action is its own block
        return np.asarray(np.unique(samples.action_id, return_inverse=True)[1])
    return period


def _denoised(height_m: Array) -> Array:
    """A scan [H, W] without pixel noise, edges preserved."""
    height_mm = (height_m * 1e3).astype(np.float32)
    # Immerkaer's noise estimate: the mask does not respond to planes or straight edges.
    mask = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], dtype=np.float32)
    noise = float(np.median(np.abs(cv2.filter2D(height_mm, -1, mask)))) / 0.6745 / 6
    if noise < 1e-4:
        return height_m
    return np.asarray(cv2.bilateralFilter(height_mm, 5, 4 * noise, 1.2) / 1e3, dtype=np.float32)
