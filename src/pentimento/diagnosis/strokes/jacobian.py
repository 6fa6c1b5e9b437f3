"""The Jacobian of predicted photographs, summed up by action.

Derivatives of marks are differences; from there to pixels the footprint has analytic derivatives. Paint and gain use
central differences. All parameters of a row share one pass over its pixels.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.colour import linear_to_srgb
from pentimento.diagnosis.batches import one_openmp_thread
from pentimento.diagnosis.gauss_newton import Statistics, by_action
from pentimento.diagnosis.strokes.measured import Measured
from pentimento.diagnosis.strokes.model import BASE, SLABS, WIDTHS, Model, acts_on
from pentimento.diagnosis.strokes.predict import (
    Ink,
    at_pixels,
    gain_of_camera,
    ink_of,
    mark_px,
    marks_px,
    paint_at,
    paint_laid,
    predicted_linear,
)
from pentimento.diagnosis.strokes.soft_edge import Footprint, change_of_coverage, mixture, slopes_of_mixture

Array = NDArray[Any]

_MIXING = BASE.index("mixing")
_COLOR_STEP = 0.01
"""Step of central differences of paint, gain and mixing, in the parameter's unit."""
_MARK_STEP = 1e-5
"""Step of differences of marks."""


def slope_by_coverage(laid: Ink, measured: Measured) -> Array:
    """Derivative of the predicted photographs (sRGB) by coverage, float32[B, H, W, 3]."""
    _, steepness = _srgb_and_slope(predicted_linear(laid, measured))
    return steepness * _slopes(laid, measured)[0]


def change_of_photographs(model: Model, measured: Measured, amounts: Array) -> Array:
    """First-order change of the photographs, sRGB float32[B, H, W, 3], by changes ``amounts`` [P] of the parameters."""
    mark, (number, changes) = mark_px(model, measured), _changes_of_mark(model, measured)
    change = np.tensordot(amounts[number], changes, 1)
    changed = np.zeros(measured.residual_prediction.shape, np.float32)
    with one_openmp_thread():
        for rows, some in measured.batches:
            height, width = some.samples.valid.shape[1:]
            changed[rows, :height, :width] = _change_of_photographs(model, some, amounts, mark[rows], change[rows])
    return changed


def _change_of_photographs(
    model: Model, measured: Measured, amounts: Array, mark: Array, change_of_mark: Array
) -> Array:
    laid = ink_of(mark, model, measured)
    linear = predicted_linear(laid, measured)
    inked = np.flatnonzero(laid.footprint.segment >= 0)
    drawn = np.zeros_like(laid.footprint.coverage)
    drawn.ravel()[inked] = change_of_coverage(laid.footprint, change_of_mark[None], inked)[:, 0]
    drawn += laid.footprint.by_level @ amounts[len(WIDTHS) : len(WIDTHS) + len(SLABS)].astype(np.float32)
    _, steepness = _srgb_and_slope(linear)
    by_coverage, by_paint = _slopes(laid, measured)
    change = steepness * by_coverage * drawn[..., None]
    if not model.mixes_in_light:
        change += steepness * amounts[_MIXING] * _by_mixing(laid, measured)
    for p, paint, gain in _changes_of_paint(model, measured, laid.footprint):
        change += steepness * by_paint * (amounts[p] * paint)
        if gain is not None:
            change += steepness * linear / laid.gain[..., None] * (amounts[p] * gain)[..., None]
    return np.asarray(change, dtype=np.float32)


def linearise(model: Model, measured: Measured) -> Statistics:
    """The statistics of the model on these strokes: its Jacobian in all parameters, summed up by action."""
    return Statistics(*(by_action(values, measured.action) for values in linearise_rows(model, measured)))


def linearise_rows(model: Model, measured: Measured) -> Statistics:
    """The same for each row, weighted: J^T J [B, P, P], J^T r [B, P], r^T r [B]."""
    mark, (number, changes) = mark_px(model, measured), _changes_of_mark(model, measured)
    size = len(model.vector)
    curvature, slope = np.empty((len(measured), size, size)), np.empty((len(measured), size))
    energy, weight = np.empty(len(measured)), measured.weight
    with one_openmp_thread():
        for rows, some in measured.batches:
            own = _row_statistics(model, some, mark[rows], number, changes[:, rows])
            curvature[rows], slope[rows], energy[rows] = own
    return Statistics(curvature * weight[:, None, None], slope * weight[:, None], energy * weight)


