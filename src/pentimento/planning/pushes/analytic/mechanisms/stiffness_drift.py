"""The depth drifts with time (a dough that dries) or with temperature, because a compliant arm yields to a stiffer
material.

With the session's time t scaled to [-1, 1] and the temperature T in half ranges about its middle,

    depth' = depth * exp(a t + b T).
"""

from __future__ import annotations

import numpy as np

from pentimento.planning.pushes.analytic.mechanisms.mechanism import (
    Mechanism,
    Motion,
    NotObservable,
    Quantity,
    column,
    recorded,
)
from pentimento.planning.pushes.analytic.scene import PushScene

_TIME = ("t_start_s", "order")
_TEMPERATURE = ("temperature_c",)


class StiffnessDrift(Mechanism):
    """See above."""

    cause = "stiffness_drift"
    site = "command"
    driving_covariate = "session"
    hidden_from_network = True
    informative_covariates = (*_TIME, *_TEMPERATURE)
    quantities = (
        Quantity("by_half_session", "1", 0.15),
        Quantity("by_half_range_of_temperature", "1", 0.15),
    )

    @classmethod
    def reference_of(cls, scene: PushScene) -> dict[str, float]:
        reference: dict[str, float] = {}
        for key, names in (("time", _TIME), ("temperature", _TEMPERATURE)):
            try:
                name = recorded(scene, *names)
            except NotObservable:
                continue
            values = column(scene, name)
            half = float(np.ptp(values)) / 2
            reference |= {f"{key}_column": float(names.index(name)), f"{key}_middle": float(values.min()) + half}
            reference[f"{key}_half"] = half
        if not reference:
            raise NotObservable("neither times nor temperatures were recorded, or none varies")
        return reference

    def motion(self, motion: Motion, scene: PushScene) -> Motion:
        drift = np.zeros(len(scene))
        for value, key, names in ((self.values[0], "time", _TIME), (self.values[1], "temperature", _TEMPERATURE)):
            if f"{key}_half" in self.reference:
                values = column(scene, names[int(self.reference[f"{key}_column"])])
                position = (values - self.reference[f"{key}_middle"]) / self.reference[f"{key}_half"]
                drift = drift + value * np.where(np.isfinite(position), position, 0.0)
        return motion._replace(log_depth=motion.log_depth + drift)
