"""Analytic model of a push: the swept volume of the tool, the indentation, the displaced material, and named causes.

The tip travels along u from 0 to L while it sinks from the surface at the start by g d u / L (thesis 7.3.2: the depth
ramps linearly and is relative to the surface at the start). The lower envelope of the tool at a place (u, v) is

    E(u, v) = -m s + P(|(u - s, v)|),   m = g d / L,   s = clip(u + m R, 0, L).

P is the tool's profile: a ball of radius R near the tip, with free offsets further out. s is the station at which the
ball reaches lowest. A tool with corners reaches further along its diagonals. Arm and slab are compliant, so the depth m
s is reduced where the surface resists and increased over an old groove (``scene.resistance_of``). Material
above E in ``before`` is pressed down, so the model is state-conditioned. A fraction stays as an indentation. Its volume
is deposited around the groove (``heaping``). Where the tool lifts off, a peak may remain. The result is blurred by a
Gaussian.

All of these parameters are nuisance parameters of the base: they are fitted freely, so that no cause can explain a
plain miscalibration (docs/diagnosis.md §3). A mechanism changes the motion, the indentation or the surface.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pentimento.planning.pushes.analytic.contact import Sweep, contact_of
from pentimento.planning.pushes.analytic.heaping import heaped
from pentimento.planning.pushes.analytic.mechanisms import UNNAMED, VOCABULARY
from pentimento.planning.pushes.analytic.mechanisms.mechanism import (
    Contact,
    Mechanism,
    Motion,
    Settled,
    per_push,
    spread,
)
from pentimento.planning.pushes.analytic.scene import STATIONS, PushScene, deepest_m, yielded

Array = NDArray[Any]
KNOTS = (0.35, 0.6, 0.85, 1.15, 1.6)
"""Radii of the profile offsets, in half-widths of the footprint. Without the offsets, a flat tip looks like a tool that
goes deeper everywhere. A free offset at the centre would have the same effect, so within ``_ROUND`` the profile is a
ball's."""
_ROUND = 0.15
"""Radius within which the profile is a ball's, in half-widths of the footprint."""
PROFILE = tuple(f"profile_{k}_mm" for k in range(len(KNOTS)))
CONTACT = (
    "log_radius", *PROFILE, "log_gain", "log_gain_by_depth", "log_edge", "log_aspect", "corners", "give_mm", "along_mm",
)  # fmt: skip
HEAP = ("log_rims", "facing", "flanking", "log_steep", "stand_off", "refill")
KEPT = ("kept",)
SURFACE = ("end_lift", "end_pull", "smear")
BASE = (*CONTACT, *HEAP, *KEPT, *SURFACE, "log_blur")
START = dict.fromkeys(BASE, 0.0) | {"kept": 0.9, "facing": 0.5, "stand_off": 1.0, "log_blur": float(np.log(0.7))}
EDGE_M = 0.0003
"""Softness of the contact edge for ``log_edge`` = 0."""
_RIMS = 0.6
"""Width of the Gaussian by which displaced material is spread around the tool, in half-widths of the footprint."""
_DEPTH_SCALE_M = 0.005
"""Depth at which ``log_gain_by_depth`` has no effect."""
_MIN_RIMS = 0.02
"""Minimum sum of the rims as a fraction of the pressed sum. It keeps a few rim pixels from rising as towers."""
_MIN_VOLUME_M = 1e-12
"""Avoids a division by zero where nothing is pressed."""
_PROFILE_SAMPLES = 100
"""Samples by which the profile is inverted numerically."""
_TYPICAL_DEPTH = 0.6
"""Fraction of the deepest command at which a footprint has its typical half-width."""
_SCHEMA = 1
"""Version of ``extended_model.json``."""


