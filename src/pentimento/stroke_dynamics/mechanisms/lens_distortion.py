"""Points are displaced along the radius from the picture's middle, by the cube of their distance."""

from __future__ import annotations

from pentimento.stroke_dynamics.mechanisms.geometry import place, relative_place
from pentimento.stroke_dynamics.simulation import Mechanism, Quantity, StrokeContext
from pentimento.stroke_dynamics.traj2stroke import Mark


class LensDistortion(Mechanism):
    """See above."""

    cause = "lens_distortion"
    site = "camera"
    driver = "view"
    quantities = (Quantity("at_edge_m", "m", 0.0005),)

    @classmethod
    def reference_of(cls, context: StrokeContext) -> dict[str, float]:
        return place(context)

    def mark(self, mark: Mark, context: StrokeContext) -> Mark:
        at = relative_place(mark.points_m, self.reference)
        return mark._replace(points_m=mark.points_m + self.values[0] * at * at.square().sum(-1, keepdim=True))
