"""Simulated photographs of strokes: a stroke model's mark, changed by mechanisms at five sites, laid on the canvas.

    path ─ model ─→ points ─→ radius ─→ density, softness ─→ colour, pickup ─→ composition ─→ image
                 trajectory   width       density             composite                      camera

A mechanism is one named cause of the model's residual. It acts at its site and is the identity at all others. A
mechanism that changes the press depth acts before the model, which maps press to width. Everything is differentiable in
the mechanisms' quantities, the model's parameters, and the paths.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import ClassVar, Literal, NamedTuple

import torch
from torch import Tensor

from pentimento.contracts.causes import NotObservable as NotObservable
from pentimento.contracts.causes import Quantity as Quantity
from pentimento.dynamics.strokes.autograd import render_strokes
from pentimento.dynamics.strokes.traj2stroke import Mark
from pentimento.render.strokes import PixelStrokes


class View(NamedTuple):
    """The part of the canvas that each of B images shows."""

    top_left_m: Tensor  # [B, 2] x_min, y_max
    pixels_per_m: Tensor  # [B]

    def to_pixels(self, points_m: Tensor) -> Tensor:
        """Canvas points [B, ..., 2] to pixel coordinates (column, row)."""
        lead = (-1,) + (1,) * (points_m.ndim - 2)
        scale = self.pixels_per_m.view(lead)
        x = (points_m[..., 0] - self.top_left_m[:, 0].view(lead)) * scale - 0.5
        y = (self.top_left_m[:, 1].view(lead) - points_m[..., 1]) * scale - 0.5
        return torch.stack([x, y], dim=-1)


Site = Literal["trajectory", "width", "density", "composite", "camera"]
_ORDER: tuple[Site, ...] = ("trajectory", "width", "density", "composite", "camera")


class StrokeContext(NamedTuple):
    """What is known of B x S strokes before their execution."""

    path: Tensor
    """[B, S, N, 5] commanded: t_s, x_m, y_m, z_m, yaw_rad."""
    covariates: Mapping[str, Tensor]
    """[B, S] each: columns of the strokes contract."""


class Mechanism:
    """One cause of a stroke model's residual. With all quantities at zero it changes nothing."""

    cause: ClassVar[str]
    """Its name in the vocabulary."""
    site: ClassVar[Site]
    driving_covariate: ClassVar[str]
    """The name of its family, mostly the covariate that the effect depends on. Causes of one family are compared with
    each other, because they are aliased where their assumed forms are not exact."""
    quantities: ClassVar[tuple[Quantity, ...]]
    informative_covariates: ClassVar[tuple[str, ...]] = ()
    """Covariates of a stroke, recorded or computed from its path, that the effect depends on."""
    signature: ClassVar[tuple[str, ...]] = ()
    """Quantities of which at least one must differ from zero for the cause to deserve its name; empty: any."""

    def __init__(self, values: Tensor, reference: Mapping[str, float]) -> None:
        """``values`` [P] in the quantities' units; ``reference`` as by ``reference_of`` of the fitted strokes."""
        self.values, self.reference = values, reference

    @property
    def active(self) -> bool:
        """Whether a quantity differs from zero, so that the mechanism changes the prediction."""
        return bool(self.values.any())

    @classmethod
    def reference_of(cls, context: StrokeContext) -> dict[str, float]:
        """The constants that the effect is relative to.

        Raises:
            NotObservable: the effect is not identifiable: a covariate was not recorded or did not vary.
        """
        return {}

    def executed(self, path: Tensor, context: StrokeContext) -> Tensor:
        """The executed path [B, S, N, 5] for the command ``path``, where the press differs."""
        return path

    def mark(self, mark: Mark, context: StrokeContext) -> Mark:
        """The mark after the effect; for the sites trajectory, width and density."""
        return mark

    def composite(self, color: Tensor, pickup: Tensor | None, context: StrokeContext) -> tuple[Tensor, Tensor | None]:
        """The paint, linear light [B, S, 3], and the share of wet paint picked up, [B, S] or none."""
        return color, pickup

    def camera(self, image: Tensor, view: View) -> Tensor:
        """The image, linear light [B, H, W, 3]."""
        return image


def executed_path(mechanisms: Sequence[Mechanism], context: StrokeContext) -> Tensor:
    """The paths [B, S, N, 5] with the press that is executed."""
    path = context.path
    for mechanism in mechanisms:
        path = mechanism.executed(path, context)
    return path


def extended_mark(base: Callable[[Tensor], Mark], mechanisms: Sequence[Mechanism], context: StrokeContext) -> Mark:
    """The base model's mark after the sites trajectory, width and density."""
    mark = base(executed_path(mechanisms, context))
    for mechanism in in_order(mechanisms):
        mark = mechanism.mark(mark, context)
    return mark


def final_mark(
    base: Callable[[Tensor], Mark],
    mechanisms: Sequence[Mechanism],
    context: StrokeContext,
    correction: Callable[[Mark, Tensor], Mark] | None = None,
) -> Mark:
    """The mark that is rendered: ``extended_mark`` with its density limited to 1, and corrected."""
    mark = extended_mark(base, mechanisms, context)
    mark = mark._replace(density=mark.density.clamp(max=1.0))
    return mark if correction is None else correction(mark, executed_path(mechanisms, context))


def in_order(mechanisms: Sequence[Mechanism]) -> list[Mechanism]:
    """The mechanisms sorted by site, in the order of the sites."""
    return sorted(mechanisms, key=lambda mechanism: _ORDER.index(mechanism.site))


def simulate(
    base: Callable[[Tensor], Mark],
    mechanisms: Sequence[Mechanism],
    context: StrokeContext,
    *,
    color: Tensor,
    canvas: Tensor,
    view: View,
    correction: Callable[[Mark, Tensor], Mark] | None = None,
) -> Tensor:
    """The images after the strokes, linear light.

    Args:
        base: the stroke model, paths [..., N, 5] to marks.
        mechanisms: in any order.
        color: [B, S, 3], linear light.
        canvas: [B, H, W, 3], linear light; with a fourth channel, wetness, where a mechanism picks up paint.
        correction: of the extended mark, given the executed paths.

    Returns:
        [B, H, W, 3].
    """
    mark = final_mark(base, mechanisms, context, correction)
    pickup = None
    for mechanism in mechanisms:
        color, pickup = mechanism.composite(color, pickup, context)
    radius = mark.radius_m * view.pixels_per_m[:, None, None]
    strokes = PixelStrokes(view.to_pixels(mark.points_m), radius, mark.density, mark.softness, color, pickup)
    image = render_strokes(strokes, canvas)[..., :3]
    for mechanism in mechanisms:
        image = mechanism.camera(image, view)
    return image.clamp(min=0.0) if mechanisms else image  # strong pickup can make values negative