@dataclass(frozen=True)
class AnalyticPush:
    """All parameters of a model, in the order of the Jacobian's columns: base, then mechanisms."""

    ball_radius_m: float
    """R for ``log_radius`` = 0."""
    base: Array
    """float64[len(BASE)]"""
    mechanisms: tuple[Mechanism, ...]

    @cached_property
    def vector(self) -> Array:
        """All parameters, float64[P]; a mechanism's are in units of their typical size."""
        return np.concatenate([self.base, *(m.values / typical(m) for m in self.mechanisms)])

    @property
    def nuisances(self) -> int:
        """Number of nuisance parameters; they precede the mechanisms' quantities."""
        return len(self.base)

    def at(self, vector: Array) -> AnalyticPush:
        """The same model with other parameters, float64[P]."""
        mechanisms, at = [], len(self.base)
        for m in self.mechanisms:
            mechanisms.append(type(m)(vector[at : at + len(m.quantities)] * typical(m), m.reference))
            at += len(m.quantities)
        return replace(self, base=vector[: len(self.base)], mechanisms=tuple(mechanisms))

    @property
    def active_mechanisms(self) -> tuple[Mechanism, ...]:
        """Mechanisms with a quantity that is not zero."""
        return tuple(m for m in self.mechanisms if m.active)

    def plus(self, *mechanisms: Mechanism) -> AnalyticPush:
        """The model with further mechanisms."""
        return replace(self, mechanisms=(*self.mechanisms, *mechanisms))

    def without(self, *causes: str) -> AnalyticPush:
        """The model without the mechanisms of these causes."""
        return replace(self, mechanisms=tuple(m for m in self.mechanisms if m.cause not in causes))

    def columns_of(self, cause: str) -> Array:
        """Indices of a mechanism's quantities among all parameters.

        Raises:
            KeyError: the model has no such mechanism.
        """
        at = len(self.base)
        for m in self.mechanisms:
            if m.cause == cause:
                return np.arange(at, at + len(m.quantities))
            at += len(m.quantities)
        raise KeyError(cause)

    def change(self, scene: PushScene) -> Array:
        """Predicted change of height, float32[B, H, W] metres."""
        contact = touch(self, scene)
        return settle(self, scene, contact, keep(self, scene, contact))


def first_model(scene: PushScene) -> AnalyticPush:
    """The base before any fit: a ball that leaves a footprint of the typical half-width."""
    deepest = float(np.quantile(scene.action[:, 4], 0.9))
    radius = scene.half_width_m**2 / (2 * _TYPICAL_DEPTH * max(deepest, 1e-4))
    return AnalyticPush(radius, np.array([START[name] for name in BASE]), ())


def identity(kind: type[Mechanism], scene: PushScene) -> Mechanism:
    """A mechanism with all quantities zero.

    Raises:
        NotObservable: these pushes cannot show its effect.
    """
    return kind(np.zeros(len(kind.quantities)), kind.reference_of(scene))


def touch(model: AnalyticPush, scene: PushScene) -> Contact:
    """Where the tool passes below the surface, and what it displaces."""
    sweep = _sweep(model, scene)
    return _heaped(model, scene, sweep, contact_of(sweep, scene.pixel_m))


def heap(model: AnalyticPush, scene: PushScene, contact: Contact) -> Contact:
    """The same contact for a model that differs only in the parameters of ``HEAP``."""
    return _heaped(model, scene, _sweep(model, scene), contact)


def _heaped(model: AnalyticPush, scene: PushScene, sweep: Sweep, contact: Contact) -> Contact:
    number = _numbers(model)
    width_px = _RIMS * np.exp(number["log_rims"]) * scene.half_width_m / scene.pixel_m
    shape = {name: number[name] for name in HEAP if name != "log_rims"}
    return contact._replace(heaped_m=heaped(sweep, width_px, **shape))


def _sweep(model: AnalyticPush, scene: PushScene) -> Sweep:
    number = _numbers(model)
    zeros = np.zeros(len(scene))
    motion = Motion(*[zeros] * len(Motion._fields))
    for mechanism in model.active_mechanisms:
        motion = mechanism.motion(motion, scene)
    length, commanded = scene.action[:, 3], scene.action[:, 4]
    gain = number["log_gain"] + number["log_gain_by_depth"] * (commanded / _DEPTH_SCALE_M - 1) + motion.log_depth
    depth = commanded * np.exp(gain)
    travels = length > 1e-4
    # A push that does not travel goes down at once.
    ramp = np.where(travels[:, None], np.linspace(0.0, 1.0, STATIONS), 1.0)
    at_rest = np.where(travels[:, None], np.arange(STATIONS) == STATIONS - 1, True)
    target = depth[:, None] * ramp * np.exp(motion.log_depth_at_rest[:, None] * at_rest) + motion.lower_m[:, None]
    target += motion.lower_at_start_m[:, None] * (1 - ramp)
    total, worked = scene.resistance
    resistance = total + per_push(motion.hardening) * worked
    tip_depth = yielded(resistance, deepest_m(commanded), target, number["give_mm"] * 1e-3)
    slope = np.where(travels, (tip_depth[:, -1] - tip_depth[:, 0]) / np.maximum(length, 1e-4), 0.0)
    radius = model.ball_radius_m * np.exp(number["log_radius"])
    offsets = np.array([0.0, *(number[name] for name in PROFILE)]) * 1e-3
    knots = np.stack([np.array([_ROUND, *KNOTS]) * scene.half_width_m, offsets])
    end_radius = np.maximum(_radius_at(tip_depth[:, -1], radius, knots), scene.pixel_m)
    motion_parameters = np.stack(
        [
            motion.along_m + number["along_mm"] * 1e-3, motion.across_m, slope, length, motion.log_width, end_radius,
        ], axis=1,
    )  # fmt: skip
    edge = EDGE_M * np.exp(number["log_edge"])
    fixed = np.array([radius, np.exp(number["log_aspect"]), number["corners"], edge, scene.half_width_m])
    return Sweep(scene.before, scene.along, scene.across, motion_parameters, tip_depth, knots, fixed)


