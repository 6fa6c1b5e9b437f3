"""An offset that depends on the sign of the motion along each axis of the table."""

from __future__ import annotations

import numpy as np

from pentimento.planning.pushes.analytic.mechanisms.mechanism import Mechanism, Motion, NotObservable, Quantity
from pentimento.planning.pushes.analytic.scene import PushScene

_DEAD_ZONE = 0.1
"""Component of the motion's direction along an axis below which the backlash is partial."""
_MIN_HEADING_SPREAD = 0.05
"""Minimum circular variance of the headings."""


class ToolBacklash(Mechanism):
    """See above."""

    cause = "tool_backlash"
    site = "command"
    driving_covariate = "reversal"
    hidden_from_network = True
    informative_covariates = ("heading_cos", "heading_sin")
    quantities = (
        Quantity("x_m", "m", 0.0005),
        Quantity("y_m", "m", 0.0005),
    )

    @classmethod
    def reference_of(cls, scene: PushScene) -> dict[str, float]:
        heading = scene.action[:, 2]
        if 1 - np.hypot(np.cos(heading).mean(), np.sin(heading).mean()) < _MIN_HEADING_SPREAD:
            raise NotObservable("all pushes go in one direction")
        return {}

    def motion(self, motion: Motion, scene: PushScene) -> Motion:
        cos, sin = np.cos(scene.action[:, 2]), np.sin(scene.action[:, 2])
        x = -self.values[0] * np.tanh(cos / _DEAD_ZONE)
        y = -self.values[1] * np.tanh(sin / _DEAD_ZONE)
        return motion._replace(along_m=motion.along_m + cos * x + sin * y, across_m=motion.across_m + cos * y - sin * x)
