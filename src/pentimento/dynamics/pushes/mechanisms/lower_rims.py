"""The rims are lower than what is displaced, by a share.

No cause of the vocabulary, but what looks like one: a swell far from the contact takes its volume from the rims
(``far_field``). Here that volume is nowhere.
"""

from __future__ import annotations

import numpy as np

from pentimento.dynamics.pushes.analytic_scene import PushScene
from pentimento.dynamics.pushes.mechanisms.mechanism import Contact, Mechanism, Quantity, Settled


class LowerRims(Mechanism):
    """See above."""

    cause = "lower_rims"
    site = "surface"
    driving_covariate = "volume"
    quantities = (Quantity("share", "1", 0.2),)

    def settled(self, settled: Settled, contact: Contact, scene: PushScene) -> Settled:
        return settled._replace(rims_m=settled.rims_m * np.float32(1 - self.values[0]))