def _radius_at(depth_m: Array, ball_radius_m: float, knots: Array) -> Array:
    """Radius [B] of the tool at heights [B] above its tip, in metres; ``knots`` as in ``Sweep``."""
    distance = np.linspace(0.0, knots[0, -1], _PROFILE_SAMPLES)
    profile = distance**2 / (2 * ball_radius_m) + np.interp(distance, *knots)
    return np.interp(depth_m, np.maximum.accumulate(profile) + 1e-9 * np.arange(_PROFILE_SAMPLES), distance)


def keep(model: AnalyticPush, scene: PushScene, contact: Contact) -> Array:
    """Indentation that stays of the pressed depth, float32[B, H, W] metres downwards."""
    kept = np.float32(_numbers(model)["kept"]) * contact.pressed_m
    for mechanism in model.active_mechanisms:
        kept = mechanism.kept(kept, contact, scene)
    return kept


def settle(model: AnalyticPush, scene: PushScene, contact: Contact, indentation_m: Array) -> Array:
    """Change of height after the displaced material has settled, float32[B, H, W] metres."""
    number = _numbers(model)
    rims = (1 - np.float32(1 - number["refill"]) * contact.inside) * contact.heaped_m
    # Volume balance: the rims hold the volume of the indentation that stays.
    pressed = indentation_m.sum((1, 2))
    rims *= per_push(pressed / np.maximum(rims.sum((1, 2)), _MIN_RIMS * pressed + _MIN_VOLUME_M))
    lift = np.float32(number["end_pull"] * 1e-3) * contact.beyond_end
    lift += np.float32(number["end_lift"] * 1e-3)
    lift *= contact.peak
    blur = float(np.exp(number["log_blur"]))
    lift += np.float32(number["smear"]) * contact.inside * (spread(scene.before, blur) - scene.before)
    settled = Settled(indentation_m, rims, lift)
    for mechanism in model.active_mechanisms:
        settled = mechanism.settled(settled, contact, scene)
    return spread(settled.lift_m + settled.rims_m - settled.indentation_m, blur)


def typical(mechanism: Mechanism) -> Array:
    """Typical sizes of a mechanism's quantities."""
    return np.array([quantity.typical for quantity in mechanism.quantities])


def _numbers(model: AnalyticPush) -> dict[str, float]:
    return dict(zip(BASE, map(float, model.base), strict=True))


def model_as_json(model: AnalyticPush, half_width_m: float) -> dict[str, Any]:
    """Content of ``extended_model.json``; ``half_width_m`` is that of the scene to which the model was fitted."""
    return {
        "schema": _SCHEMA,
        "kind": "pushes",
        "half_width_m": half_width_m,
        "ball_radius_m": model.ball_radius_m,
        "base": {name: float(value) for name, value in zip(BASE, model.base, strict=True)},
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


def model_from_json(stored: dict[str, Any]) -> tuple[AnalyticPush, float]:
    """Inverse of ``model_as_json``.

    Raises:
        ValueError, KeyError, TypeError, AttributeError: the content is not that of an extended model.
    """
    if stored["schema"] != _SCHEMA or stored["kind"] != "pushes":
        raise ValueError(f"schema {stored['schema']} of {stored['kind']}, not {_SCHEMA} of pushes")
    if sorted(stored["base"]) != sorted(BASE):
        raise ValueError(f"its base has the numbers {', '.join(stored['base'])}, not {', '.join(BASE)}")
    base = np.array([float(stored["base"][name]) for name in BASE])
    mechanisms = tuple(_mechanism(entry) for entry in stored["mechanisms"])
    return AnalyticPush(float(stored["ball_radius_m"]), base, mechanisms), float(stored["half_width_m"])


def _mechanism(entry: dict[str, Any]) -> Mechanism:
    kinds = {kind.cause: kind for kind in (*VOCABULARY, *UNNAMED)}
    if entry["cause"] not in kinds:
        raise ValueError(f"cause {entry['cause']} is not in the vocabulary")
    kind = kinds[entry["cause"]]
    values = [float(entry["values"][quantity.name]["value"]) for quantity in kind.quantities]
    return kind(np.array(values), {name: float(value) for name, value in entry["reference"].items()})
