"""Predicted photographs of measured strokes, residuals, errors, and the noise floor."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.func import vmap

from pentimento.contracts.colour import linear_to_srgb, srgb_to_linear
from pentimento.diagnosis.batches import one_openmp_thread
from pentimento.diagnosis.evaluation import Floor, floor_of_repeats
from pentimento.diagnosis.strokes.measured import Measured
from pentimento.diagnosis.strokes.model import _UNIT_EDGE, BASE, SLABS, Model, _mark, _typical, acts_on
from pentimento.diagnosis.strokes.soft_edge import Footprint, footprint_of, mixture, picked_up
from pentimento.dynamics.strokes.simulation import Mechanism

Array = NDArray[Any]


class Ink(NamedTuple):
    """What a model lays on each window."""

    footprint: Footprint
    paint: Array  # float32[B, 1, 1, 3], or [B, H, W, 3] with paint pickup; linear light
    gain: Array  # float32[B, H, W], the camera's gain
    power: float  # of linear light, in which paint and what is below mix


def ink(model: Model, measured: Measured) -> Ink:
    """Coverage, paint and gain of a model on measured strokes."""
    return ink_of(mark_px(model, measured), model, measured)


def ink_of(mark: Array, model: Model, measured: Measured) -> Ink:
    """``ink`` for a known mark, as from ``mark_px``."""
    number = dict(zip(BASE, map(float, model.base), strict=True))
    weights = np.array([number[name] for name in SLABS])
    height, width = measured.samples.valid.shape[1:]
    footprint = footprint_of(mark, weights, (height, width))
    paint, gain = paint_laid(model, measured, footprint), gain_of_camera(model, measured)
    return Ink(footprint, paint, gain, float(np.exp(number["mixing"])))


def press_shares(model: Model, measured: Measured) -> Array:
    """Press at each point of the paths, as a share of the base's range, float64[B, N]."""
    low, high = model.press_m
    return (-measured.samples.path[..., 3].double().numpy() - low) / (high - low)


def mark_px(model: Model, measured: Measured) -> Array:
    """float64[B, N, 5]: column, row, half-width, density, edge."""
    base = torch.tensor(model.base, dtype=torch.float64)
    with one_openmp_thread():
        return _mark_px(model.press_m, base, model.active, measured).numpy()


def marks_px(model: Model, mechanisms: Sequence[Mechanism], vectors: Array, measured: Measured) -> Array:
    """The marks of a model for K parameter vectors, float64[K, B, N, 5] as from ``mark_px``.

    Args:
        mechanisms: the model's mechanisms that are applied; others are left out.
        vectors: [K, P], as ``Model.vector``.
    """
    parts = [(m, model.columns_of(m.cause), torch.tensor(_typical(m))) for m in mechanisms]

    def at(vector: Tensor) -> Tensor:
        valued = [type(m)(vector[columns] * typical, m.reference) for m, columns, typical in parts]
        return _mark_px(model.press_m, vector[: len(model.base)], valued, measured)

    with one_openmp_thread():
        return np.asarray(vmap(at)(torch.tensor(vectors)).numpy())


def _mark_px(press_m: tuple[float, float], base: Tensor, mechanisms: Sequence[Mechanism], measured: Measured) -> Tensor:
    mark, samples = _mark(press_m, base, mechanisms, measured.context), measured.samples
    scale = samples.pixels_per_m.double()[:, None, None]
    points = samples.view.to_pixels(mark.points_m)[:, 0]
    edge = torch.exp(base[BASE.index("log_edge_px")]) / _UNIT_EDGE * mark.softness
    return torch.cat([points, *(v.transpose(1, 2) for v in (mark.radius_m * scale, mark.density, edge))], dim=-1)


def paint_laid(model: Model, measured: Measured, footprint: Footprint) -> Array:
    """The paint that each stroke lays, as ``Ink.paint``."""
    samples = measured.samples
    color = srgb_to_linear(samples.color.double().numpy()) + model.color_offset[measured.paint]
    paint, pickup = torch.tensor(color, dtype=torch.float64)[:, None], None
    for mechanism in model.active:
        paint, pickup = mechanism.composite(paint, pickup, measured.context)
    laid = paint[:, 0].numpy().astype(np.float32)[:, None, None]
    if pickup is not None:
        below = samples.before_linear.numpy()
        laid = laid + pickup.numpy().astype(np.float32)[..., None, None] * picked_up(
            footprint, laid, below, measured.painted
        )
    return laid


