"""What a model foretells of measured strokes, and how that changes with each of its numbers.

A model is a base and any mechanisms of the vocabulary. The base is the thesis's (half-width by press, a profile, an
amplitude, a blur), each as free as it must be to keep a cause from explaining a plain miscalibration (GAP.md, rule 2):
the half-width a curve over press, the profile a stack of slabs (``imprint``), an offset of each paint's colour, both
ends a little beyond their command and wider. What is left of the mark's own shape comes with the strokes (``habits``).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pentimento.contracts.colour import linear_to_srgb, srgb_to_linear
from pentimento.gap.imprint import LEVELS, Imprint, change_of_coverage, imprint
from pentimento.gap.measured import Measured
from pentimento.stroke_dynamics.mechanisms.geometry import arc_m, tangent
from pentimento.stroke_dynamics.simulation import Mechanism, StrokeContext, extended_mark
from pentimento.stroke_dynamics.traj2stroke import Mark

Array = NDArray[Any]

WIDTHS = tuple(f"half_width_{k}_mm" for k in range(6))
"""Half-width at equal steps from the lightest to the deepest press."""
SLABS = tuple(f"slab_{level:g}" for level in LEVELS)
BASE = (
    *WIDTHS, *SLABS, "density_by_press", "edge_by_press", "log_edge_px", "ends_mm", "side_mm", "ends_widening",
)  # fmt: skip
_COLOR_STEP = 0.01
_MARK_STEP = 1e-4
_THINNEST_M = 1e-5
_UNIT_EDGE = 0.15
"""Softness that stands for the base's edge: so hard that mechanisms that soften it leave the width alone."""
_ROWS_AT_ONCE = 48


@dataclass(frozen=True)
class Model:
    """All numbers of a model, in the order in which Jacobians list them: base, colours, mechanisms."""

    press_m: tuple[float, float]
    """Lightest and deepest press that the base's widths are for."""
    base: Array
    """[len(BASE)]"""
    color_offset: Array
    """[K, 3] linear light, added to each distinct paint."""
    mechanisms: tuple[Mechanism, ...]

    @cached_property
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
            mechanisms.append(type(m)(torch.tensor(values, dtype=torch.float64), m.reference))
            at += len(m.quantities)
        return replace(
            self, base=vector[:n], color_offset=vector[n : n + k].reshape(-1, 3), mechanisms=tuple(mechanisms)
        )

    def plus(self, *mechanisms: Mechanism) -> Model:
        """With more mechanisms."""
        return replace(self, mechanisms=(*self.mechanisms, *mechanisms))

    def without(self, *causes: str) -> Model:
        """With fewer."""
        return replace(self, mechanisms=tuple(m for m in self.mechanisms if m.cause not in causes))

    @property
    def at_work(self) -> tuple[Mechanism, ...]:
        """The mechanisms that change anything: not all of their numbers are 0, where each is the identity."""
        return tuple(m for m in self.mechanisms if bool(m.values.any()))

    def columns_of(self, cause: str) -> Array:
        """Where a mechanism's quantities stand among all numbers."""
        at = self.nuisances
        for m in self.mechanisms:
            if m.cause == cause:
                return np.arange(at, at + len(m.quantities))
            at += len(m.quantities)
        raise KeyError(cause)

    def mark(self, context: StrokeContext) -> Mark:
        """What the strokes leave, [B, S, N]; ``softness`` counts the base's edges, in ``_UNIT_EDGE``."""
        number = dict(zip(BASE, map(float, self.base), strict=True))
        low, high = self.press_m

        def base(path: Tensor) -> Mark:
            press = (-path[..., 3] - low) / (high - low)
            widths = torch.tensor([number[name] for name in WIDTHS], dtype=path.dtype) * 1e-3
            radius = interpolate(widths, press)
            along, arc = tangent(path), arc_m(path)
            points = path[..., 1:3] + number["side_mm"] * 1e-3 * torch.stack([-along[..., 1], along[..., 0]], dim=-1)
            points[..., 0, :] -= number["ends_mm"] * 1e-3 * along[..., 0, :]
            points[..., -1, :] += number["ends_mm"] * 1e-3 * along[..., -1, :]
            middle = widths.mean()
            from_end = torch.minimum(arc, arc[..., -1:] - arc)
            widened = number["ends_widening"] * torch.exp(-from_end / middle)
            density = torch.exp(number["density_by_press"] * (press - 0.5))
            radius = (radius * torch.exp(widened)).clamp(min=_THINNEST_M)
            edge = _UNIT_EDGE * torch.exp(number["edge_by_press"] * (press - 0.5))
            return Mark(points, radius, density, edge)

        return extended_mark(base, self.at_work, context)


