"""Points are displaced along the radius from the photograph's centre, by the cube of their distance.

Rectification by markers keeps the markers' places. It thereby absorbs a part that is linear in the distance, which
depends on the markers' places and is a quantity of its own.
"""

from __future__ import annotations

from pentimento.dynamics.strokes.mechanisms.geometry import place, relative_place
from pentimento.dynamics.strokes.simulation import Mechanism, Quantity, StrokeContext
from pentimento.dynamics.strokes.traj2stroke import Mark


class LensDistortion(Mechanism):
    """See the module; the first radial term of Brown (1971)."""

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
        cubic, absorbed = self.values
        return mark._replace(points_m=mark.points_m + at * (cubic * at.square().sum(-1, keepdim=True) - absorbed))
