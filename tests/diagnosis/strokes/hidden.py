"""Example strokes with something hidden in their photographs."""

from dataclasses import replace
from typing import ClassVar

import numpy as np
import torch

from pentimento.contracts.strokes import example_table
from pentimento.diagnosis.strokes.fit import first_model, fit
from pentimento.diagnosis.strokes.measured import Measured, load_measured
from pentimento.diagnosis.strokes.model import Model, identity
from pentimento.diagnosis.strokes.modes import MODES, AllModes
from pentimento.diagnosis.strokes.predict import predicted
from pentimento.dynamics.strokes.mechanisms.geometry import bleed, tangent
from pentimento.dynamics.strokes.simulation import Mechanism, StrokeContext
from pentimento.dynamics.strokes.traj2stroke import Mark


class Swaying(Mechanism):
    """Each stroke deviates in every residual mode by its own covariate ``sway_<mode>``, in the mode's unit."""

    cause: ClassVar[str] = "swaying"
    site = "density"
    driving_covariate = "anything"
    quantities = AllModes.quantities

    @property
    def active(self) -> bool:
        return True

    def mark(self, mark: Mark, context: StrokeContext) -> Mark:
        amplitude, width, tangential, normal, x, y, blur = (
            context.covariates[f"sway_{mode}"][..., None] for mode in MODES
        )
        along = tangent(context.path)
        across = torch.stack([-along[..., 1], along[..., 0]], dim=-1)
        shift = tangential[..., None] * along + normal[..., None] * across
        moved = mark._replace(
            points_m=mark.points_m + shift + torch.stack([x, y], dim=-1),
            radius_m=mark.radius_m * torch.exp(width),
            density=mark.density * torch.exp(amplitude),
        )
        still = torch.zeros_like(mark.radius_m)
        return bleed(moved, blur.expand_as(still), still)._replace(softness=mark.softness * torch.exp(blur))


def swayed(model: Model, measured: Measured, amounts: np.ndarray) -> tuple[Model, Measured]:
    """A model and strokes whose residual modes deviate by these amounts [B, M], in the modes' units."""
    columns = {f"sway_{mode}": amounts[:, m] for m, mode in enumerate(MODES)}
    swaying = model.plus(Swaying(torch.zeros(len(MODES), dtype=torch.float64), {}))
    return swaying, replace(measured, covariates=measured.covariates | columns)


def photographed(measured: Measured, photographs: np.ndarray) -> Measured:
    """The strokes with other photographs after."""
    after = torch.from_numpy(photographs.astype(np.float32))
    return replace(measured, samples=measured.samples._replace(after=after))


def strokes_of(kind: type[Mechanism], *values: float) -> tuple[Measured, Model]:
    """Strokes with a cause, each a little darker or paler than the others, and a base that is fitted to them."""
    measured = load_measured(example_table(40).drop_columns(["measured_path"]))
    base = fit(first_model(measured), measured)
    mechanism = kind(torch.tensor(values, dtype=torch.float64), identity(kind, measured.context).reference)
    after = predicted(base.plus(mechanism), measured)
    rng = np.random.default_rng(0)
    darker = 1 + 0.05 * rng.standard_normal((len(measured), 1, 1, 1))
    below = measured.samples.before.numpy()
    after = below + darker * (after - below) + 0.01 * rng.standard_normal(after.shape)
    strokes = photographed(measured, after)
    return strokes, fit(first_model(strokes), strokes)
