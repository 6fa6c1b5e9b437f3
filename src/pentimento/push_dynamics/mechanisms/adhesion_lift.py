"""Material is pulled up as the tool retracts, the more the faster: a peak at the end of travel, out of what is around.

What every push leaves there is the base's (``end_lift``); the cause is what follows the speed of retracting.
"""

from __future__ import annotations

import numpy as np

from pentimento.push_dynamics.analytic_scene import PushScene
from pentimento.push_dynamics.mechanisms.mechanism import (
    Contact,
    Mechanism,
    Quantity,
    Settled,
    column,
    per_push,
    recorded,
)

_COLUMN = "retract_speed_m_s"
_SLOWEST_M_S = 1e-4


class AdhesionLift(Mechanism):
    """See above."""

    cause = "adhesion_lift"
    site = "surface"
    driver = "retraction"
    imitable = False
    quantities = (Quantity("lift_by_log_speed_m", "m", 0.0003),)

    @classmethod
    def reference_of(cls, scene: PushScene) -> dict[str, float]:
        speed = column(scene, recorded(scene, _COLUMN))
        return {"retract_speed_m_s": float(np.exp(np.log(np.maximum(speed, _SLOWEST_M_S)).mean()))}

    def settled(self, settled: Settled, contact: Contact, scene: PushScene) -> Settled:
        log = np.log(np.maximum(column(scene, _COLUMN), _SLOWEST_M_S) / self.reference[_COLUMN])
        lift = per_push(self.values[0] * np.where(np.isfinite(log), log, 0.0)) * contact.peak
        return settled._replace(lift_m=settled.lift_m + lift)
