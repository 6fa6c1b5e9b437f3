"""Small displacement far from the contact: part of the rims' volume rises in a wide, flat swell."""

from __future__ import annotations

import numpy as np

from pentimento.planning.pushes.analytic.mechanisms.mechanism import Contact, Mechanism, Quantity, Settled, spread
from pentimento.planning.pushes.analytic.scene import PushScene

_REACHES = (2.2, 5.0)
"""Widths of the swell's two components, in half-widths of the footprint: wider than the base's rims, and with a long
tail as in an elastic body."""


class FarField(Mechanism):
    """See above."""

    cause = "far_field"
    site = "surface"
    driving_covariate = "distance"
    hidden_from_network = False
    quantities = (Quantity("share", "1", 0.2, signed=False),)

    def settled(self, settled: Settled, contact: Contact, scene: PushScene) -> Settled:
        share = np.float32(self.values[0])
        half_px = scene.half_width_m / scene.pixel_m
        swell = sum(spread(settled.indentation_m, reach * half_px) for reach in _REACHES) / np.float32(len(_REACHES))
        return settled._replace(rims_m=settled.rims_m * (1 - share), lift_m=settled.lift_m + share * swell)
