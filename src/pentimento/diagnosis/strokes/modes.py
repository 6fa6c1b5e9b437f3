"""Residual modes of strokes: the ways in which a stroke can deviate as a whole (docs/diagnosis.md §9)."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
import torch
from numpy.typing import NDArray

from pentimento.diagnosis.residual_structure import ModeScores
from pentimento.diagnosis.strokes.jacobian import linearise_rows
from pentimento.diagnosis.strokes.measured import Measured
from pentimento.diagnosis.strokes.model import Model
from pentimento.dynamics.strokes.mechanisms.geometry import bleed, tangent
from pentimento.dynamics.strokes.simulation import Mechanism, Quantity, StrokeContext
from pentimento.dynamics.strokes.traj2stroke import Mark

Array = NDArray[Any]

MODES = ("amplitude", "width", "tangential", "normal", "canvas_x", "canvas_y", "blur")


class AllModes(Mechanism):
    """All modes at once, by an amount of each that is equal for all strokes."""

    cause: ClassVar[str] = "modes"
    site = "density"
    quantities = (
        Quantity("amplitude", "1", 0.2),
        Quantity("width", "1", 0.2),
        Quantity("tangential", "m", 0.0005),
        Quantity("normal", "m", 0.0005),
        Quantity("canvas_x", "m", 0.0005),
        Quantity("canvas_y", "m", 0.0005),
        Quantity("blur", "1", 0.4),
    )

    def mark(self, mark: Mark, context: StrokeContext) -> Mark:
        """See ``Mechanism``."""
        amplitude, width, tangential, normal, x, y, blur = self.values
        along = tangent(context.path)
        across = torch.stack([-along[..., 1], along[..., 0]], dim=-1)
        moved = mark._replace(
            points_m=mark.points_m + tangential * along + normal * across + torch.stack([x, y]),
            radius_m=mark.radius_m * torch.exp(width),
            density=mark.density * torch.exp(amplitude),
        )
        return bleed(moved, blur.expand_as(mark.radius_m), torch.zeros_like(mark.radius_m))


def mode_scores(model: Model, measured: Measured) -> ModeScores:
    """Amounts of the modes in the residuals of a model."""
    curvature, slope, error = linearise_rows(model.plus(AllModes(torch.zeros(len(MODES)), {})), measured)
    energy = np.einsum("bmm->bm", curvature[:, -len(MODES) :, -len(MODES) :])
    return ModeScores(slope[:, -len(MODES) :] / np.maximum(energy, 1e-12), energy, float(error.mean()))
