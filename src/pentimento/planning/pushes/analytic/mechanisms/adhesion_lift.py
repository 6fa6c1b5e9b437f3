"""Material is pulled up as the tool retracts: a peak at the end of its travel, drawn from its surroundings.

A peak that is equal in all pushes belongs to the base (``end_lift``). The cause is its dependence on the retraction
speed and on the dwell: tack grows with the rate of separation and with the time of contact (Zosel 1985).
"""

from __future__ import annotations

import numpy as np

from pentimento.planning.pushes.analytic.mechanisms.mechanism import (
    Contact,
    Mechanism,
    Quantity,
    Settled,
    column,
    log_times,
    per_push,
    recorded,
    usual_s,
)
from pentimento.planning.pushes.analytic.scene import PushScene

_COLUMN = "retract_speed_m_s"
_MIN_SPEED_M_S = 1e-4
"""Slower retractions count as this fast."""


class AdhesionLift(Mechanism):
    """See above."""

    cause = "adhesion_lift"
    site = "surface"
    driving_covariate = "retraction"
    hidden_from_network = True
    informative_covariates = (_COLUMN, "dwell_s")
    quantities = (
        Quantity("lift_by_log_speed_m", "m", 0.0003),
        Quantity("lift_by_log_dwell_m", "m", 0.0003, signed=False),
    )

    @classmethod
    def reference_of(cls, scene: PushScene) -> dict[str, float]:
        speed = column(scene, recorded(scene, _COLUMN))
        usual = {_COLUMN: float(np.exp(np.log(np.maximum(speed, _MIN_SPEED_M_S)).mean()))}
        dwell = usual_s(scene.covariates.get("dwell_s"))
        return usual if dwell is None else usual | {"dwell_s": dwell}

    def settled(self, settled: Settled, contact: Contact, scene: PushScene) -> Settled:
        log = np.log(np.maximum(column(scene, _COLUMN), _MIN_SPEED_M_S) / self.reference[_COLUMN])
        lift_m = self.values[0] * np.where(np.isfinite(log), log, 0.0)
        if "dwell_s" in self.reference:
            lift_m += self.values[1] * log_times(column(scene, "dwell_s"), self.reference["dwell_s"])
        return settled._replace(lift_m=settled.lift_m + per_push(lift_m) * contact.peak)
