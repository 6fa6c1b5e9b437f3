"""Training of TrajVAE: pretrained on all writers, then fine-tuned on a few strokes of one (thesis 5.3.3)."""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass

import torch

from pentimento.contracts.ranges import above_zero, at_least
from pentimento.handwriting.trajvae import Strokes, TrajVAE, sizes_m

Log = Callable[[str, float, int], None]


@dataclass(frozen=True)
class Course:
    """One training run with Adam. The rate falls to 0 along half a cosine."""

    steps: int
    batch: int
    rate: float

    def __post_init__(self) -> None:
        at_least(self, 1, "steps", "batch")
        above_zero(self, "rate")


@dataclass(frozen=True)
class TrajVAEConfig:
    """How TrajVAE is built and trained."""

    points: int
    """Points of each stroke, at equal arc length (thesis: 32)."""
    latent: int
    """Size of the latent space (thesis: 64)."""
    width: int
    """Width of both hidden layers."""
    kl_weight: float
    """Weight of the Kullback-Leibler divergence, relative to the squared error in units of the strokes' size."""
    pretraining: Course
    fine_tuning: Course
    augmentation_std: float
    """Augmentation: standard deviation of a random linear map of each stroke around the identity, drawn at each step.
    """
    seed: int

    def __post_init__(self) -> None:
        at_least(self, 2, "points")
        at_least(self, 1, "latent", "width")
        at_least(self, 0, "kl_weight", "augmentation_std", "seed")


def pretrain(strokes: Strokes, config: TrajVAEConfig, log: Log) -> TrajVAE:
    """A model of all strokes. ``log("loss", value, step)`` is called every 50 steps."""
    scale_m = float(sizes_m(strokes.xy_m).square().mean().sqrt())
    known = strokes.height_known > 0
    height_scale_m = float(strokes.height_m[known].square().mean().sqrt()) if known.any() else 1.0
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(config.seed)
        model = TrajVAE(config.points, config.latent, config.width, scale_m, max(height_scale_m, 1e-6))
    _train(model, (strokes,), config, course=config.pretraining, seed=config.seed, log=log)
    return model


def fine_tune(model: TrajVAE, strokes: Strokes, known: Strokes, config: TrajVAEConfig, log: Log) -> TrajVAE:
    """A copy of the model, fine-tuned on these strokes with rehearsal of the pretraining strokes ``known``.

    Without rehearsal, a few strokes would make the model forget what all writers share (Robins 1995, Catastrophic
    forgetting, rehearsal and pseudorehearsal).
    """
    own = deepcopy(model)
    _train(own, (strokes, known), config, course=config.fine_tuning, seed=config.seed + 1, log=log)
    return own


def _train(
    model: TrajVAE, sources: tuple[Strokes, ...], config: TrajVAEConfig, *, course: Course, seed: int, log: Log
) -> None:
    """Minimise the sum of the sources' mean losses, with one batch of each per step."""
    generator = torch.Generator().manual_seed(seed)
    adam = torch.optim.Adam(model.parameters(), lr=course.rate)
    falling = torch.optim.lr_scheduler.CosineAnnealingLR(adam, course.steps)
    for step in range(course.steps):
        loss = torch.zeros(())
        for strokes in sources:
            count = len(strokes.xy_m)
            index = torch.randint(count, (min(course.batch, count),), generator=generator)
            varied = _varied(strokes.pick(index), config.augmentation_std, generator)
            loss = loss + model.loss(varied, config.kl_weight, generator)
        adam.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        adam.step()
        falling.step()
        if step % _LOGGED == 0 or step == course.steps - 1:
            log("loss", float(loss.detach()), step)


def _varied(strokes: Strokes, std: float, generator: torch.Generator) -> Strokes:
    """Each stroke under a random linear map near the identity, rotated so that it ends on the x axis again."""
    change = torch.eye(2) + std * torch.randn(len(strokes.xy_m), 2, 2, generator=generator)
    xy = strokes.xy_m @ change
    angle = torch.atan2(xy[:, -1, 1], xy[:, -1, 0])
    cos, sin = angle.cos(), angle.sin()
    turn = torch.stack([torch.stack([cos, -sin], -1), torch.stack([sin, cos], -1)], -2)
    return strokes._replace(xy_m=xy @ turn)


_LOGGED = 50
