"""What happened to the clay before a push, as far as no height map shows it: earlier pushes, and covariates."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
_COUNTS = ("order", "pushes_since_reset")
"""Covariates that grow by one with each push."""


@dataclass(frozen=True, eq=False)
class PushMemory:
    """The memory of one slab, for the next push."""

    actions: tuple[FloatArray, ...]
    """[5] each: the pushes since the material was smoothed, in their order."""
    covariates: Mapping[str, float]
    """Columns of the ``pushes`` contract, and readings of the room's sensors, that are known of the next push."""

    def after(self, action: FloatArray) -> PushMemory:
        """The memory after a push [5]. Its counts grow by one; time and the room are taken to stand still."""
        grown = {name: self.covariates[name] + 1 for name in _COUNTS if name in self.covariates}
        return PushMemory((*self.actions, action), {**self.covariates, **grown})


FRESH = PushMemory((), {})
"""Of material that was just smoothed, of which nothing else is known."""
