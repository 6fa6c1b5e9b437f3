"""What a model foretells of measured strokes, and how that changes with each of its numbers.

A model is the thesis's base (half-width = alpha * press + beta, softness c) with nuisances that keep a cause from
explaining a plain miscalibration: an amplitude, a constant blur, an offset of each paint's colour, a width that levels
off under press, a mark that begins and ends a little beside its command; and any mechanisms of the vocabulary.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pentimento.contracts.colour import linear_to_srgb, srgb_to_linear
from pentimento.gap.measured import Measured
from pentimento.render import render
from pentimento.stroke_dynamics.mechanisms.geometry import tangent
from pentimento.stroke_dynamics.simulation import Mechanism, StrokeContext, extended_mark
from pentimento.stroke_dynamics.traj2stroke import Mark

Array = NDArray[Any]

_STEP_OF_BASE = {
    "alpha": 0.02,
    "saturation_mm": 0.05,
    "beta_mm": 0.03,
    "log_softness": 0.05,
    "amplitude": 0.02,
    "log_blur_px": 0.05,
    "start_mm": 0.1,
    "end_mm": 0.1,
    "side_mm": 0.05,
}
BASE = tuple(_STEP_OF_BASE)
_BASE_STEP = np.array(list(_STEP_OF_BASE.values()))
_COLOR_STEP = 0.01
_MECHANISM_STEP = 0.2  # of a quantity's typical size
_THINNEST_M = 1e-4
_ROWS_AT_ONCE = 48


@dataclass(frozen=True)
class Model:
    """All numbers of a model, in the order in which Jacobians list them: base, colours, mechanisms."""

    base: Array
    """[len(BASE)]"""
    color_offset: Array
    """[K, 3] linear light, added to each distinct paint."""
    mechanisms: tuple[Mechanism, ...]

    @property
    def vector(self) -> Array:
        """All numbers; a mechanism's in units of what is typical."""
        parts = [self.base, self.color_offset.ravel()]
        parts += [m.values.double().numpy() / _typical(m) for m in self.mechanisms]
        return np.concatenate(parts)

    @property
    def nuisances(self) -> int:
        """How many come before the mechanisms' quantities."""
        return len(self.base) + self.color_offset.size

    def at(self, vector: Array) -> Model:
        """The same model with other numbers."""
        n, k = len(self.base), self.color_offset.size
        mechanisms, at = [], n + k
        for m in self.mechanisms:
            values = vector[at : at + len(m.quantities)] * _typical(m)
            mechanisms.append(type(m)(torch.tensor(values, dtype=torch.float32), m.reference))
            at += len(m.quantities)
        return Model(vector[:n], vector[n : n + k].reshape(-1, 3), tuple(mechanisms))

    def plus(self, *mechanisms: Mechanism) -> Model:
        """With more mechanisms."""
        return replace(self, mechanisms=(*self.mechanisms, *mechanisms))

    def acts_on(self) -> list[set[str]]:
        """What each number changes: the mark, the paint, the picture."""
        acts = [{"mark"}] * len(self.base) + [{"paint"}] * self.color_offset.size
        return acts + [_acts_on(m) for m in self.mechanisms for _ in m.quantities]

    def steps(self) -> Array:
        """Of numerical derivatives."""
        quantities = sum(len(m.quantities) for m in self.mechanisms)
        colors = np.full(self.color_offset.size, _COLOR_STEP)
        return np.concatenate([_BASE_STEP, colors, np.full(quantities, _MECHANISM_STEP)])


def _acts_on(mechanism: Mechanism) -> set[str]:
    kind = type(mechanism)
    overridden = {"mark": kind.mark, "paint": kind.composite, "picture": kind.camera}
    plain = {"mark": Mechanism.mark, "paint": Mechanism.composite, "picture": Mechanism.camera}
    return {name for name, method in overridden.items() if method is not plain[name]}


def _typical(mechanism: Mechanism) -> Array:
    return np.array([quantity.typical for quantity in mechanism.quantities])


def identity(kind: type[Mechanism], context: StrokeContext) -> Mechanism:
    """A mechanism that changes nothing yet.

    Raises:
        NotObservable: these strokes cannot show it.
    """
    return kind(torch.zeros(len(kind.quantities)), kind.reference_of(context))