def interpolate(values: Tensor, share: Tensor) -> Tensor:
    """The curve through equally spaced values at shares 0 to 1 of the range; level beyond it."""
    place = share.clamp(0.0, 1.0) * (len(values) - 1)
    left = place.floor().clamp(max=len(values) - 2).long()
    t = place - left
    return values[left] * (1 - t) + values[left + 1] * t


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
    return kind(torch.zeros(len(kind.quantities), dtype=torch.float64), kind.reference_of(context))


class Ink(NamedTuple):
    """What a model lays on each window."""

    imprint: Imprint
    paint: Array  # float32[B, 1, 1, 3], or [B, H, W, 3] where paint below is carried along; linear light
    gain: Array  # float32[B, H, W], of the camera on the whole picture


def ink(model: Model, measured: Measured) -> Ink:
    """Coverage, and paint and picture after what the mechanisms do to them."""
    number = dict(zip(BASE, map(float, model.base), strict=True))
    weights = np.array([number[name] for name in SLABS])
    height, width = measured.samples.valid.shape[1:]
    made = imprint(mark_px(model, measured), weights, (height, width))
    return Ink(made, *paint_and_gain(model, measured, made))


def press_shares(model: Model, measured: Measured) -> Array:
    """Press at each point of the paths, 0 the lightest and 1 the deepest that the base is for, float64[B, N]."""
    low, high = model.press_m
    return (-measured.samples.path[..., 3].double().numpy() - low) / (high - low)


def mark_px(model: Model, measured: Measured) -> Array:
    """float64[B, N, 5]: column, row, half-width, density, edge."""
    mark, samples = model.mark(measured.context), measured.samples
    scale = samples.pixels_per_m.double()[:, None, None]
    points = samples.view.to_pixels(mark.points_m)[:, 0]
    edge = np.exp(model.base[BASE.index("log_edge_px")]) / _UNIT_EDGE * mark.softness
    return torch.cat(
        [points, *(v.transpose(1, 2) for v in (mark.radius_m * scale, mark.density, edge))], dim=-1
    ).numpy()


def paint_and_gain(model: Model, measured: Measured, made: Imprint) -> tuple[Array, Array]:
    """The paint that each stroke lays, as ``Ink.paint``, and the camera's gain on the picture, float32[B, H, W]."""
    samples, context = measured.samples, measured.context
    color = srgb_to_linear(samples.color.double().numpy()) + model.color_offset[measured.paint]
    paint, pickup = torch.tensor(color, dtype=torch.float64)[:, None], None
    picture = torch.ones(*made.coverage.shape, 1)
    for mechanism in model.at_work:
        paint, pickup = mechanism.composite(paint, pickup, context)
        if "picture" in _acts_on(mechanism):
            picture = mechanism.camera(picture, samples.view)
    laid = paint[:, 0].numpy().astype(np.float32)[:, None, None]
    if pickup is not None:
        below = samples.before_linear.numpy()
        laid = laid + pickup.numpy().astype(np.float32)[..., None, None] * taken_up(made, laid, below, measured.painted)
    return laid, picture[..., 0].numpy().astype(np.float32)


def taken_up(made: Imprint, paint: Array, below: Array, painted: Array) -> Array:
    """By how much the paint of a tool that takes up all that it crosses differs from its own, float32[B, H, W, 3].

    What is crossed is stirred in on the spot and carried along from there, by the renderer's law (``composition``).
    """
    change = np.zeros_like(below)
    for b in np.flatnonzero((painted * made.coverage).sum((1, 2)) > 0):
        inked = made.segment[b] >= 0
        segment, coverage = made.segment[b][inked], np.maximum(made.coverage[b][inked], 0.0)
        stirred = painted[b][inked][:, None] * (below[b][inked] - paint[b, 0])
        passed = np.cumsum(np.bincount(segment, coverage))
        sums = np.stack([np.cumsum(np.bincount(segment, coverage * stirred[:, c])) for c in range(3)], -1)
        change[b][inked] = stirred + (sums / np.maximum(passed, 1e-6)[:, None])[segment]
    return change


def foretold_linear(laid: Ink, measured: Measured) -> Array:
    """The windows after the strokes, linear light float32[B, H, W, 3]."""
    below = measured.samples.before_linear.numpy()
    mixed = below + laid.imprint.coverage[..., None] * (laid.paint - below)
    return np.maximum(mixed * laid.gain[..., None], 0.0)