def _row_statistics(model: Model, measured: Measured, mark: Array, number: Array, changes: Array) -> Statistics:
    """J^T J [B, P, P], J^T r [B, P] and r^T r [B] of each row, over its number of pixels.

    A parameter of the mark changes all channels of a pixel in proportion, so that its part of J is one map of coverage.
    Only parameters of paint or picture need all three channels.

    Args:
        mark: of the model, as from ``mark_px``.
        number: parameters that change marks, as from ``_changes_of_mark``.
        changes: derivatives of the marks, likewise.
    """
    laid = ink_of(mark, model, measured)
    of_mark = np.concatenate([np.arange(len(WIDTHS), len(WIDTHS) + len(SLABS)), number])
    of_paint = _changes_of_paint(model, measured, laid.footprint)
    inked = laid.footprint.segment >= 0  # other pixels change with the camera only
    first = np.concatenate([[0], np.cumsum(inked.sum((1, 2)))])
    pixels = np.flatnonzero(inked)

    samples, valid = measured.samples, measured.samples.valid.numpy()
    linear = predicted_linear(laid, measured, pixels)
    srgb, steepness = _srgb_and_slope(linear)
    steepness *= at_pixels(valid, pixels)[:, None]
    by_coverage, by_paint = (steepness * slope for slope in _slopes(laid, measured, pixels))
    by_mixing = None if model.mixes_in_light else steepness * _by_mixing(laid, measured, pixels)
    by_gain = steepness * linear / at_pixels(laid.gain, pixels)[:, None]
    rest = (samples.after.numpy() - samples.before.numpy() - measured.residual_prediction) * valid[..., None]
    change = (srgb - at_pixels(samples.before.numpy(), pixels)) * at_pixels(valid, pixels)[:, None]
    missing = at_pixels(rest, pixels) - change
    rest.reshape(-1, 3)[pixels] = missing

    by_level = at_pixels(laid.footprint.by_level, pixels)
    maps = np.concatenate([by_level, change_of_coverage(laid.footprint, changes, pixels)], axis=1)
    curvature = np.zeros((len(measured), len(model.vector), len(model.vector)))
    slope = np.zeros((len(measured), len(model.vector)))
    of_mark_twice = of_mark[:, None], of_mark
    for b in range(len(measured)):
        own = slice(first[b], first[b + 1])
        drawn, depth = maps[own], by_coverage[own]
        curvature[b][of_mark_twice] = drawn.T @ (drawn * np.square(depth).sum(1, keepdims=True))
        slope[b][of_mark] = (depth * missing[own]).sum(1) @ drawn
        pictures = {
            p: by_paint[own] * (paint[b, 0, 0] if paint[b].size == 3 else paint[b][inked[b]])
            + (0 if gain is None else by_gain[own] * gain[b][inked[b]][:, None])
            for p, paint, gain in of_paint
            if gain is not None or paint[b].any()
        }
        if by_mixing is not None:
            pictures[_MIXING] = by_mixing[own]
        if not pictures:
            continue
        index, whole = np.array(list(pictures)), np.stack(list(pictures.values()))
        cross = drawn.T @ (whole * depth).sum(-1).T
        flat = whole.reshape(len(index), -1)
        # A mechanism may act on mark and paint: the two parts add.
        curvature[b][np.ix_(of_mark, index)] += cross
        curvature[b][np.ix_(index, of_mark)] += cross.T
        curvature[b][np.ix_(index, index)] += flat @ flat.T
        slope[b][index] += flat @ missing[own].ravel()
    if gains := {p: gain for p, _, gain in of_paint if gain is not None}:
        _add_bare_ground(curvature, slope, rest, gains=gains, laid=laid, measured=measured)
    energy = np.square(rest).sum((1, 2, 3)).astype(np.float64)
    count = valid.sum((1, 2)) * 3
    return Statistics(curvature / count[:, None, None], slope / count[:, None], energy / count)


def _add_bare_ground(
    curvature: Array, slope: Array, rest: Array, *, gains: dict[int, Array], laid: Ink, measured: Measured
) -> None:
    """Add to the sums the pixels without ink, which change with the camera's gain only.

    ``rest`` [B, H, W, 3] gets the residual at these pixels.

    Args:
        gains: by parameter index, derivative of the gain, [B, H, W].
    """
    index, maps = np.array(list(gains)), np.stack(list(gains.values()))
    bare = (laid.footprint.segment < 0) & (measured.samples.valid.numpy() > 0)
    before, before_linear = measured.samples.before.numpy(), measured.samples.before_linear.numpy()
    for b, here in enumerate(bare):
        below, gain = before_linear[b][here], laid.gain[b][here][:, None]
        srgb, steepness = _srgb_and_slope(below * gain)
        missing = rest[b][here] - (srgb - before[b][here])
        rest[b][here] = missing
        by_gain, own = steepness * below, maps[:, b][:, here]
        curvature[b][np.ix_(index, index)] += (own * np.square(by_gain).sum(1)) @ own.T
        slope[b][index] += own @ (by_gain * missing).sum(1)


