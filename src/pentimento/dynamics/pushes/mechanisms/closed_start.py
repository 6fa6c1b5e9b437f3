"""The shallow start of a groove closes up again, or was never cut: the tool seems to come down later than it does.

No cause of the vocabulary, but what looks like one: a tool that acts higher than commanded (``height_offset``) leaves a
groove that begins later, too. That is less deep in the end as well.
"""

from __future__ import annotations

from pentimento.dynamics.pushes.analytic_scene import PushScene
from pentimento.dynamics.pushes.mechanisms.mechanism import Mechanism, Motion, Quantity


class ClosedStart(Mechanism):
    """See above."""

    cause = "closed_start"
    site = "command"
    driving_covariate = "place"
    quantities = (Quantity("less_deep_m", "m", 0.0005, signed=False),)

    @classmethod
    def reference_of(cls, scene: PushScene) -> dict[str, float]:
        return {}

    def motion(self, motion: Motion, scene: PushScene) -> Motion:
        return motion._replace(lower_at_start_m=motion.lower_at_start_m - self.values[0])