def slope_by_coverage(laid: Ink, measured: Measured) -> Array:
    """Derivative of the foretold photographs (sRGB) by coverage, float32[B, H, W, 3]."""
    below = measured.samples.before_linear.numpy()
    steep = _srgb_slope(foretold_linear(laid, measured))
    return np.asarray(steep * (laid.paint - below) * laid.gain[..., None])


def residual(model: Model, measured: Measured) -> Array:
    """Measured less foretold, sRGB float32[B, H, W, 3]; 0 in the padding."""
    return (measured.samples.after.numpy() - foretold(model, measured)) * measured.samples.valid.numpy()[..., None]


def foretold(model: Model, measured: Measured) -> Array:
    """The photographs after the strokes, sRGB float32[B, H, W, 3]."""
    return np.asarray(linear_to_srgb(foretold_linear(ink(model, measured), measured)) + measured.habit)


def mean_squared_error(residuals: Array, measured: Measured) -> Array:
    """Of each row, over its window: sRGB in [0, 1], [B]."""
    pixels = measured.samples.valid.numpy().sum((1, 2)) * 3
    return np.square(residuals).sum((1, 2, 3)) / pixels


def weighted_error(residuals: Array, measured: Measured) -> Array:
    """The same with each pixel's weight, [B]: what fits make small."""
    pixels = measured.samples.valid.numpy().sum((1, 2)) * 3
    whole = (np.square(residuals).sum(3) * measured.weight).sum((1, 2))
    along = (residuals * measured.sway_depth).sum(3) * np.sqrt(measured.weight)
    taken = np.einsum("bkhw,bhw->bk", measured.sway, along, optimize=True)
    return (whole - np.square(taken).sum(1)) / pixels


def change_maps(model: Model, measured: Measured) -> Array:
    """How the model's last numbers, which change the mark, change coverage, float32[P, B, H, W]."""
    _, changes = _changes_of_mark(model, measured)
    return change_of_coverage(ink(model, measured).imprint, changes)


def change_of_photographs(model: Model, measured: Measured, amounts: Array) -> Array:
    """To first order, sRGB float32[B, H, W, 3], by changes [P] of the model's numbers."""
    laid = ink(model, measured)
    linear = foretold_linear(laid, measured)
    number, changes = _changes_of_mark(model, measured)
    drawn = change_of_coverage(laid.imprint, np.tensordot(amounts[number], changes, 1)[None])[0]
    drawn += laid.imprint.by_level @ amounts[len(WIDTHS) : len(WIDTHS) + len(SLABS)].astype(np.float32)
    change = slope_by_coverage(laid, measured) * drawn[..., None]
    steepness = _srgb_slope(linear)
    for p, paint, gain in _changes_of_paint(model, measured, laid.imprint):
        change += steepness * (laid.imprint.coverage * laid.gain)[..., None] * (amounts[p] * paint)
        if gain is not None:
            change += steepness * linear / laid.gain[..., None] * (amounts[p] * gain)[..., None]
    return np.asarray(change, dtype=np.float32)


def sway_depth(model: Model, measured: Measured) -> tuple[Array, Array]:
    """Slope of the weighted photographs by coverage, and the weighted residual, float32[B, H, W, 3] each."""
    weight = (np.sqrt(measured.weight) * measured.samples.valid.numpy())[..., None]
    return slope_by_coverage(ink(model, measured), measured) * weight, residual(model, measured) * weight


class Statistics(NamedTuple):
    """All that tests, held-out gains, bootstraps and designs need of n actions (GAP.md, rule 3).

    Weighted, per pixel: divided by the number of a row's pixels, and averaged over an action's rows.
    """

    curvature: Array  # [n, P, P] J^T J
    slope: Array  # [n, P] J^T r
    energy: Array  # [n] r^T r


