"""Effects that many materials have and that can be mistaken for a cause of the vocabulary.

A diagnosis fits them where they explain more, but does not name them.
"""

from __future__ import annotations

from pentimento.planning.pushes.analytic.mechanisms.mechanism import (
    Mechanism,
    Motion,
    NotObservable,
    Quantity,
    column,
    log_times,
    usual_s,
)
from pentimento.planning.pushes.analytic.scene import PushScene


class ClosedStart(Mechanism):
    """The shallow start of a groove closes again, or was never cut, so that the tool seems to come down later.

    A tool that acts higher than commanded (``height_offset``) also leaves a groove that begins later, but it is less
    deep at the end as well.
    """

    cause = "closed_start"
    site = "command"
    driving_covariate = "place"
    hidden_from_network = False
    quantities = (Quantity("less_deep_m", "m", 0.0005, signed=False),)

    @classmethod
    def reference_of(cls, scene: PushScene) -> dict[str, float]:
        return {}

    def motion(self, motion: Motion, scene: PushScene) -> Motion:
        return motion._replace(lower_at_start_m=motion.lower_at_start_m - self.values[0])


class Sinking(Mechanism):
    """Material yields while the tool rests at the end of its travel, so that a longer dwell makes the push deeper.

    In ``springback``, a longer dwell also leaves a deeper footprint; here the footprint is wider as well, and the rims
    are higher.
    """

    cause = "sinking"
    site = "command"
    driving_covariate = "rest"
    hidden_from_network = True
    quantities = (Quantity("by_log_dwell", "1", 0.05),)

    @classmethod
    def reference_of(cls, scene: PushScene) -> dict[str, float]:
        usual = usual_s(scene.covariates.get("dwell_s"))
        if usual is None:
            raise NotObservable("dwell_s was not recorded for every push, or hardly varies")
        return {"dwell_s": usual}

    def motion(self, motion: Motion, scene: PushScene) -> Motion:
        deeper = self.values[0] * log_times(column(scene, "dwell_s"), self.reference["dwell_s"])
        return motion._replace(log_depth_at_rest=motion.log_depth_at_rest + deeper)
