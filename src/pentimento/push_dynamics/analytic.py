"""An analytic model of a push: the swept tool, the indentation it leaves, rims, a heap in front; and named causes.

The tip travels along u from 0 to L while it sinks from the surface at the start by g d u / L (thesis 7.3.2: the depth
ramps linearly and is relative to the surface there). Its lower envelope over a place (u, v) is

    E(u, v) = -m s + P(|(u - s, v)|),   m = g d / L,   s = clip(u + m R, 0, L),

with the tool's profile P, a ball's of radius R at its tip and free further out, and s where that ball reaches lowest.
A tool with corners reaches further at its diagonals; arm and slab give way to what resists (``resistance``), so that
m s is less where a wall is in the way and more over an old groove. What lies above E in ``before`` is pressed down: the
model depends on the state. A share of it stays as an indentation; its volume comes up again in rims (spread by
Gaussians of two widths, outside the contact, from where it was or more evenly around the tool) and a heap towards the
travel; where the tool lifts off it may leave a peak. A blur ends it. All of these numbers are the base's nuisances
(GAP.md, rule 2): free, so that no cause can explain a plain miscalibration. Mechanisms change the motion, what stays,
or the surface.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pentimento.push_dynamics.analytic_scene import PushScene
from pentimento.push_dynamics.contact import contact_of
from pentimento.push_dynamics.mechanisms.mechanism import Contact, Mechanism, Motion, Settled, per_push
from pentimento.push_dynamics.resistance import STATIONS, deepest_m, yielded
from pentimento.push_dynamics.rims import forward, raised, source
from pentimento.push_dynamics.spread import spread

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
KEPT = ("kept", "log_rims", "evenly")
SURFACE = ("far_rim", "lean", "heap", "end_lift", "end_pull")
BASE = (*CONTACT, *KEPT, *SURFACE, "log_blur")
START = dict.fromkeys(BASE, 0.0) | {"kept": 0.9, "far_rim": 0.5, "log_blur": float(np.log(0.7))}
EDGE_M = 0.0003
"""Softness of the contact where ``log_edge`` is 0."""
_NEAR, _FAR = 0.5, 1.1
"""Widths of the rims, in half-widths of the footprint."""
_DEEP_M = 0.005
_LEAST_RIMS, _LEAST_NET = 0.02, 0.2
"""What the rims' shape must add up to at least: of what stays pressed, and of its own sizes whatever their sign. Else
a shape that adds up to nothing would raise towers."""
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
        return tuple(m for m in self.mechanisms if not m.idle)

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
        return settle(self, scene, keep(self, scene, touch(self, scene)))


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


class Kept(NamedTuple):
    """What the material keeps of a contact."""

    contact: Contact
    indentation_m: Array
    """float32[B, H, W] downwards."""
    near_m: Array
    """float32[B, H, W]: the indentation spread by the narrow of the rims' two Gaussians."""
    far_m: Array
    """By the wide one."""
    ahead: Array
    """How much higher that is behind each place than ahead of it, per pixel."""


def touch(model: AnalyticPush, scene: PushScene) -> Contact:
    """Where the tool passes below the surface."""
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
    return contact_of(scene.before, scene.along, scene.across, moved, deep, knots, fixed)


def _radius_at(depth_m: Array, ball_radius_m: float, knots: Array) -> Array:
    """How wide the tool is at heights [B] above its tip: half of it, metres. ``knots`` as of ``contact_of``."""
    away = np.linspace(0.0, knots[0, -1], _RADII)
    profile = away**2 / (2 * ball_radius_m) + np.interp(away, *knots)
    return np.interp(depth_m, np.maximum.accumulate(profile) + 1e-9 * np.arange(_RADII), away)


def keep(model: AnalyticPush, scene: PushScene, contact: Contact) -> Kept:
    """How much of what is pressed stays so."""
    kept = np.float32(_numbers(model)["kept"]) * contact.pressed_m
    for mechanism in model.at_work:
        kept = mechanism.kept(kept, contact, scene)
    half_px = scene.half_width_m / scene.pixel_m * float(np.exp(_numbers(model)["log_rims"]))
    rising = source(kept, contact.inside, contact.pressed_m, scene.before, _numbers(model)["evenly"])
    far = spread(rising, _FAR * half_px)
    return Kept(contact, kept, spread(rising, _NEAR * half_px), far, forward(far, scene.action[:, 2]))


def settle(model: AnalyticPush, scene: PushScene, kept: Kept) -> Array:
    """What becomes of the displaced material: the whole change of height, float32[B, H, W] metres."""
    number, contact, half_px = _numbers(model), kept.contact, scene.half_width_m / scene.pixel_m
    # A moving tool carries material along: the rims are higher towards the end of travel.
    shape = number["far_rim"], number["heap"] * _FAR * half_px, number["lean"]
    rims = raised(kept.near_m, kept.far_m, kept.ahead, contact.progress, contact.inside, shape)
    # Volume balance: what is pressed down comes up again.
    pressed = kept.indentation_m.sum((1, 2))
    least = np.maximum(_LEAST_NET * np.abs(rims).sum((1, 2)), _LEAST_RIMS * pressed) + _NOTHING_M
    rims *= per_push(pressed / np.maximum(rims.sum((1, 2)), least))
    lift = np.float32(number["end_pull"] * 1e-3) * contact.beyond_end
    lift += np.float32(number["end_lift"] * 1e-3)
    lift *= contact.peak
    settled = Settled(kept.indentation_m, rims, lift)
    for mechanism in model.at_work:
        settled = mechanism.settled(settled, contact, scene)
    return spread(settled.lift_m + settled.rims_m - settled.indentation_m, float(np.exp(number["log_blur"])))


def typical(mechanism: Mechanism) -> Array:
    """Typical sizes of its quantities."""
    return np.array([quantity.typical for quantity in mechanism.quantities])


def _numbers(model: AnalyticPush) -> dict[str, float]:
    return dict(zip(BASE, map(float, model.base), strict=True))
