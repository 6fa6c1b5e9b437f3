"""An analytic model of a push: the swept tool, the indentation it leaves, the heap around it; and named causes.

The tip travels along u from 0 to L while it sinks from the surface at the start by g d u / L (thesis 7.3.2: the depth
ramps linearly and is relative to the surface there). Its lower envelope over a place (u, v) is

    E(u, v) = -m s + P(|(u - s, v)|),   m = g d / L,   s = clip(u + m R, 0, L),

with the tool's profile P, a ball's of radius R at its tip and free further out, and s where that ball reaches lowest.
A tool with corners reaches further at its diagonals; arm and slab give way to what resists (``resistance``), so that
m s is less where a wall is in the way and more over an old groove. What lies above E in ``before`` is pressed down: the
model depends on the state. A share of it stays as an indentation; its volume lies around the groove as the tool heaps
it up (``heaping``), and where the tool lifts off it may leave a peak. A blur ends it. All of these numbers are the
base's nuisances (docs/diagnosis.md §3): free, so that no cause can explain a plain miscalibration. Mechanisms change
the motion, what stays, or the surface.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pentimento.dynamics.pushes.analytic_scene import PushScene
from pentimento.dynamics.pushes.contact import Sweep, contact_of
from pentimento.dynamics.pushes.heaping import heaped
from pentimento.dynamics.pushes.mechanisms.mechanism import Contact, Mechanism, Motion, Settled, per_push
from pentimento.dynamics.pushes.resistance import STATIONS, deepest_m, yielded
from pentimento.dynamics.pushes.spread import spread

Array = NDArray[Any]

KNOTS = (0.35, 0.6, 0.85, 1.15, 1.6)
"""Radii, in half-widths of the footprint, at which the profile may differ from a ball's. A flat tip that is taken for a
ball's passes for a tool that goes deeper everywhere; so would a tip that is free at its very middle: inside ``_ROUND``
it is a ball's."""
_ROUND = 0.15
PROFILE = tuple(f"profile_{k}_mm" for k in range(len(KNOTS)))
CONTACT = (
    "log_radius", *PROFILE, "log_gain", "log_gain_by_depth", "log_edge", "log_aspect", "corners", "give_mm", "along_mm",
)  # fmt: skip
HEAP = ("log_rims", "facing", "stand_off")
KEPT = ("kept",)
SURFACE = ("end_lift", "end_pull")
BASE = (*CONTACT, *HEAP, *KEPT, *SURFACE, "log_blur")
START = dict.fromkeys(BASE, 0.0) | {"kept": 0.9, "facing": 0.5, "stand_off": 1.0, "log_blur": float(np.log(0.7))}
EDGE_M = 0.0003
"""Softness of the contact where ``log_edge`` is 0."""
_RIMS = 0.6
"""Width of the Gaussian by which material rises around the tool, in half-widths of the footprint."""
_DEEP_M = 0.005
_MIN_RIMS = 0.02
"""Of what stays pressed: what rims must add up to at least. Else hardly any would raise towers."""
_NOTHING_M = 1e-12
_RADII = 100
_USUAL_DEPTH = 0.6
"""Of the deepest command: where a footprint has its usual half-width."""


