"""Interface of the mechanisms: which stage of a predicted push a cause may change.

    command ── motion ──→ contact ── kept ──→ indentation ── settled ──→ rims and surface
               (command)             (material)              (surface)
               (contact)             (contact)

A mechanism models one named cause of an error of the base model. It acts at its site; at all other stages it is the
identity. With all quantities at zero it changes nothing, and its effect is smooth in them there.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any, ClassVar, Literal, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.causes import NotObservable, Quantity
from pentimento.planning.pushes.analytic.scene import PushScene

Array = NDArray[Any]
Site = Literal["command", "contact", "material", "surface"]
_MIN_TIME_S = 0.05
"""Shorter times count as this long."""
_MIN_LOG_SPREAD = 0.3
"""Minimum standard deviation of the logarithm of a time that is taken to vary."""
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
    "spread",
    "usual_s",
]
_REACH = 4.0
"""Of the blur kernel, in standard deviations."""
_WIDE_KERNEL = 0.1
"""Share of a map's side above which a kernel is cheaper as a matrix product."""


class Motion(NamedTuple):
    """Deviation of the tool's motion from its command, [B] each."""

    along_m: Array
    across_m: Array
    lower_m: Array
    """Extra depth along the whole travel."""
    lower_at_start_m: Array
    """Extra depth at the start of the travel, which falls linearly to 0 at its end."""
    log_depth: Array
    """Logarithm of a factor on the depth."""
    log_width: Array
    """Logarithm of a factor on the apparent width of the tool."""
    log_depth_at_rest: Array
    """Logarithm of a factor on the depth at the end of the travel alone, where the tool rests."""
    hardening: Array
    """Relative increase of the resistance of fully worked material over fresh material."""


class Contact(NamedTuple):
    """Where the tool passed below the surface, float32[B, H, W] each."""

    pressed_m: Array
    """Depth of the tool's lower envelope below the surface in ``before``."""
    inside: Array
    """0 outside the contact, 1 inside, with a soft edge."""
    beyond_end: Array
    """Distance ahead of the centre of the final contact, in radii of that contact."""
    peak: Array
    """Shape of the peak that a tool draws up out of its surroundings as it lifts off: 1 at the centre, zero total
    volume."""
    heaped_m: Array
    """Height of the displaced material around the groove (``heaping``)."""


class Settled(NamedTuple):
    """Parts of the change of height, float32[B, H, W] each."""

    indentation_m: Array
    """The part of ``pressed_m`` that stays, positive downwards."""
    rims_m: Array
    """Displaced material around it."""
    lift_m: Array
    """All other change, positive upwards."""


class Mechanism:
    """One cause."""

    cause: ClassVar[str]
    """Its name in the vocabulary."""
    site: ClassVar[Site]
    driving_covariate: ClassVar[str]
    """The name of its family, mostly the covariate that the effect depends on. Causes of one family are compared with
    each other, because they are aliased where their assumed forms are inexact."""
    quantities: ClassVar[tuple[Quantity, ...]]
    informative_covariates: ClassVar[tuple[str, ...]] = ()
    """Columns and properties of the surface and path that the effect depends on."""
    hidden_from_network: ClassVar[bool]
    """Whether the effect depends on what a network in the push's own pose does not see: place on the table, heading,
    time or history. `correction` adds such a cause to the network's prediction."""

    def __init__(self, values: Array, reference: Mapping[str, float]) -> None:
        """``values`` float64[Q] in the quantities' units; ``reference`` as from ``reference_of`` on the fitted
        pushes."""
        self.values, self.reference = values, reference

    @property
    def signature(self) -> tuple[str, ...]:
        """Quantities of which at least one must be positive for the cause to deserve its name; empty: no such
        condition."""
        return ()

    @property
    def active(self) -> bool:
        """Whether any quantity is not zero."""
        return bool(np.any(self.values))

    @property
    def physical(self) -> bool:
        """Whether the fitted values are physically possible, beyond the sign constraints of the fit."""
        return True

    @classmethod
    def reference_of(cls, scene: PushScene) -> dict[str, float]:
        """Constants that the effect is relative to.

        Raises:
            NotObservable: these pushes cannot show the effect, because its covariate was not recorded or does not vary.
        """
        return {}

    def motion(self, motion: Motion, scene: PushScene) -> Motion:
        """The tool's motion; for the sites command and contact."""
        return motion

    def kept(self, kept_m: Array, contact: Contact, scene: PushScene) -> Array:
        """The part of the contact that stays as indentation, [B, H, W] metres; for the sites contact and material."""
        return kept_m

    def settled(self, settled: Settled, contact: Contact, scene: PushScene) -> Settled:
        """Indentation, rims and lift; for the site surface."""
        return settled


