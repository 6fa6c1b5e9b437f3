"""How each stroke differs from every model as a whole: a little darker, wider, aside, longer than it ought to be.

A hand's breadth of bristles never comes down twice alike, and no base is quite right. What is left of a stroke is
therefore not noise pixel by pixel but for the most part a sum of few ways in which a mark can differ, by amounts that
scatter from stroke to stroke. Treated as random effects (Laird and Ware 1982), they are taken out of the residual as
far as they are likely: tests, fits and held-out gains then see an effect against what is really unknown, and not
against the whole of a stroke's misfit.

For one stroke  r = J beta + M u + e  with u ~ N(0, T) and e ~ N(0, s^2 1), so that the inverse covariance of what is
unknown is  (1 - Q Q^T) / s^2  with  Q Q^T = M (s^2 T^-1 + M^T M)^-1 M^T.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
import torch
from numpy.typing import NDArray

from pentimento.gap.foretell import Model, residual, weighted_error
from pentimento.gap.jacobian import change_maps, linearise_rows, weighted_slope
from pentimento.gap.measured import Measured
from pentimento.stroke_dynamics.mechanisms.bleeding import bleed
from pentimento.stroke_dynamics.mechanisms.geometry import arc_m, tangent
from pentimento.stroke_dynamics.simulation import Mechanism, Quantity, StrokeContext
from pentimento.stroke_dynamics.traj2stroke import Mark

Array = NDArray[Any]

_ROUNDS = 30
_OF_ITSELF = 0.05
"""Share of a direction that the ways must leave for it to tell something."""
_MOST_TRUST = 5.0
_LEAST_EIGENVALUE = 1e-10
"""Of the largest."""
_STRONG = 0.9
"""Quantile over directions: what a cause does is as smooth as the smoothest of them."""


class _Ways(Mechanism):
    """Ways in which a mark differs as a whole; their sizes here are typical ones."""

    cause: ClassVar[str] = "ways"
    site = "density"
    quantities = (
        Quantity("amplitude", "1", 0.1),
        Quantity("amplitude_along", "1", 0.1),
        Quantity("width", "1", 0.1),
        Quantity("width_along", "1", 0.1),
        Quantity("normal", "m", 0.0003),
        Quantity("normal_along", "m", 0.0003),
        Quantity("start_m", "m", 0.0005),
        Quantity("end_m", "m", 0.0005),
        Quantity("tangential", "m", 0.0005),
        Quantity("blur", "1", 0.2),
    )

    def mark(self, mark: Mark, context: StrokeContext) -> Mark:
        dark, dark_along, wide, wide_along, aside, aside_along, start, end, ahead, blur = self.values
        along, arc = tangent(context.path), arc_m(context.path)
        share = arc / arc[..., -1:].clamp(min=1e-6) - 0.5
        across = torch.stack([-along[..., 1], along[..., 0]], dim=-1)
        points = mark.points_m + ahead * along + (aside + aside_along * 2 * share)[..., None] * across
        points[..., 0, :] -= start * along[..., 0, :]
        points[..., -1, :] += end * along[..., -1, :]
        moved = mark._replace(
            points_m=points,
            radius_m=mark.radius_m * torch.exp(wide + wide_along * 2 * share),
            density=mark.density * torch.exp(dark + dark_along * 2 * share),
        )
        return bleed(moved, blur.expand_as(mark.radius_m), torch.zeros_like(mark.radius_m))


def with_sway(measured: Measured, model: Model, rows: Array) -> Measured:
    """The strokes with what their ways of differing take from each residual; how much, by these rows."""
    ways = len(_Ways.quantities)
    many = model.plus(_Ways(torch.zeros(ways, dtype=torch.float64), {}))
    curvature, slope, error = (values[rows] for values in linearise_rows(many, measured))
    maps = change_maps(many, measured)[-ways:].transpose(1, 0, 2, 3)  # [B, K, H, W]
    depth = weighted_slope(model, measured)
    overlap = np.einsum("bkhw,bhw,bjhw->bkj", maps, np.square(depth).sum(-1), maps, optimize=True).astype(np.float64)
    pixels = measured.samples.valid.numpy().sum((1, 2)) * 3
    shares = pixels[rows][:, None]
    curvature, slope, error = curvature * shares[..., None], slope * shares, error * shares[:, 0]
    own = slice(-ways, None)
    spread, noise = random_effects(curvature[:, own, own], slope[:, own], error, pixels[rows])
    noise *= alikeness(curvature, slope, noise, ways)
    root = inverse_root(noise * np.linalg.inv(spread) + overlap)
    taken = np.einsum("bkhw,bkj->bjhw", maps, root, optimize=True).astype(np.float32)
    counted = replace(measured, sway=taken, sway_depth=depth)
    # A stroke that is wrong in many ways tells less of any one of them.
    rest = weighted_error(residual(model, counted), counted)
    _, group = np.unique(measured.action, return_inverse=True)
    each = (np.bincount(group, rest) / np.bincount(group))[group]
    trust = np.clip(np.median(each) / each, 1 / _MOST_TRUST, _MOST_TRUST)
    return replace(counted, weight=measured.weight * (trust / trust.mean())[:, None, None].astype(np.float32))


def inverse_root(matrices: Array) -> Array:
    """R [B, K, K] with R R^T the inverse of symmetric positive matrices [B, K, K], be they so but for rounding."""
    values, vectors = np.linalg.eigh((matrices + matrices.swapaxes(-1, -2)) / 2)
    values = np.maximum(values, _LEAST_EIGENVALUE * values[:, -1:])
    return np.asarray(vectors / np.sqrt(values)[:, None, :])


def random_effects(overlap: Array, pull: Array, energy: Array, pixels: Array) -> tuple[Array, float]:
    """Covariance T [K, K] of the amounts and the variance s^2 of each pixel, by expectation maximisation.

    Args:
        overlap: M^T M of each stroke, [n, K, K].
        pull: M^T r, [n, K].
        energy: r^T r, [n].
        pixels: how many numbers r has, [n].
    """
    ways = pull.shape[1]
    spread, noise = np.eye(ways), float(energy.sum() / pixels.sum())
    for _ in range(_ROUNDS):
        covariance = np.linalg.inv(np.linalg.inv(spread) + overlap / noise)  # of u given r
        mean = np.einsum("nkj,nj->nk", covariance, pull) / noise
        spread = (mean[:, :, None] * mean[:, None, :] + covariance).mean(0) + 1e-8 * np.eye(ways)
        left = energy - 2 * (mean * pull).sum(1) + np.einsum("nk,nkj,nj->n", mean, overlap, mean)
        left += np.einsum("nkj,njk->n", overlap, covariance)
        noise = float(left.sum() / pixels.sum())
    return spread, noise


def alikeness(curvature: Array, slope: Array, noise: float, ways: int) -> float:
    """How many numbers of a residual say the same: what the ways leave of it is not white, for neighbouring pixels and
    the three channels err alike. The variance along the model's own directions, over that of white noise.
    """
    n, own = slope.shape[1] - ways, slice(-ways, None)
    across = curvature[:, :n, own] @ np.linalg.pinv(curvature[:, own, own], hermitian=True)
    rest = slope[:, :n] - np.einsum("npk,nk->np", across, slope[:, own])
    diagonal = np.einsum("npp->np", curvature[:, :n, :n])
    left = diagonal - np.einsum("npk,npk->np", across, curvature[:, :n, own])
    seen = left > _OF_ITSELF * np.maximum(diagonal, 1e-12)
    ratios = [(rest[s, p] ** 2 / left[s, p]).mean() / noise for p in range(n) if (s := seen[:, p]).sum() > len(s) // 4]
    value = float(np.quantile(ratios, _STRONG)) if ratios else 1.0
    return max(value, 1.0)
