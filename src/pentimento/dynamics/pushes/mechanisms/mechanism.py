"""What a cause may change of a foretold push, and when.

    command ── motion ──→ contact ── kept ──→ indentation ── settled ──→ rims and surface
               (command)             (material)              (surface)
               (contact)             (contact)

A mechanism is one named cause of what the base alone gets wrong. It acts at its site; at all others it is the identity.
With all of its quantities at zero it changes nothing, and what it does is smooth in them there.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pentimento.dynamics.pushes.analytic_scene import PushScene
from pentimento.dynamics.strokes.simulation import NotObservable, Quantity

Array = NDArray[Any]

Site = Literal["command", "contact", "material", "surface"]

_SHORTEST_S = 0.05
_VARIED = 0.3
"""Standard deviation of a logarithm: below it a time is always about the same."""

__all__ = [
    "Contact",
    "Mechanism",
    "Motion",
    "NotObservable",
    "Quantity",
    "Settled",
    "Site",
    "log_times",
    "per_push",
    "recorded",
    "usual_s",
]


class Motion(NamedTuple):
    """How the tool's path differs from its command, [B] each."""

    along_m: Array
    across_m: Array
    lower_m: Array
    """How much deeper it goes, at the start of travel as at the end."""
    lower_at_start_m: Array
    """The same at the start of travel, the less the nearer it is to its end."""
    log_depth: Array
    """How much deeper in proportion to its depth, as a logarithm."""
    log_width: Array
    """How much wider the tool seems, as a logarithm."""
    log_depth_at_rest: Array
    """The same at the end of its travel alone, where it rests."""
    harder: Array
    """How many times more than fresh material that which was worked most resists."""


class Contact(NamedTuple):
    """Where the tool passed below the surface, float32[B, H, W] each."""

    pressed_m: Array
    """How far below the surface in ``before`` its envelope went."""
    inside: Array
    """0 outside the contact, 1 inside, soft at the edge."""
    beyond_end: Array
    """How far ahead of the middle of what the tool touches as it lifts off, in radii of that."""
    peak: Array
    """What a tool draws up where it lifts off, out of what is around it: 1 in the middle, no volume."""
    heaped_m: Array
    """How high what the tool took away lies around its groove (``heaping``)."""


class Settled(NamedTuple):
    """Parts of the change of height, float32[B, H, W] each."""

    indentation_m: Array
    """What stays of ``pressed_m``, counted downwards."""
    rims_m: Array
    """Displaced material around it."""
    lift_m: Array
    """What else rises or falls."""


class Mechanism:
    """One cause."""

    cause: ClassVar[str]
    """Its name in the vocabulary."""
    site: ClassVar[Site]
    driving_covariate: ClassVar[str]
    """The covariate that the effect depends on. Causes with the same driving covariate are aliased where their assumed
    forms are not exact."""
    quantities: ClassVar[tuple[Quantity, ...]]
    informative_covariates: ClassVar[tuple[str, ...]] = ()
    """What is recorded of a push, or its surface and path say, that its effect goes with."""
    aliasable: ClassVar[bool] = True
    """Whether a base that is wrong about shapes can look like it. It cannot where the effect goes with what no shape
    depends on: a column of the table, the hour, or the sign of a direction."""
    by_place: ClassVar[tuple[str, ...]] = ()
    """Quantities by which it differs from place to place, as no shape does."""

    def __init__(self, values: Array, reference: Mapping[str, float]) -> None:
        """``values`` float64[Q] in the quantities' units; ``reference`` as by ``reference_of`` of the fitted pushes."""
        self.values, self.reference = values, reference

    @property
    def signature(self) -> tuple[str, ...]:
        """Quantities of which one at least is above zero in what it is named for; empty: any."""
        return ()

    @property
    def active(self) -> bool:
        """Whether a quantity differs from zero, so that the mechanism changes the prediction."""
        return bool(np.any(self.values))

    @property
    def physical(self) -> bool:
        """Whether it could be so: beyond the signs of its quantities, which a fit heeds."""
        return True

    @classmethod
    def reference_of(cls, scene: PushScene) -> dict[str, float]:
        """The constants that the effect is relative to.

        Raises:
            NotObservable: these pushes cannot show the effect: what it depends on was not recorded or not varied.
        """
        return {}

    def motion(self, motion: Motion, scene: PushScene) -> Motion:
        """How the tool moves; for the sites command and contact."""
        return motion

    def kept(self, kept_m: Array, contact: Contact, scene: PushScene) -> Array:
        """What stays of the contact as indentation [B, H, W]; for the sites contact and material."""
        return kept_m

    def settled(self, settled: Settled, contact: Contact, scene: PushScene) -> Settled:
        """Indentation, rims and the rest; for the site surface."""
        return settled


def recorded(scene: PushScene, *names: str) -> str:
    """The first of these columns that is there for every push and varies.

    Raises:
        NotObservable: none of them.
    """
    for name in names:
        values = scene.covariates.get(name)
        if values is not None and bool(np.isfinite(values).all()) and varies(values):
            return name
    raise NotObservable(f"{' or '.join(names)} was not recorded for every push, or does not vary")


def varies(values: Array) -> bool:
    """Whether numbers differ by more than rounding."""
    return float(np.ptp(values)) > 1e-3 * float(np.abs(values).max()) + 1e-12


def column(scene: PushScene, name: str) -> Array:
    """A column that an effect depends on, float64[B].

    Raises:
        NotObservable: it is not there.
    """
    if name not in scene.covariates:
        raise NotObservable(f"{name} is not known of these pushes, and the mechanism depends on it")
    return scene.covariates[name]


def usual_s(seconds: Array | None) -> float | None:
    """The geometric mean of times [B]; None if they are not known of every push, or hardly differ."""
    if seconds is None or not np.isfinite(seconds).all():
        return None
    logs = np.log(np.maximum(seconds, _SHORTEST_S))
    return float(np.exp(logs.mean())) if np.std(logs) > _VARIED else None


def log_times(seconds: Array, usual: float) -> Array:
    """Logarithms [B] of how many times what is usual; 0 where a time is not known."""
    log = np.log(np.maximum(seconds, _SHORTEST_S) / usual)
    return np.where(np.isfinite(log), log, 0.0)


def per_push(values: Array) -> Array:
    """Numbers [B] for maps [B, H, W]."""
    return np.asarray(values, dtype=np.float32)[:, None, None]