class Ink(NamedTuple):
    """What a model lays on each window."""

    coverage: Array  # float32[B, H, W]
    paint: Array  # float32[B, 3] linear light
    gain: Array  # float32[B, H, W], of the camera on the whole picture


def ink(model: Model, measured: Measured) -> Ink:
    """Coverage after blur, paint and picture after what the mechanisms do to them."""
    drawn = coverage(model, measured)
    return Ink(drawn, *paint_and_gain(model, measured, drawn))


def coverage(model: Model, measured: Measured) -> Array:
    """How much of each pixel the stroke covers, blurred, float32[B, H, W]."""
    samples = measured.samples
    alpha, saturation_mm, beta_mm, log_softness, amplitude, log_blur, start_mm, end_mm, side_mm = map(float, model.base)
    height, width = samples.valid.shape[1:]
    deepest = float((-samples.path[..., 3]).max().clamp(min=1e-6))

    def base(path: Tensor) -> Mark:
        press = (-path[..., 3]).clamp(min=0.0)
        share = press / deepest
        radius = alpha * press + (beta_mm + 4 * saturation_mm * share * (1 - share)) * 1e-3
        softness = torch.full_like(press, float(np.exp(log_softness)))
        along = tangent(path)
        points = path[..., 1:3] + side_mm * 1e-3 * torch.stack([-along[..., 1], along[..., 0]], dim=-1)
        points[..., 0, :] -= start_mm * 1e-3 * along[..., 0, :]
        points[..., -1, :] += end_mm * 1e-3 * along[..., -1, :]
        return Mark(points, radius.clamp(min=_THINNEST_M), torch.full_like(press, amplitude), softness)

    mark = extended_mark(base, model.mechanisms, measured.context)
    drawn, _ = render(
        samples.view.to_pixels(mark.points_m).numpy(),
        (mark.radius_m * samples.pixels_per_m[:, None, None]).numpy(),
        mark.density.numpy(),
        mark.softness.numpy(),
        np.ones((len(measured), 1, 3), np.float32),
        np.zeros((len(measured), height, width, 3), np.float32),
    )
    sigma = float(np.exp(log_blur))
    return np.stack([cv2.GaussianBlur(np.ascontiguousarray(image[..., 0]), (0, 0), sigma) for image in drawn])


def paint_and_gain(model: Model, measured: Measured, drawn: Array) -> tuple[Array, Array]:
    """The paint that each stroke lays, float32[B, 3], and the camera's gain on the picture, float32[B, H, W]."""
    samples, context = measured.samples, measured.context
    color = srgb_to_linear(samples.color.double().numpy()) + model.color_offset[measured.paint]
    paint, pickup = torch.tensor(color, dtype=torch.float32)[:, None], None
    picture = torch.ones(*drawn.shape, 1)
    for mechanism in model.mechanisms:
        paint, pickup = mechanism.composite(paint, pickup, context)
        if "picture" in _acts_on(mechanism):
            picture = mechanism.camera(picture, samples.view)
    laid = paint[:, 0].numpy()
    if pickup is not None:
        below = samples.before_linear.numpy()
        wet = drawn * measured.painted
        carried = np.einsum("bhw,bhwc->bc", wet, below) - wet.sum((1, 2))[:, None] * laid
        laid = laid + pickup.numpy() * carried / np.maximum(drawn.sum((1, 2)), 1e-6)[:, None]
    return laid, picture[..., 0].numpy()


def foretold_linear(laid: Ink, measured: Measured) -> Array:
    """The windows after the strokes, linear light float32[B, H, W, 3]."""
    below = measured.samples.before_linear.numpy()
    mixed = below + laid.coverage[..., None] * (laid.paint[:, None, None] - below)
    return np.maximum(mixed * laid.gain[..., None], 0.0)


def residual(model: Model, measured: Measured) -> Array:
    """Measured less foretold, sRGB float32[B, H, W, 3]; 0 in the padding."""
    foretold = linear_to_srgb(foretold_linear(ink(model, measured), measured))
    return (measured.samples.after.numpy() - foretold) * measured.samples.valid.numpy()[..., None]


def mean_squared_error(residuals: Array, measured: Measured) -> Array:
    """Of each row, over its window: sRGB in [0, 1], [B]."""
    pixels = measured.samples.valid.numpy().sum((1, 2)) * 3
    return np.square(residuals).sum((1, 2, 3)) / pixels


