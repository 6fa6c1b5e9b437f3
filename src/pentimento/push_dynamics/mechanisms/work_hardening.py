"""Later pushes at one place deform less: what stays falls with how deep earlier pushes went there."""

from __future__ import annotations

import numpy as np

from pentimento.push_dynamics.analytic_scene import PushScene
from pentimento.push_dynamics.mechanisms.mechanism import Array, Contact, Mechanism, NotObservable, Quantity

_DEEP_M = 0.005
_LEAST_SEEN = 0.02
"""Share of the pushes that must go where others went."""


class WorkHardening(Mechanism):
    """See above."""

    cause = "work_hardening"
    site = "material"
    driver = "history"
    quantities = (Quantity("loss", "1 per 5 mm of earlier work", 0.2, signed=False),)

    @classmethod
    def reference_of(cls, scene: PushScene) -> dict[str, float]:
        if not scene.history_known:
            raise NotObservable("the rows do not say when the material was smoothed (reset_id)")
        if (scene.worked.max((1, 2)) > _DEEP_M / 10).mean() < _LEAST_SEEN:
            raise NotObservable("hardly a push goes where an earlier one went since the material was smoothed")
        return {}

    def kept(self, kept_m: Array, contact: Contact, scene: PushScene) -> Array:
        return kept_m * np.exp(np.float32(-self.values[0] / _DEEP_M) * scene.worked)
