"""Points are displaced along the radius from the picture's middle, by the cube of their distance.

A photograph that is rectified by markers keeps its places at these: the rectification takes up a part that grows with
the distance itself (a straight line through the cube), which is a quantity of its own, as it hangs on where the
markers lie.
"""

from __future__ import annotations

from pentimento.dynamics.strokes.mechanisms.geometry import place, relative_place
from pentimento.dynamics.strokes.simulation import Mechanism, Quantity, StrokeContext
from pentimento.dynamics.strokes.traj2stroke import Mark


class LensDistortion(Mechanism):
    """See above (the first radial term of Brown 1971)."""

    cause = "lens_distortion"
    site = "camera"
    driving_covariate = "view"
    informative_covariates = ("place_x_m", "place_y_m")
    quantities = (
        Quantity("at_edge_m", "m", 0.0005),
        Quantity("absorbed_at_edge_m", "m", 0.0005),
    )

    @classmethod
    def reference_of(cls, context: StrokeContext) -> dict[str, float]:
        return place(context)

    def mark(self, mark: Mark, context: StrokeContext) -> Mark:
        at = relative_place(mark.points_m, self.reference)
        cubic, picked_up = self.values
        return mark._replace(points_m=mark.points_m + at * (cubic * at.square().sum(-1, keepdim=True) - picked_up))
