"""What a model foretells of measured strokes.

A model is a base and any mechanisms of the vocabulary. The base is the thesis's (half-width by press, a profile, an
amplitude, a blur), each as free as it must be to keep a cause from explaining a plain miscalibration (GAP.md, rule 2):
the half-width a curve over press, the profile a stack of slabs (``imprint``), an offset of each paint's colour, a power
of light in which paint and ground mix, both ends a little beyond their command and wider. What is left of the mark's
own shape comes with the strokes (``learned_residual``).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.func import vmap

from pentimento.contracts.colour import linear_to_srgb, srgb_to_linear
from pentimento.diagnosis.batches import in_batches, one_openmp_thread
from pentimento.diagnosis.strokes.measured import Measured
from pentimento.diagnosis.strokes.mixture import mixture
from pentimento.diagnosis.strokes.paint_pickup import picked_up
from pentimento.diagnosis.strokes.soft_edge import LEVELS, Imprint, imprint
from pentimento.dynamics.strokes.mechanisms.geometry import arc_m, bending_per_m, moved_ends, tangent
from pentimento.dynamics.strokes.simulation import Mechanism, StrokeContext, extended_mark
from pentimento.dynamics.strokes.traj2stroke import Mark

Array = NDArray[Any]

PRESSES = tuple(np.expm1(np.linspace(0, np.log(4), 12)) / 3)
"""Shares of the range from the lightest to the deepest press at which the base has a half-width of its own: closer
together where the tool just touches. Fewer leave a misfit, for a tip has a knee, from where it spreads no further.
"""
WIDTHS = tuple(f"half_width_{k}_mm" for k in range(len(PRESSES)))
SLABS = tuple(f"slab_{level:g}" for level in LEVELS)
BASE = (
    *WIDTHS, *SLABS, "density_by_press", "edge_by_press", "log_edge_px", "ends_mm", "side_mm", "outward_mm",
    "ends_widening", "mixing",
)  # fmt: skip
"""``mixing``: paint and ground mix in light to the power of ``exp(mixing)``: 0 is linear light, about -0.8 the
numbers of an sRGB picture, far below that a filter that dims by a share."""
ROWS_AT_ONCE = 24
_OUTERMOST = 3  # pieces of the half-width's curve
_THINNEST_M = 1e-5
_TIGHT_M = 0.02
"""Radius of a bend to whose outer side a mark lies by ``outward_mm``, also where no cause is at work."""
_UNIT_EDGE = 0.15
"""Softness that stands for the base's edge: so hard that mechanisms that soften it leave the width alone."""


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
    def mixes_in_light(self) -> bool:
        """Whether paint and ground mix in linear light, which a fit then leaves at that: no Jacobian has ``mixing``."""
        return bool(self.base[BASE.index("mixing")] == 0)

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
        """The mechanisms that change anything."""
        return tuple(m for m in self.mechanisms if not m.idle)

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
        return _mark(self.press_m, torch.tensor(self.base, dtype=torch.float64), self.at_work, context)


def _mark(press_m: tuple[float, float], base: Tensor, mechanisms: Sequence[Mechanism], context: StrokeContext) -> Mark:
    """See ``Model.mark``; ``base`` [len(BASE)]."""
    number = dict(zip(BASE, base, strict=True))
    low, high = press_m

    def plain(path: Tensor) -> Mark:
        press = (-path[..., 3] - low) / (high - low)
        widths = base[: len(WIDTHS)] * 1e-3
        radius = interpolate(widths, press)
        along, arc = tangent(path), arc_m(path)
        bend = (bending_per_m(path) * _TIGHT_M).clamp(-2.0, 2.0)
        left_mm = number["side_mm"] - number["outward_mm"] * bend[..., None]
        points = path[..., 1:3] + left_mm * 1e-3 * torch.stack([-along[..., 1], along[..., 0]], dim=-1)
        middle = widths.mean()
        ends_m = number["ends_mm"] * 1e-3
        points, radius = moved_ends(points, radius, path, ends_m, ends_m)
        from_end = torch.minimum(arc, arc[..., -1:] - arc)
        widened = number["ends_widening"] * torch.exp(-from_end / middle)
        density = torch.exp(number["density_by_press"] * (press - 0.5))
        radius = (radius * torch.exp(widened)).clamp(min=_THINNEST_M)
        edge = _UNIT_EDGE * torch.exp(number["edge_by_press"] * (press - 0.5))
        return Mark(points, radius, density, edge)

    return extended_mark(plain, mechanisms, context)


def interpolate(values: Tensor, share: Tensor) -> Tensor:
    """The curve through ``values`` at the shares ``PRESSES`` of the range of presses, straight between them; beyond the
    range as steep as over the outermost pieces.
    """
    knots = torch.tensor(PRESSES, dtype=share.dtype)
    within = share.clamp(0.0, 1.0)
    right = torch.searchsorted(knots, within.detach().contiguous()).clamp(1, len(values) - 1)
    t = (within - knots[right - 1]) / (knots[right] - knots[right - 1])
    below = (values[_OUTERMOST] - values[0]) / (knots[_OUTERMOST] - knots[0]) * share.clamp(max=0.0)
    last = -1 - _OUTERMOST
    above = (values[-1] - values[last]) / (knots[-1] - knots[last]) * (share - 1.0).clamp(min=0.0)
    return values[right - 1] * (1 - t) + values[right] * t + below + above


def acts_on(mechanism: Mechanism) -> set[str]:
    """Of mark, paint and picture, what it changes."""
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
    power: float  # of linear light, in which paint and what is below mix


