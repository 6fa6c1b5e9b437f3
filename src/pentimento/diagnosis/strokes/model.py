"""The stroke model as a value: a base and any mechanisms of the vocabulary, and its file ``extended_model.json``.

The base is the thesis's stroke model (half-width by press, a profile, an amplitude, a blur), made free enough that no
cause explains a plain miscalibration (docs/diagnosis.md §3). The half-width is a curve over press, the profile a stack
of slabs. Each paint has a colour offset. Paint and ground mix in a power of light. Both ends may lie beyond their
command and be wider.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pentimento.contracts.errors import ContractError
from pentimento.diagnosis.strokes.soft_edge import LEVELS
from pentimento.dynamics.strokes.mechanisms import VOCABULARY
from pentimento.dynamics.strokes.mechanisms.geometry import arc_m, bending_per_m, moved_ends, tangent
from pentimento.dynamics.strokes.mechanisms.latency import Latency
from pentimento.dynamics.strokes.simulation import Mechanism, NotObservable, Quantity, StrokeContext, extended_mark
from pentimento.dynamics.strokes.traj2stroke import Mark

Array = NDArray[Any]

PRESSES = tuple(np.expm1(np.linspace(0, np.log(4), 12)) / 3)
"""Knots of the half-width curve, as shares of the range from the lightest to the deepest press. They are denser at
light press, because a tip has a knee beyond which it spreads no further."""
WIDTHS = tuple(f"half_width_{k}_mm" for k in range(len(PRESSES)))
SLABS = tuple(f"slab_{level:g}" for level in LEVELS)
BASE = (
    *WIDTHS, *SLABS, "density_by_press", "edge_by_press", "log_edge_px", "ends_mm", "side_mm", "outward_mm",
    "ends_widening", "mixing",
)  # fmt: skip
"""Names of the base's parameters. ``mixing``: paint and ground mix in light to the power of ``exp(mixing)``. 0 is
linear light, about -0.8 sRGB numbers, far below that a filter."""
_OUTERMOST = 3
"""Pieces of the half-width curve whose slope extrapolates it."""
_THINNEST_M = 1e-5
"""Smallest half-width."""
_TIGHT_M = 0.02
"""Radius of a bend at which a mark lies outwards by ``outward_mm``."""
_UNIT_EDGE = 0.15
"""Softness that represents the base's edge. It is hard enough that mechanisms that soften it leave the width unchanged.
"""
SCHEMA = 2


@dataclass(frozen=True)
class Model:
    """All parameters of a model, in the order in which Jacobians list them: base, colours, mechanisms."""

    press_m: tuple[float, float]
    """Lightest and deepest press of the base's half-width curve."""
    base: Array
    """[len(BASE)]"""
    color_offset: Array
    """[K, 3] linear light, added to each distinct paint."""
    mechanisms: tuple[Mechanism, ...]

    @cached_property
    def vector(self) -> Array:
        """All parameters; a mechanism's in units of their typical size."""
        parts = [self.base, self.color_offset.ravel()]
        parts += [m.values.double().numpy() / _typical(m) for m in self.mechanisms]
        return np.concatenate(parts)

    @property
    def mixes_in_light(self) -> bool:
        """Whether paint and ground mix in linear light. A fit then keeps that, because no Jacobian has ``mixing``."""
        return bool(self.base[BASE.index("mixing")] == 0)

    @property
    def nuisances(self) -> int:
        """Number of parameters before the mechanisms' quantities."""
        return len(self.base) + self.color_offset.size

    def at(self, vector: Array) -> Model:
        """The same model with other parameters."""
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
        """The model with more mechanisms."""
        return replace(self, mechanisms=(*self.mechanisms, *mechanisms))

    def without(self, *causes: str) -> Model:
        """The model without the mechanisms of these causes."""
        return replace(self, mechanisms=tuple(m for m in self.mechanisms if m.cause not in causes))

    @property
    def active(self) -> tuple[Mechanism, ...]:
        """The mechanisms with any non-zero quantity."""
        return tuple(m for m in self.mechanisms if m.active)

    def columns_of(self, cause: str) -> Array:
        """Indices of a mechanism's quantities among all parameters."""
        at = self.nuisances
        for m in self.mechanisms:
            if m.cause == cause:
                return np.arange(at, at + len(m.quantities))
            at += len(m.quantities)
        raise KeyError(cause)

    def mark(self, context: StrokeContext) -> Mark:
        """The strokes' marks, [B, S, N]; ``softness`` is relative to the base's edge, in ``_UNIT_EDGE``."""
        return _mark(self.press_m, torch.tensor(self.base, dtype=torch.float64), self.active, context)


