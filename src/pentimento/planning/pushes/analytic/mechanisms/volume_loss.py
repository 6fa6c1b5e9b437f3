"""Displaced material does not reappear completely in the rims, because it is compacted; the loss depends on the volume.

With V the pressed volume,  rims' = rims * (1 - a - b (V / V_usual - 1)).
"""

from __future__ import annotations

import numpy as np

from pentimento.planning.pushes.analytic.mechanisms.mechanism import (
    Array,
    Contact,
    Mechanism,
    Quantity,
    Settled,
    per_push,
)
from pentimento.planning.pushes.analytic.scene import PushScene


class VolumeLoss(Mechanism):
    """See above."""

    cause = "volume_loss"
    site = "surface"
    driving_covariate = "volume"
    hidden_from_network = False
    quantities = (
        Quantity("lost_share", "1", 0.3, signed=False),
        Quantity("lost_by_volume", "1/usual volume", 0.2),
    )

    @classmethod
    def reference_of(cls, scene: PushScene) -> dict[str, float]:
        return {"volume_m3": float(np.median(_commanded_volume(scene)))}

    def settled(self, settled: Settled, contact: Contact, scene: PushScene) -> Settled:
        volume = contact.pressed_m.sum((1, 2)) * scene.pixel_m**2
        lost = self.values[0] + self.values[1] * (volume / self.reference["volume_m3"] - 1)
        return settled._replace(rims_m=settled.rims_m * per_push(1 - lost))


def _commanded_volume(scene: PushScene) -> Array:
    """Volume [B] in m³ of a round groove that ramps down over the travel and ends in half a bowl."""
    length, depth = scene.action[:, 3], scene.action[:, 4]
    return np.asarray(np.maximum(depth * scene.half_width_m * (length * 0.67 + scene.half_width_m), 1e-12))