class Statistics(NamedTuple):
    """All that tests, held-out gains, bootstraps and designs need of n actions (GAP.md, rule 3).

    Per pixel: divided by the number of a row's pixels, and averaged over an action's rows.
    """

    curvature: Array  # [n, P, P] J^T J
    slope: Array  # [n, P] J^T r
    energy: Array  # [n] r^T r


def linearise(model: Model, measured: Measured) -> Statistics:
    """Jacobian of the foretold photographs in all numbers of the model, summed up by action.

    Derivatives are central differences of the renderer at steps of a tenth of a pixel or so: a stroke's rim is a jump,
    whose motion a pointwise derivative would miss.
    """
    return Statistics(*(_by_action(values, measured.action) for values in linearise_rows(model, measured)))


def linearise_rows(model: Model, measured: Measured) -> tuple[Array, Array, Array]:
    """The same of each row: J^T J [B, P, P], J^T r [B, P], r^T r [B]."""
    parts = [
        _row_statistics(model, measured.pick(np.arange(first, min(first + _ROWS_AT_ONCE, len(measured)))))
        for first in range(0, len(measured), _ROWS_AT_ONCE)
    ]
    curvature, slope, energy = (np.concatenate(values) for values in zip(*parts, strict=True))
    return curvature, slope, energy


def _row_statistics(model: Model, measured: Measured) -> tuple[Array, Array, Array]:
    """J^T J [B, P, P], J^T r [B, P] and r^T r [B] of each row, over its number of pixels."""
    centre = ink(model, measured)
    below = measured.samples.before_linear.numpy()
    foretold = foretold_linear(centre, measured)
    valid = measured.samples.valid.numpy()[..., None]
    steepness = _srgb_slope(foretold) * valid
    by_coverage = steepness * (centre.paint[:, None, None] - below) * centre.gain[..., None]
    by_paint = steepness * (centre.coverage * centre.gain)[..., None]
    by_gain = steepness * foretold / centre.gain[..., None]
    rest = (measured.samples.after.numpy() - linear_to_srgb(foretold)) * valid

    vector, steps = model.vector, model.steps()
    jacobian = np.empty((len(vector), *rest.shape), np.float32)
    for p, (step, acts) in enumerate(zip(steps, model.acts_on(), strict=True)):
        up, down = (model.at(vector + sign * step * (np.arange(len(vector)) == p)) for sign in (1, -1))
        change = np.zeros_like(rest)
        if "mark" in acts:
            change += by_coverage * (coverage(up, measured) - coverage(down, measured))[..., None]
        if "paint" in acts or "picture" in acts:
            (paint_up, gain_up), (paint_down, gain_down) = (
                paint_and_gain(m, measured, centre.coverage) for m in (up, down)
            )
            change += by_paint * (paint_up - paint_down)[:, None, None]
            if "picture" in acts:
                change += by_gain * (gain_up - gain_down)[..., None]
        jacobian[p] = change / (2 * step)
    pixels = valid.sum((1, 2, 3)) * 3
    flat = jacobian.reshape(len(vector), len(measured), -1).transpose(1, 0, 2)
    rest = rest.reshape(len(measured), -1)
    curvature = np.stack([j @ j.T for j in flat]).astype(np.float64) / pixels[:, None, None]
    slope = np.stack([j @ r for j, r in zip(flat, rest, strict=True)]).astype(np.float64) / pixels[:, None]
    return curvature, slope, np.square(rest).sum(1).astype(np.float64) / pixels


def _by_action(values: Array, action: Array) -> Array:
    """Means over the rows of each action, in the order of the actions' numbers."""
    _, group, count = np.unique(action, return_inverse=True, return_counts=True)
    sums = np.zeros((len(count), *values.shape[1:]))
    np.add.at(sums, group, values)
    return sums / count.reshape(-1, *[1] * (values.ndim - 1))


def _srgb_slope(linear: Array) -> Array:
    """d sRGB / d linear light."""
    steep = np.float32(1.055 / 2.4) * np.maximum(linear, np.float32(0.0031308)) ** np.float32(1 / 2.4 - 1)
    return np.where(linear <= 0.0031308, np.float32(12.92), steep)