def gain_of_camera(model: Model, measured: Measured) -> Array:
    """The camera's gain on the picture, float32[B, H, W]."""
    picture = torch.ones(*measured.samples.valid.shape, 1)
    for mechanism in model.active:
        if "picture" in acts_on(mechanism):
            picture = mechanism.camera(picture, measured.samples.view)
    return picture[..., 0].numpy().astype(np.float32)


def predicted_linear(laid: Ink, measured: Measured, pixels: Array | None = None) -> Array:
    """The windows after the strokes, linear light float32[B, H, W, 3]; or at those ``pixels``, [n, 3]."""
    below = at_pixels(measured.samples.before_linear.numpy(), pixels)
    coverage = at_pixels(laid.footprint.coverage, pixels)[..., None]
    mixed = mixture(below, paint_at(laid, pixels), coverage, laid.power)
    return np.maximum(mixed * at_pixels(laid.gain, pixels)[..., None], 0.0)


def at_pixels(images: Array, pixels: Array | None) -> Array:
    """Values [n, ...] of images [B, H, W, ...] at pixels numbered through all; all values for None.

    Ten times as fast as a mask.
    """
    return images if pixels is None else images.reshape(-1, *images.shape[3:]).take(pixels, axis=0)


def paint_at(laid: Ink, pixels: Array | None) -> Array:
    """The paint laid at pixels, linear light, as from ``at_pixels``."""
    whole = laid.paint.shape[1:3] == laid.gain.shape[1:3]
    if pixels is None or whole:
        return at_pixels(np.broadcast_to(laid.paint, (*laid.gain.shape, 3)), pixels)
    return laid.paint[:, 0, 0].take(pixels // laid.gain[0].size, axis=0)


def residual(model: Model, measured: Measured) -> Array:
    """Measured minus predicted, sRGB float32[B, H, W, 3]; 0 in the padding."""
    return (measured.samples.after.numpy() - predicted(model, measured)) * measured.samples.valid.numpy()[..., None]


def predicted(model: Model, measured: Measured) -> Array:
    """The photographs after the strokes, sRGB float32[B, H, W, 3]; 0 in the padding."""
    mark = mark_px(model, measured)
    after = np.zeros(measured.residual_prediction.shape, np.float32)
    with one_openmp_thread():
        for rows, some in measured.batches:
            height, width = some.samples.valid.shape[1:]
            after[rows, :height, :width] = _predicted(model, some, mark[rows])
    return after


def _predicted(model: Model, measured: Measured, mark: Array) -> Array:
    laid = ink_of(mark, model, measured)
    changed = np.flatnonzero((laid.footprint.segment >= 0) | (laid.gain != 1))
    after = measured.samples.before.numpy().copy()
    after.reshape(-1, 3)[changed] = linear_to_srgb(predicted_linear(laid, measured, changed))
    return np.asarray(after + measured.residual_prediction)


def mean_squared_error(residuals: Array, measured: Measured) -> Array:
    """Error of each row over its window, sRGB in [0, 1] squared, [B]. Fits minimise it."""
    pixels = measured.samples.valid.numpy().sum((1, 2)) * 3
    return np.square(residuals).sum((1, 2, 3)) / pixels


def action_losses(model: Model, measured: Measured) -> Array:
    """Weighted mean squared error of each action, sRGB, in the order of the action numbers."""
    rows = measured.weight * mean_squared_error(residual(model, measured), measured)
    _, group = np.unique(measured.action, return_inverse=True)
    return np.bincount(group, rows) / np.bincount(group)


def noise_floor(model: Model, measured: Measured, seed: int) -> Floor | None:
    """The noise floor from residuals of repeated actions; None where too few are repeated.

    Residuals rather than images: predicted differences between repeats (less ink, other paint below) are not noise.
    """
    rest, valid = residual(model, measured), measured.samples.valid.numpy()
    groups = [np.flatnonzero(measured.action == action) for action in np.unique(measured.action)]
    return floor_of_repeats(rest, valid, [rows for rows in groups if (valid[rows] == valid[rows[0]]).all()], seed)
