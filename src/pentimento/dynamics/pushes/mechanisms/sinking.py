"""Material gives way while the tool rests at the end of its travel, the more the longer: it goes deeper there.

No cause of the vocabulary, but what looks like one: where more stays of what is pressed after a longer rest
(``springback``), the footprint is deeper, too. Here it is wider as well, and the rims are higher.
"""

from __future__ import annotations

from pentimento.dynamics.pushes.analytic_scene import PushScene
from pentimento.dynamics.pushes.mechanisms.mechanism import (
    Mechanism,
    Motion,
    NotObservable,
    Quantity,
    column,
    log_times,
    usual_s,
)


class Sinking(Mechanism):
    """See above."""

    cause = "sinking"
    site = "command"
    driving_covariate = "rest"
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
