"""Material that was pushed before is harder: later pushes go less deep, and a smaller part of the indentation stays.

After earlier work w, the resistance grows by b w / (w + 5 mm) relative to fresh material, so that a compliant arm goes
less deep. Of the indentation, exp(-a w) stays.
"""

from __future__ import annotations

import numpy as np

from pentimento.planning.pushes.analytic.mechanisms.mechanism import (
    Array,
    Contact,
    Mechanism,
    Motion,
    NotObservable,
    Quantity,
)
from pentimento.planning.pushes.analytic.scene import PushScene

_WORK_SCALE_M = 0.005
"""Unit of earlier work (summed depth)."""
_MIN_OVERLAP = 0.02
"""Minimum share of pushes that pass over an earlier push."""


class WorkHardening(Mechanism):
    """See above."""

    cause = "work_hardening"
    site = "contact"
    driving_covariate = "history"
    hidden_from_network = True
    informative_covariates = ("worked_below_m",)
    quantities = (
        Quantity("loss", "1 per 5 mm of earlier work", 0.2, signed=False),
        Quantity("harder", "1", 0.5, signed=False),
    )

    @classmethod
    def reference_of(cls, scene: PushScene) -> dict[str, float]:
        if not scene.history_known:
            raise NotObservable("the rows do not say when the material was smoothed (reset_id)")
        if (scene.worked.max((1, 2)) > _WORK_SCALE_M / 10).mean() < _MIN_OVERLAP:
            raise NotObservable("hardly a push goes where an earlier one went since the material was smoothed")
        return {}

    def motion(self, motion: Motion, scene: PushScene) -> Motion:
        return motion._replace(hardening=motion.hardening + self.values[1])

    def kept(self, kept_m: Array, contact: Contact, scene: PushScene) -> Array:
        return kept_m * np.exp(np.float32(-self.values[0] / _WORK_SCALE_M) * scene.worked)