def _mark(press_m: tuple[float, float], base: Tensor, mechanisms: Sequence[Mechanism], context: StrokeContext) -> Mark:
    """``Model.mark`` for base parameters [len(BASE)]."""
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
    """The curve through ``values`` at the knots ``PRESSES``, piecewise linear, extrapolated by the slope of the outer
    pieces.
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
    """Which of mark, paint and picture a mechanism changes."""
    kind = type(mechanism)
    overridden = {"mark": kind.mark, "paint": kind.composite, "picture": kind.camera}
    plain = {"mark": Mechanism.mark, "paint": Mechanism.composite, "picture": Mechanism.camera}
    return {name for name, method in overridden.items() if method is not plain[name]}


def _typical(mechanism: Mechanism) -> Array:
    return np.array([quantity.typical for quantity in mechanism.quantities])


def identity(kind: type[Mechanism], context: StrokeContext) -> Mechanism:
    """A mechanism with all quantities 0.

    Raises:
        NotObservable: these strokes cannot show the cause.
    """
    return kind(torch.zeros(len(kind.quantities), dtype=torch.float64), kind.reference_of(context))


def observable_causes(
    vocabulary: Sequence[type[Mechanism]], context: StrokeContext, *, path_measured: bool
) -> tuple[dict[str, Mechanism], dict[str, str]]:
    """The mechanism of each cause that these strokes can show, with all quantities 0; and of the others the reason.

    Args:
        path_measured: whether the paths are measured, so that the robot's delay is in them.
    """
    seen: dict[str, Mechanism] = {}
    unseen: dict[str, str] = {}
    for kind in vocabulary:
        if path_measured and kind is Latency:
            unseen[kind.cause] = "the robot measured its paths, and they hold its delay"
            continue
        try:
            seen[kind.cause] = identity(kind, context)
        except NotObservable as reason:
            unseen[kind.cause] = str(reason)
    return seen, unseen


class UnevenEnds(Mechanism):
    """A mark whose two ends differ, as a tool leaves it where it comes down and lifts off; part of the base.

    On straight strokes it resembles a lag. Where a lag leaves nothing for it, the lag replaces it.
    """

    cause = "uneven_ends"
    site = "trajectory"
    driving_covariate = "motion"
    quantities = (
        Quantity("start_m", "m", 0.0005),
        Quantity("end_m", "m", 0.0005),
        Quantity("start_widening", "1", 0.1),
        Quantity("end_widening", "1", 0.1),
    )

    def mark(self, mark: Mark, context: StrokeContext) -> Mark:
        start_m, end_m, start_widening, end_widening = self.values
        arc, reach = arc_m(context.path), mark.radius_m.mean(-1, keepdim=True)
        points, radius = moved_ends(mark.points_m, mark.radius_m, context.path, start_m, end_m)
        widening = start_widening * torch.exp(-arc / reach)
        widening = widening + end_widening * torch.exp(-(arc[..., -1:] - arc) / reach)
        return mark._replace(points_m=points, radius_m=radius * torch.exp(widening))


def model_as_json(model: Model, paints: Array) -> dict[str, Any]:
    """The content of ``extended_model.json``; ``paints`` [K, 3] sRGB are those of the model's colour offsets."""
    return {
        "schema": SCHEMA,
        "kind": "strokes",
        "press_m": [float(depth) for depth in model.press_m],
        "base": {name: float(value) for name, value in zip(BASE, model.base, strict=True)},
        "paints": [
            {"color_srgb": [float(v) for v in paint], "offset_linear": [float(v) for v in offset]}
            for paint, offset in zip(paints, model.color_offset, strict=True)
        ],
        "mechanisms": [
            {
                "cause": mechanism.cause,
                "site": mechanism.site,
                "values": {
                    quantity.name: {"value": float(value), "unit": quantity.unit}
                    for quantity, value in zip(mechanism.quantities, mechanism.values, strict=True)
                },
                "reference": {name: float(value) for name, value in mechanism.reference.items()},
            }
            for mechanism in model.mechanisms
        ],
    }


def read_model(path: Path) -> tuple[Model, Array]:
    """Read ``extended_model.json``: the model, and the paints [K, 3] sRGB of its colour offsets.

    Raises:
        ContractError: the file is missing, not JSON, of another schema, or has unknown causes or parameters.
    """
    try:
        stored = json.loads(Path(path).read_text(encoding="utf-8"))
        if stored["schema"] != SCHEMA or stored["kind"] != "strokes":
            raise ValueError(f"schema {stored['schema']} of {stored['kind']}, not {SCHEMA} of strokes")
        if sorted(stored["base"]) != sorted(BASE):
            raise ValueError(f"its base has the numbers {', '.join(stored['base'])}, not {', '.join(BASE)}")
        base = np.array([float(stored["base"][name]) for name in BASE])
        paints = np.array([paint["color_srgb"] for paint in stored["paints"]], dtype=float).reshape(-1, 3)
        offsets = np.array([paint["offset_linear"] for paint in stored["paints"]], dtype=float).reshape(-1, 3)
        low, high = map(float, stored["press_m"])
        mechanisms = tuple(_read_mechanism(entry) for entry in stored["mechanisms"])
        return Model((low, high), base, offsets, mechanisms), paints
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise ContractError(
            f"{path} is not an extended model ({error}): write one with `pentimento diagnose`."
        ) from error


def _read_mechanism(entry: dict[str, Any]) -> Mechanism:
    known: tuple[type[Mechanism], ...] = (*VOCABULARY, UnevenEnds)
    kinds = {kind.cause: kind for kind in known}
    if entry["cause"] not in kinds:
        raise ValueError(f"cause {entry['cause']} is not in the vocabulary")
    kind = kinds[entry["cause"]]
    values = [float(entry["values"][quantity.name]["value"]) for quantity in kind.quantities]
    return kind(torch.tensor(values, dtype=torch.float64), {n: float(v) for n, v in entry["reference"].items()})