def recorded(scene: PushScene, *names: str) -> str:
    """The first of these columns that is known for every push and varies.

    Raises:
        NotObservable: there is none.
    """
    for name in names:
        values = scene.covariates.get(name)
        if values is not None and bool(np.isfinite(values).all()) and varies(values):
            return name
    raise NotObservable(f"{' or '.join(names)} was not recorded for every push, or does not vary")


def varies(values: Array) -> bool:
    """Whether values differ by more than rounding."""
    return float(np.ptp(values)) > 1e-3 * float(np.abs(values).max()) + 1e-12


def column(scene: PushScene, name: str) -> Array:
    """A column that an effect depends on, float64[B].

    Raises:
        NotObservable: the scene has no such column.
    """
    if name not in scene.covariates:
        raise NotObservable(f"{name} is not known of these pushes, and the mechanism depends on it")
    return scene.covariates[name]


def usual_s(seconds: Array | None) -> float | None:
    """Geometric mean of times [B]; None if one is unknown, or if they hardly vary."""
    if seconds is None or not np.isfinite(seconds).all():
        return None
    logs = np.log(np.maximum(seconds, _MIN_TIME_S))
    return float(np.exp(logs.mean())) if np.std(logs) > _MIN_LOG_SPREAD else None


def log_times(seconds: Array, usual: float) -> Array:
    """Logarithm [B] of times relative to ``usual``; 0 where a time is unknown."""
    log = np.log(np.maximum(seconds, _MIN_TIME_S) / usual)
    return np.where(np.isfinite(log), log, 0.0)


def per_push(values: Array) -> Array:
    """Values [B] as float32[B, 1, 1], for maps [B, H, W]."""
    return np.asarray(values, dtype=np.float32)[:, None, None]


def spread(maps: Array, sigma_px: float) -> Array:
    """Maps [B, H, W] convolved with a normalised Gaussian, float32; beyond the edges they count as 0."""
    kernel = _kernel(sigma_px)
    maps = maps.astype(np.float32, copy=False)
    if len(kernel) > _WIDE_KERNEL * min(maps.shape[1:]):
        return _sums(sigma_px, maps.shape[1]) @ (maps @ _sums(sigma_px, maps.shape[2]))
    blurred = np.empty(maps.shape, dtype=np.float32)
    for into, each in zip(blurred, maps, strict=True):
        cv2.sepFilter2D(each, -1, kernel, kernel, dst=into, borderType=cv2.BORDER_CONSTANT)
    return blurred


def _kernel(sigma_px: float) -> Array:
    """Normalised Gaussian, float32[K, 1]."""
    return np.asarray(cv2.getGaussianKernel(2 * int(np.ceil(_REACH * sigma_px)) + 1, sigma_px, cv2.CV_32F))


@lru_cache(maxsize=16)
def _sums(sigma_px: float, size: int) -> Array:
    """Matrix [size, size] of the convolution along a line."""
    kernel = _kernel(sigma_px)
    reach = len(kernel) // 2
    place = np.arange(size)
    distance = place[:, None] - place
    return np.where(abs(distance) <= reach, kernel[np.clip(distance + reach, 0, 2 * reach), 0], np.float32(0))
