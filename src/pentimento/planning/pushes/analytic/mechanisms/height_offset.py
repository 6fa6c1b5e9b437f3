"""The tool acts at another depth than commanded: by an offset that is equal in all pushes, and by a gradient over the
table."""

from __future__ import annotations

import numpy as np

from pentimento.planning.pushes.analytic.mechanisms.mechanism import Mechanism, Motion, Quantity
from pentimento.planning.pushes.analytic.scene import PushScene


class HeightOffset(Mechanism):
    """See the module. The base has a gain of the depth; the offset is independent of the depth."""

    cause = "height_offset"
    site = "command"
    driving_covariate = "place"
    hidden_from_network = True
    informative_covariates = ("start_x_m", "start_y_m")
    quantities = (
        Quantity("lower_m", "m", 0.0005),
        Quantity("lower_to_the_right_m", "m/half extent", 0.0005),
        Quantity("lower_to_the_top_m", "m/half extent", 0.0005),
    )

    @classmethod
    def reference_of(cls, scene: PushScene) -> dict[str, float]:
        low, high = scene.action[:, :2].min(0), scene.action[:, :2].max(0)
        half = max(float((high - low).max()) / 2, 1e-6)
        return {"x_m": float(low[0] + high[0]) / 2, "y_m": float(low[1] + high[1]) / 2, "half_m": half}

    def motion(self, motion: Motion, scene: PushScene) -> Motion:
        middle = np.array([self.reference["x_m"], self.reference["y_m"]])
        place = (scene.action[:, :2] - middle) / self.reference["half_m"]
        return motion._replace(lower_m=motion.lower_m + self.values[0] + place @ self.values[1:])