def linearise(model: Model, measured: Measured) -> Statistics:
    """Jacobian of the foretold photographs in all numbers of the model, summed up by action."""
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
    """J^T J [B, P, P], J^T r [B, P] and r^T r [B] of each row, over its number of pixels.

    What changes the mark changes all channels of a pixel in one proportion, so that its part of J is kept as one map of
    coverage; only what changes the paint or the picture needs all three.
    """
    laid = ink(model, measured)
    linear = foretold_linear(laid, measured)
    valid = measured.samples.valid.numpy()
    weight = np.sqrt(measured.weight) * valid
    steepness = _srgb_slope(linear) * weight[..., None]
    by_coverage = slope_by_coverage(laid, measured) * weight[..., None]
    by_paint = steepness * (laid.imprint.coverage * laid.gain)[..., None]
    by_gain = steepness * linear / laid.gain[..., None]
    rest = (measured.samples.after.numpy() - linear_to_srgb(linear) - measured.habit) * weight[..., None]

    number, changes = _changes_of_mark(model, measured)
    drawn = change_of_coverage(laid.imprint, changes)
    of_mark = np.concatenate([np.arange(len(WIDTHS), len(WIDTHS) + len(SLABS)), number])
    of_paint = _changes_of_paint(model, measured, laid.imprint)

    curvature = np.zeros((len(measured), len(model.vector), len(model.vector)))
    slope = np.zeros((len(measured), len(model.vector)))
    energy = np.square(rest).sum((1, 2, 3)).astype(np.float64)
    for b in range(len(measured)):
        inked = laid.imprint.segment[b] >= 0
        maps = np.concatenate([laid.imprint.by_level[b][inked].T, drawn[:, b][:, inked]])
        depth = by_coverage[b][inked]
        curvature[b][np.ix_(of_mark, of_mark)] = (maps * np.square(depth).sum(1)) @ maps.T
        slope[b][of_mark] = maps @ (depth * rest[b][inked]).sum(1)
        sway, sway_depth_b = measured.sway[b][:, inked], measured.sway_depth[b]
        along = np.zeros((len(sway), len(model.vector)))
        along[:, of_mark] = (sway * (depth * sway_depth_b[inked]).sum(1)) @ maps.T
        pictures = {
            p: by_paint[b] * paint[b] + (0 if gain is None else by_gain[b] * gain[b][..., None])
            for p, paint, gain in of_paint
            if gain is not None or paint[b].any()
        }
        taken = measured.sway[b].reshape(len(sway), inked.size) @ (sway_depth_b * rest[b]).sum(-1).ravel()
        energy[b] -= taken @ taken
        if not pictures:
            curvature[b] -= along.T @ along
            slope[b] -= taken @ along
            continue
        index, whole = np.array(list(pictures)), np.stack(list(pictures.values()))
        along[:, index] += (
            measured.sway[b].reshape(len(sway), inked.size) @ (whole * sway_depth_b).sum(-1).reshape(len(index), -1).T
        )
        cross = maps @ (whole[:, inked] * depth).sum(-1).T
        flat = whole.reshape(len(index), -1)
        # A mechanism may act on the mark and on the paint: its two parts add up.
        curvature[b][np.ix_(of_mark, index)] += cross
        curvature[b][np.ix_(index, of_mark)] += cross.T
        curvature[b][np.ix_(index, index)] += flat @ flat.T
        slope[b][index] += flat @ rest[b].ravel()
        curvature[b] -= along.T @ along
        slope[b] -= taken @ along
    pixels = valid.sum((1, 2)) * 3
    return curvature / pixels[:, None, None], slope / pixels[:, None], energy / pixels


def _changes_of_mark(model: Model, measured: Measured) -> tuple[Array, Array]:
    """Numbers that change marks, and the marks' derivatives by them, [P', B, N, 5]: central differences."""
    acts = np.array(
        [name not in SLABS for name in BASE]
        + [False] * model.color_offset.size
        + ["mark" in _acts_on(m) for m in model.mechanisms for _ in m.quantities]
    )
    number = np.flatnonzero(acts)
    steps = _MARK_STEP * np.eye(len(acts))

    def moved(step: Array) -> Array:
        up, down = (mark_px(model.at(model.vector + sign * step), measured) for sign in (1, -1))
        return np.asarray((up - down) / (2 * _MARK_STEP))

    return number, np.stack([moved(steps[p]) for p in number])


def _changes_of_paint(model: Model, measured: Measured, made: Imprint) -> list[tuple[int, Array, Array | None]]:
    """Number, and the derivatives by it of the paint (as ``Ink.paint``) and, if it is the camera's, of the gain."""
    changes: list[tuple[int, Array, Array | None]] = []
    for p in range(model.color_offset.size):
        one_hot = np.eye(3, dtype=np.float32)[p % 3] * (measured.paint == p // 3)[:, None]
        changes.append((len(model.base) + p, one_hot[:, None, None], None))
    at = model.nuisances
    for mechanism in model.mechanisms:
        for _ in mechanism.quantities:
            if _acts_on(mechanism) & {"paint", "picture"}:
                step = _COLOR_STEP * (np.arange(len(model.vector)) == at)
                up, down = (paint_and_gain(model.at(model.vector + sign * step), measured, made) for sign in (1, -1))
                gain = (up[1] - down[1]) / (2 * _COLOR_STEP) if "picture" in _acts_on(mechanism) else None
                changes.append((at, (up[0] - down[0]) / (2 * _COLOR_STEP), gain))
            at += 1
    return changes


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