def _changes_of_mark(model: Model, measured: Measured) -> tuple[Array, Array]:
    """Indices of parameters that change marks, and the marks' derivatives by them, [P', B, N, 5].

    Active mechanisms are differenced together, one-sided. An inactive mechanism is differenced on both sides, with the
    active ones and without the other inactive ones, because its form may have a kink at 0.
    """
    drawing = [m for m in model.mechanisms if "mark" in acts_on(m)]
    busy = [m for m in drawing if m.active]
    of_base = np.array([i for i, name in enumerate(BASE) if name not in (*SLABS, "mixing")])
    number = np.concatenate([of_base, *(model.columns_of(m.cause) for m in busy)])
    steps = _MARK_STEP * np.eye(len(model.vector))
    marks = marks_px(model, busy, model.vector + np.insert(steps[number], 0, 0.0, axis=0), measured)
    parts = [(number, (marks[1:] - marks[0]) / _MARK_STEP)]
    for mechanism in drawing:
        if not mechanism.active:
            number = model.columns_of(mechanism.cause)
            with_it = [m for m in drawing if m is mechanism or m.active]
            both = model.vector + np.concatenate([steps[number], -steps[number]])
            up, down = np.split(marks_px(model, with_it, both, measured), 2)
            parts.append((number, (up - down) / (2 * _MARK_STEP)))
    numbers, slopes = zip(*parts, strict=True)
    return np.concatenate(numbers), np.concatenate(slopes)


def _changes_of_paint(model: Model, measured: Measured, footprint: Footprint) -> list[tuple[int, Array, Array | None]]:
    """(index, derivative of the paint as ``Ink.paint``, derivative of the gain or None) of parameters of paint and
    camera.
    """
    changes: list[tuple[int, Array, Array | None]] = []
    for p in range(model.color_offset.size):
        one_hot = np.eye(3, dtype=np.float32)[p % 3] * (measured.paint == p // 3)[:, None]
        changes.append((len(model.base) + p, one_hot[:, None, None], None))
    none: Array = np.zeros((len(measured), 1, 1, 3), np.float32)
    for mechanism in model.mechanisms:
        of_paint, of_picture = (name in acts_on(mechanism) for name in ("paint", "picture"))
        for at in model.columns_of(mechanism.cause) if of_paint or of_picture else ():
            step = _COLOR_STEP * (np.arange(len(model.vector)) == at)
            up, down = model.at(model.vector + step), model.at(model.vector - step)
            paint, gain = none, None
            if of_paint:
                paint = (paint_laid(up, measured, footprint) - paint_laid(down, measured, footprint)) / (
                    2 * _COLOR_STEP
                )
            if of_picture:
                gain = (gain_of_camera(up, measured) - gain_of_camera(down, measured)) / (2 * _COLOR_STEP)
            changes.append((int(at), paint, gain))
    return changes


def _slopes(laid: Ink, measured: Measured, pixels: Array | None = None) -> tuple[Array, Array]:
    """Derivatives of the windows' linear light by coverage and by paint, [..., 3], as from ``at_pixels``."""
    gain = at_pixels(laid.gain, pixels)[..., None]
    slopes = slopes_of_mixture(*_layers(laid, measured, pixels), laid.power)
    by_coverage, by_paint = (slope * gain for slope in slopes)
    return by_coverage, by_paint


def _by_mixing(laid: Ink, measured: Measured, pixels: Array | None = None) -> Array:
    """Derivative of the windows' linear light by ``mixing``: central differences."""
    layers = _layers(laid, measured, pixels)
    up, down = (mixture(*layers, laid.power * np.exp(sign * _COLOR_STEP)) for sign in (1, -1))
    return np.asarray((up - down) / (2 * _COLOR_STEP) * at_pixels(laid.gain, pixels)[..., None])


class _Layers(NamedTuple):
    """Paint on its ground, as arguments of ``mixture``; linear light as from ``at_pixels``."""

    below: Array
    paint: Array
    coverage: Array


def _layers(laid: Ink, measured: Measured, pixels: Array | None) -> _Layers:
    below = at_pixels(measured.samples.before_linear.numpy(), pixels)
    return _Layers(below, paint_at(laid, pixels), at_pixels(laid.footprint.coverage, pixels)[..., None])


def _srgb_and_slope(linear: Array) -> tuple[Array, Array]:
    """sRGB, and d sRGB / d linear light."""
    srgb = linear_to_srgb(linear)
    steep = (srgb + np.float32(0.055)) / (np.float32(2.4) * np.maximum(linear, np.float32(0.0031308)))
    return srgb, np.where(linear <= 0.0031308, np.float32(12.92), steep)