@dataclass(frozen=True)
class AnalyticPush:
    """All numbers of a model, in the order in which Jacobians list them: base, mechanisms."""

    ball_radius_m: float
    """R where ``log_radius`` is 0."""
    base: Array
    """float64[len(BASE)]"""
    mechanisms: tuple[Mechanism, ...]

    @cached_property
    def vector(self) -> Array:
        """All numbers; a mechanism's in units of what is typical."""
        return np.concatenate([self.base, *(m.values / typical(m) for m in self.mechanisms)])

    @property
    def nuisances(self) -> int:
        """How many come before the mechanisms' quantities."""
        return len(self.base)

    def at(self, vector: Array) -> AnalyticPush:
        """The same model with other numbers."""
        mechanisms, at = [], len(self.base)
        for m in self.mechanisms:
            mechanisms.append(type(m)(vector[at : at + len(m.quantities)] * typical(m), m.reference))
            at += len(m.quantities)
        return replace(self, base=vector[: len(self.base)], mechanisms=tuple(mechanisms))

    @property
    def at_work(self) -> tuple[Mechanism, ...]:
        """The mechanisms that change anything."""
        return tuple(m for m in self.mechanisms if m.active)

    def plus(self, *mechanisms: Mechanism) -> AnalyticPush:
        """With more mechanisms."""
        return replace(self, mechanisms=(*self.mechanisms, *mechanisms))

    def without(self, *causes: str) -> AnalyticPush:
        """With fewer."""
        return replace(self, mechanisms=tuple(m for m in self.mechanisms if m.cause not in causes))

    def columns_of(self, cause: str) -> Array:
        """Where a mechanism's quantities stand among all numbers.

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
        """What the pushes do to the height, float32[B, H, W] metres."""
        contact = touch(self, scene)
        return settle(self, scene, contact, keep(self, scene, contact))


def first_model(scene: PushScene) -> AnalyticPush:
    """The base before any fit: a ball that leaves a footprint of the usual half-width."""
    deepest = float(np.quantile(scene.action[:, 4], 0.9))
    radius = scene.half_width_m**2 / (2 * _USUAL_DEPTH * max(deepest, 1e-4))
    return AnalyticPush(radius, np.array([START[name] for name in BASE]), ())


def identity(kind: type[Mechanism], scene: PushScene) -> Mechanism:
    """A mechanism that changes nothing yet.

    Raises:
        NotObservable: these pushes cannot show it.
    """
    return kind(np.zeros(len(kind.quantities)), kind.reference_of(scene))


def touch(model: AnalyticPush, scene: PushScene) -> Contact:
    """Where the tool passes below the surface, and what it heaps up there."""
    sweep = _sweep(model, scene)
    return _heaped(model, scene, sweep, contact_of(sweep, scene.pixel_m))


def heap(model: AnalyticPush, scene: PushScene, contact: Contact) -> Contact:
    """The same for a model with other numbers of ``HEAP`` than the one whose contact it is."""
    return _heaped(model, scene, _sweep(model, scene), contact)


def _heaped(model: AnalyticPush, scene: PushScene, sweep: Sweep, contact: Contact) -> Contact:
    number = _numbers(model)
    width_px = _RIMS * np.exp(number["log_rims"]) * scene.half_width_m / scene.pixel_m
    return contact._replace(heaped_m=heaped(sweep, width_px, number["facing"], number["stand_off"]))


def _sweep(model: AnalyticPush, scene: PushScene) -> Sweep:
    number = _numbers(model)
    still = np.zeros(len(scene))
    motion = Motion(*[still] * len(Motion._fields))
    for mechanism in model.at_work:
        motion = mechanism.motion(motion, scene)
    length, told = scene.action[:, 3], scene.action[:, 4]
    gain = number["log_gain"] + number["log_gain_by_depth"] * (told / _DEEP_M - 1) + motion.log_depth
    depth = told * np.exp(gain)
    travels = length > 1e-4
    # A push that does not travel goes down at once.
    ramp = np.where(travels[:, None], np.linspace(0.0, 1.0, STATIONS), 1.0)
    at_rest = np.where(travels[:, None], np.arange(STATIONS) == STATIONS - 1, True)
    wanted = depth[:, None] * ramp * np.exp(motion.log_depth_at_rest[:, None] * at_rest) + motion.lower_m[:, None]
    wanted += motion.lower_at_start_m[:, None] * (1 - ramp)
    everything, worked = scene.resistance
    resistance = everything + per_push(motion.harder) * worked
    deep = yielded(resistance, deepest_m(told), wanted, number["give_mm"] * 1e-3)
    slope = np.where(travels, (deep[:, -1] - deep[:, 0]) / np.maximum(length, 1e-4), 0.0)
    radius = model.ball_radius_m * np.exp(number["log_radius"])
    more = np.array([0.0, *(number[name] for name in PROFILE)]) * 1e-3
    knots = np.stack([np.array([_ROUND, *KNOTS]) * scene.half_width_m, more])
    end_radius = np.maximum(_radius_at(deep[:, -1], radius, knots), scene.pixel_m)
    moved = np.stack(
        [
            motion.along_m + number["along_mm"] * 1e-3, motion.across_m, slope, length, motion.log_width, end_radius,
        ], axis=1,
    )  # fmt: skip
    edge = EDGE_M * np.exp(number["log_edge"])
    fixed = np.array([radius, np.exp(number["log_aspect"]), number["corners"], edge, scene.half_width_m])
    return Sweep(scene.before, scene.along, scene.across, moved, deep, knots, fixed)


def _radius_at(depth_m: Array, ball_radius_m: float, knots: Array) -> Array:
    """How wide the tool is at heights [B] above its tip: half of it, metres. ``knots`` as of a ``Sweep``."""
    away = np.linspace(0.0, knots[0, -1], _RADII)
    profile = away**2 / (2 * ball_radius_m) + np.interp(away, *knots)
    return np.interp(depth_m, np.maximum.accumulate(profile) + 1e-9 * np.arange(_RADII), away)


def keep(model: AnalyticPush, scene: PushScene, contact: Contact) -> Array:
    """How much of what is pressed stays so: the indentation, float32[B, H, W] metres downwards."""
    kept = np.float32(_numbers(model)["kept"]) * contact.pressed_m
    for mechanism in model.at_work:
        kept = mechanism.kept(kept, contact, scene)
    return kept


def settle(model: AnalyticPush, scene: PushScene, contact: Contact, indentation_m: Array) -> Array:
    """What becomes of the displaced material: the whole change of height, float32[B, H, W] metres."""
    number = _numbers(model)
    rims = (1 - contact.inside) * contact.heaped_m
    # Volume balance: what stays pressed down has come up.
    pressed = indentation_m.sum((1, 2))
    rims *= per_push(pressed / np.maximum(rims.sum((1, 2)), _MIN_RIMS * pressed + _NOTHING_M))
    lift = np.float32(number["end_pull"] * 1e-3) * contact.beyond_end
    lift += np.float32(number["end_lift"] * 1e-3)
    lift *= contact.peak
    settled = Settled(indentation_m, rims, lift)
    for mechanism in model.at_work:
        settled = mechanism.settled(settled, contact, scene)
    return spread(settled.lift_m + settled.rims_m - settled.indentation_m, float(np.exp(number["log_blur"])))


def typical(mechanism: Mechanism) -> Array:
    """Typical sizes of its quantities."""
    return np.array([quantity.typical for quantity in mechanism.quantities])


def _numbers(model: AnalyticPush) -> dict[str, float]:
    return dict(zip(BASE, map(float, model.base), strict=True))
