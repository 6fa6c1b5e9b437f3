"""Training of TrajVAE: pretrained on all writers, then fine-tuned on a few strokes of one (thesis 5.3.3)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from copy import deepcopy
from dataclasses import dataclass
from typing import Final, NamedTuple

import torch

from pentimento.contracts.ranges import above_zero, at_least
from pentimento.handwriting.trajvae import Strokes, TrajVAE, reconstruction_errors_mm, sizes_m

Log = Callable[[str, float, int], None]

_FOLDS: Final = 4
_HALVINGS: Final = 4
"""Fine-tuning may stop at the end, at half of its steps, at a quarter, ..., after so many halvings."""


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


class Adapted(NamedTuple):
    """A model for one writer."""

    model: TrajVAE
    steps: int
    """Of fine-tuning; 0: the pretrained weights are kept."""
    gain_mm: tuple[float, float]
    """Mean fall of the error on strokes of the writer that were held out, by cross-validation, and its standard error:
    at these steps, or at all steps where the pretrained weights are kept."""


def adapt(model: TrajVAE, strokes: Strokes, known: Strokes, config: TrajVAEConfig, log: Log) -> Adapted:
    """Fine-tune on a writer's strokes for as long as cross-validation finds it better than the pretrained model.

    The strokes are held out in turn, a quarter at a time. Of the end of fine-tuning and its halvings, the number of
    steps with the largest mean gain counts, among those whose gain is more than its standard error. Where none is, the
    pretrained weights are kept.

    Args:
        strokes: [B >= 2] of the writer.
        known: the pretraining strokes, for rehearsal.
    """
    count, course = len(strokes.xy_m), config.fine_tuning
    checked = sorted({max(course.steps >> halving, 1) for halving in range(_HALVINGS + 1)})
    gains = torch.zeros(len(checked), count)
    for fold in range(min(_FOLDS, count)):
        apart = torch.arange(count) % min(_FOLDS, count) == fold
        held_out, rest = strokes.pick(apart), strokes.pick(~apart)
        before = reconstruction_errors_mm(model, held_out)
        for at, tuned in enumerate(_tuned(model, rest, known, config, checked)):
            gains[at, apart] = before - reconstruction_errors_mm(tuned, held_out)
    mean, error = gains.mean(1), gains.std(1) / count**0.5
    sure = mean > error
    best = int(torch.where(sure, mean, -torch.inf).argmax()) if sure.any() else len(checked) - 1
    gain = float(mean[best]), float(error[best])
    if not sure.any():
        return Adapted(model, 0, gain)
    return Adapted(fine_tune(model, strokes, known, config, log, checked[best]), checked[best], gain)


def _tuned(
    model: TrajVAE, strokes: Strokes, known: Strokes, config: TrajVAEConfig, steps: list[int]
) -> Iterator[TrajVAE]:
    """Yield one copy of the model after each of these numbers of fine-tuning steps, which rise."""
    own = deepcopy(model)
    course = _course(own, (strokes, known), config, course=config.fine_tuning, seed=config.seed + 1, log=_unheard)
    for step in course:
        if step + 1 in steps:
            yield own
        if step + 1 == steps[-1]:
            return


def _unheard(*_: object) -> None: ...


def fine_tune(
    model: TrajVAE, strokes: Strokes, known: Strokes, config: TrajVAEConfig, log: Log, steps: int | None = None
) -> TrajVAE:
    """A copy of the model, fine-tuned on these strokes with rehearsal of the pretraining strokes ``known``.

    Without rehearsal, a few strokes would make the model forget what all writers share (Robins 1995, Catastrophic
    forgetting, rehearsal and pseudorehearsal).

    Args:
        steps: after which training stops early; None: all of ``config.fine_tuning``.
    """
    own = deepcopy(model)
    course = _course(own, (strokes, known), config, course=config.fine_tuning, seed=config.seed + 1, log=log)
    for step in course:
        if step + 1 == steps:
            break
    return own


def _train(
    model: TrajVAE, sources: tuple[Strokes, ...], config: TrajVAEConfig, *, course: Course, seed: int, log: Log
) -> None:
    for _ in _course(model, sources, config, course=course, seed=seed, log=log):
        pass


def _course(
    model: TrajVAE, sources: tuple[Strokes, ...], config: TrajVAEConfig, *, course: Course, seed: int, log: Log
) -> Iterator[int]:
    """Minimise the sum of the sources' mean losses, with one batch of each per step; yields each step after it."""
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
        yield step


def _varied(strokes: Strokes, std: float, generator: torch.Generator) -> Strokes:
    """Each stroke under a random linear map near the identity, rotated so that it ends on the x axis again."""
    change = torch.eye(2) + std * torch.randn(len(strokes.xy_m), 2, 2, generator=generator)
    xy = strokes.xy_m @ change
    angle = torch.atan2(xy[:, -1, 1], xy[:, -1, 0])
    cos, sin = angle.cos(), angle.sin()
    turn = torch.stack([torch.stack([cos, -sin], -1), torch.stack([sin, cos], -1)], -2)
    return strokes._replace(xy_m=xy @ turn)


_LOGGED = 50