def ink(model: Model, measured: Measured) -> Ink:
    """Coverage, and paint and picture after what the mechanisms do to them."""
    return ink_of(mark_px(model, measured), model, measured)


def ink_of(mark: Array, model: Model, measured: Measured) -> Ink:
    """The same where the model's mark, as ``mark_px``, is known."""
    number = dict(zip(BASE, map(float, model.base), strict=True))
    weights = np.array([number[name] for name in SLABS])
    height, width = measured.samples.valid.shape[1:]
    made = imprint(mark, weights, (height, width))
    paint, gain = paint_laid(model, measured, made), gain_of_camera(model, measured)
    return Ink(made, paint, gain, float(np.exp(number["mixing"])))


def press_shares(model: Model, measured: Measured) -> Array:
    """Press at each point of the paths, 0 the lightest and 1 the deepest that the base is for, float64[B, N]."""
    low, high = model.press_m
    return (-measured.samples.path[..., 3].double().numpy() - low) / (high - low)


def mark_px(model: Model, measured: Measured) -> Array:
    """float64[B, N, 5]: column, row, half-width, density, edge."""
    base = torch.tensor(model.base, dtype=torch.float64)
    with one_openmp_thread():
        return _mark_px(model.press_m, base, model.at_work, measured).numpy()


def marks_px(model: Model, mechanisms: Sequence[Mechanism], vectors: Array, measured: Measured) -> Array:
    """The marks of a model at many numbers at once, float64[K, B, N, 5] as ``mark_px``.

    Args:
        mechanisms: those of the model that are at work; the others are left out.
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


def paint_laid(model: Model, measured: Measured, made: Imprint) -> Array:
    """The paint that each stroke lays, as ``Ink.paint``."""
    samples = measured.samples
    color = srgb_to_linear(samples.color.double().numpy()) + model.color_offset[measured.paint]
    paint, pickup = torch.tensor(color, dtype=torch.float64)[:, None], None
    for mechanism in model.at_work:
        paint, pickup = mechanism.composite(paint, pickup, measured.context)
    laid = paint[:, 0].numpy().astype(np.float32)[:, None, None]
    if pickup is not None:
        below = samples.before_linear.numpy()
        laid = laid + pickup.numpy().astype(np.float32)[..., None, None] * picked_up(
            made, laid, below, measured.painted
        )
    return laid


def gain_of_camera(model: Model, measured: Measured) -> Array:
    """The camera's gain on the picture, float32[B, H, W]."""
    picture = torch.ones(*measured.samples.valid.shape, 1)
    for mechanism in model.at_work:
        if "picture" in acts_on(mechanism):
            picture = mechanism.camera(picture, measured.samples.view)
    return picture[..., 0].numpy().astype(np.float32)


def predicted_linear(laid: Ink, measured: Measured, pixels: Array | None = None) -> Array:
    """The windows after the strokes, linear light float32[B, H, W, 3]; or those ``pixels``, [n, 3]."""
    below = at_pixels(measured.samples.before_linear.numpy(), pixels)
    coverage = at_pixels(laid.imprint.coverage, pixels)[..., None]
    mixed = mixture(below, paint_at(laid, pixels), coverage, laid.power)
    return np.maximum(mixed * at_pixels(laid.gain, pixels)[..., None], 0.0)


def at_pixels(images: Array, pixels: Array | None) -> Array:
    """Of images [B, H, W, ...] the values [n, ...] at pixels with those numbers, counted through all; of None, all.

    A mask would say the same, and takes ten times as long.
    """
    return images if pixels is None else images.reshape(-1, *images.shape[3:]).take(pixels, axis=0)


def paint_at(laid: Ink, pixels: Array | None) -> Array:
    """The paint laid there, linear light, as ``at_pixels``."""
    whole = laid.paint.shape[1:3] == laid.gain.shape[1:3]
    if pixels is None or whole:
        return at_pixels(np.broadcast_to(laid.paint, (*laid.gain.shape, 3)), pixels)
    return laid.paint[:, 0, 0].take(pixels // laid.gain[0].size, axis=0)


def residual(model: Model, measured: Measured) -> Array:
    """Measured less foretold, sRGB float32[B, H, W, 3]; 0 in the padding."""
    return (measured.samples.after.numpy() - predicted(model, measured)) * measured.samples.valid.numpy()[..., None]


def predicted(model: Model, measured: Measured) -> Array:
    """The photographs after the strokes, sRGB float32[B, H, W, 3]."""
    mark = mark_px(model, measured)

    def of(some: slice) -> Array:
        return _predicted(model, measured.pick(some), mark[some])

    return np.concatenate(in_batches(of, len(measured), ROWS_AT_ONCE))


def _predicted(model: Model, measured: Measured, mark: Array) -> Array:
    laid = ink_of(mark, model, measured)
    changed = np.flatnonzero((laid.imprint.segment >= 0) | (laid.gain != 1))
    after = measured.samples.before.numpy().copy()
    after.reshape(-1, 3)[changed] = linear_to_srgb(predicted_linear(laid, measured, changed))
    return np.asarray(after + measured.habit)


def mean_squared_error(residuals: Array, measured: Measured) -> Array:
    """Of each row, over its window: sRGB in [0, 1], [B]. What fits make small."""
    pixels = measured.samples.valid.numpy().sum((1, 2)) * 3
    return np.square(residuals).sum((1, 2, 3)) / pixels


def action_losses(model: Model, measured: Measured) -> Array:
    """Mean squared error of each action over its rows, by their weights, sRGB, in the order of the actions' numbers."""
    rows = measured.weight * mean_squared_error(residual(model, measured), measured)
    _, group = np.unique(measured.action, return_inverse=True)
    return np.bincount(group, rows) / np.bincount(group)
