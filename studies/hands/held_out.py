"""Sessions that the model has not seen: errors before and after fine-tuning on few strokes, and samples beside people.

Sessions are dealt into folds. For each fold one model is pretrained on all other sessions; each of the fold's sessions
is split at random into few strokes to learn from and the rest to measure with.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from pentimento.stroke_hands.demonstrated import Demonstrated
from pentimento.stroke_hands.hand_files import hand_of
from pentimento.stroke_hands.reconstruction import mean_stroke_mm, nearest_mm, reconstruction_mm
from pentimento.stroke_hands.sampling import in_standard_frame, sampled_strokes
from pentimento.stroke_hands.training import TrajVAEConfig, fine_tune, pretrain
from pentimento.stroke_hands.trajvae import TrajVAE
from pentimento.stroke_hands.who_drew import difference_auc
from studies.hands.samplers import copies, gaussian

FloatArray = NDArray[np.float64]

SAMPLERS = (
    "TrajVAE, fine-tuned", "TrajVAE, pretrained", "TrajVAE, fine-tuned, its means only",
    "Gaussian, principal components", "copies with noise",
)  # fmt: skip


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


def held_out_sessions(
    strokes: Demonstrated, few: int, least: int, folds: int, config: TrajVAEConfig
) -> list[SessionResult]:
    """Each session with at least ``few + least`` strokes, held out once."""
    names = list(dict.fromkeys(strokes.session))
    fits = [name for name in names if strokes.session.count(name) >= few + least]
    found = []
    for fold in range(folds):
        apart = fits[fold::folds]
        if not apart:
            continue
        others = strokes.pick(np.array([name not in apart for name in strokes.session]))
        model = pretrain(others.strokes, config, _unheard)
        found += [_session(model, strokes, name, few, config) for name in apart]
    return found


def _session(model: TrajVAE, strokes: Demonstrated, name: str, few: int, config: TrajVAEConfig) -> SessionResult:
    own = strokes.pick(np.array([session == name for session in strokes.session])).strokes
    rng = np.random.default_rng([config.seed, 41, *name.encode()])
    order = torch.from_numpy(rng.permutation(len(own.xy_m)))
    learned, rest = own.pick(order[:few]), own.pick(order[few:])
    adapted = fine_tune(model, learned, config, _unheard)
    count, few_m = len(rest.xy_m), learned.xy_m.double().numpy()
    samples = {}
    for sampler, of in zip(SAMPLERS[:2], (adapted, model), strict=True):
        samples[sampler] = sampled_strokes(of, learned, count, rng)
    hand = hand_of(adapted, learned, name)
    samples[SAMPLERS[2]] = in_standard_frame(hand.decode(hand.some(count, rng))[0].astype(np.float64))
    samples[SAMPLERS[3]] = in_standard_frame(gaussian(few_m, count, rng))
    samples[SAMPLERS[4]] = in_standard_frame(copies(few_m, count, rng))
    return SessionResult(
        name, count, reconstruction_mm(model, rest), reconstruction_mm(adapted, rest), nearest_mm(learned, rest),
        mean_stroke_mm(learned, rest), rest.xy_m.double().numpy(), samples,
    )  # fmt: skip


def told_apart(results: Sequence[SessionResult], seed: int) -> dict[str, float]:
    """For each sampler: AUC of trees that tell its samples from people's strokes, all sessions together; and of
    people's strokes among themselves, halved by chance.
    """
    people = np.concatenate([result.rest_m for result in results])
    found = {
        sampler: difference_auc(list(people), list(np.concatenate([r.samples_m[sampler] for r in results])), seed)
        for sampler in SAMPLERS
    }
    order = np.random.default_rng([seed, 42]).permutation(len(people))
    halves = np.array_split(order, 2)
    return found | {"people, halved": difference_auc(*(list(people[half]) for half in halves), seed)}


def _unheard(_name: str, _value: float, _step: int) -> None:
    """Curves are not kept."""
