"""The line is wider or narrower where the path bends, and more so on the outer side of the bend."""

from __future__ import annotations

import torch

from pentimento.stroke_dynamics.mechanisms.geometry import bending_per_m, tangent
from pentimento.stroke_dynamics.simulation import Mechanism, NotObservable, Quantity, StrokeContext
from pentimento.stroke_dynamics.traj2stroke import Mark


class CurvatureWidth(Mechanism):
    """See above."""

    cause = "curvature_width"
    site = "width"
    driver = "bend"
    quantities = (Quantity("width_per_bend", "1", 0.2), Quantity("outward_per_bend_m", "m", 0.0005))

    @classmethod
    def reference_of(cls, context: StrokeContext) -> dict[str, float]:
        bending = bending_per_m(context.path).abs()
        if float(bending.max()) < 1.0:
            raise NotObservable("all strokes are straight")
        return {"bending_per_m": float(bending.mean() + 2 * bending.std())}

    def mark(self, mark: Mark, context: StrokeContext) -> Mark:
        bend = (bending_per_m(context.path) / self.reference["bending_per_m"]).clamp(-2.0, 2.0)[..., None]
        along = tangent(context.path)
        right = torch.stack([along[..., 1], -along[..., 0]], dim=-1)
        return mark._replace(
            points_m=mark.points_m + self.values[1] * bend * right,
            radius_m=mark.radius_m * torch.exp(self.values[0] * bend[..., 0].abs()),
        )
