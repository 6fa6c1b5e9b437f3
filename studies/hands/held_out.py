"""Sessions that the model has not seen: errors before and after fine-tuning on few strokes, and samples beside people.

For each session a model is pretrained on all others; its own strokes are split at random into few to learn from and the
rest to measure with.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from pentimento.handwriting.demonstrated import Demonstrated
from pentimento.handwriting.evaluation import mean_stroke_mm, nearest_mm, reconstruction_mm
from pentimento.handwriting.training import TrajVAEConfig, fine_tune, pretrain
from pentimento.handwriting.trajvae import Strokes, TrajVAE, decoder_of
from studies.hands.samplers import copies, gaussian
from studies.hands.sampling import difference_auc, in_standard_frame, sampled_strokes

FloatArray = NDArray[np.float64]

SAMPLERS = (
    "TrajVAE, fine-tuned", "TrajVAE, pretrained", "TrajVAE, fine-tuned, its means only",
    "Gaussian, principal components", "copies with noise", "strokes of the other sessions",
)  # fmt: skip
_HALVINGS = 5


@dataclass(frozen=True, eq=False)
class SessionResult:
    """One session that was held out."""

    session: str
    measured: int
    """Strokes, beside the few."""
    pretrained_mm: float
    fine_tuned_mm: float
    nearest_mm: float
    mean_stroke_mm: float
    rest_m: FloatArray  # [R, N, 2]
    samples_m: dict[str, FloatArray]
    """Of ``SAMPLERS``, as many as the rest."""


def pretrained_without(strokes: Demonstrated, minimum: int, config: TrajVAEConfig) -> dict[str, TrajVAE]:
    """For each session of at least ``minimum`` strokes, a model of all others."""
    names = dict.fromkeys(strokes.session)
    fits = [name for name in names if strokes.session.count(name) >= minimum]
    return {name: pretrain(own_and_others(strokes, name)[1], config, unheard) for name in fits}


def held_out_sessions(
    models: Mapping[str, TrajVAE], strokes: Demonstrated, few: int, config: TrajVAEConfig
) -> list[SessionResult]:
    """Each session that a model has not seen, by ``few`` of its strokes."""
    return [_session(model, strokes, name, few, config) for name, model in models.items()]


def own_and_others(strokes: Demonstrated, session: str) -> tuple[Strokes, Strokes]:
    """The strokes of one session, and those of all others."""
    own = np.array([name == session for name in strokes.session])
    return strokes.pick(own).strokes, strokes.pick(~own).strokes


def _session(model: TrajVAE, strokes: Demonstrated, name: str, few: int, config: TrajVAEConfig) -> SessionResult:
    own, others = own_and_others(strokes, name)
    rng = np.random.default_rng([config.seed, 41, *name.encode()])
    order = torch.from_numpy(rng.permutation(len(own.xy_m)))
    learned, rest = own.pick(order[:few]), own.pick(order[few:])
    adapted = fine_tune(model, learned, others, config, unheard)
    count, few_m = len(rest.xy_m), learned.xy_m.double().numpy()
    samples = {}
    for sampler, of in zip(SAMPLERS[:2], (adapted, model), strict=True):
        samples[sampler] = sampled_strokes(of, learned, count, rng)
    hand = decoder_of(adapted, learned, name)
    samples[SAMPLERS[2]] = in_standard_frame(hand.decode(hand.sample(count, rng))[0].astype(np.float64))
    samples[SAMPLERS[3]] = in_standard_frame(gaussian(few_m, count, rng))
    samples[SAMPLERS[4]] = in_standard_frame(copies(few_m, count, rng))
    samples[SAMPLERS[5]] = others.xy_m.double().numpy()[rng.integers(len(others.xy_m), size=count)]
    return SessionResult(
        name, count, reconstruction_mm(model, rest), reconstruction_mm(adapted, rest), nearest_mm(learned, rest),
        mean_stroke_mm(learned, rest), rest.xy_m.double().numpy(), samples,
    )  # fmt: skip


def told_apart(results: Sequence[SessionResult], seed: int) -> dict[str, float]:
    """For each sampler: AUC of trees that tell its samples from people's strokes; and of people's strokes among
    themselves, halved by chance. Each session has trees of its own, as what one session's samples are drawn from can be
    another's held-out strokes; the mean counts strokes.
    """
    names = (*SAMPLERS, "people, halved")
    of_sessions = np.array([_aucs(result, seed) for result in results])
    mean = np.average(of_sessions, axis=0, weights=[result.measured for result in results])
    return dict(zip(names, mean.tolist(), strict=True))


def _aucs(result: SessionResult, seed: int) -> list[float]:
    people = list(result.rest_m)
    drawn = [difference_auc(people, list(result.samples_m[sampler]), seed) for sampler in SAMPLERS]
    return [*drawn, float(np.mean([_halved(people, seed, number) for number in range(_HALVINGS)]))]


def _halved(people: list[FloatArray], seed: int, number: int) -> float:
    order = np.random.default_rng([seed, 42, number]).permutation(len(people))
    one, other = ([people[i] for i in half] for half in np.array_split(order, 2))
    return difference_auc(one, other, seed)


def unheard(_name: str, _value: float, _step: int) -> None:
    """Curves are not kept."""
