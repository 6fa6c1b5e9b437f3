"""Discrimination of a model's samples from a session's strokes, by the number of strokes the model is fitted to."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray

from pentimento.handwriting.demonstrated import Demonstrated
from pentimento.handwriting.training import TrajVAEConfig, fine_tune
from pentimento.handwriting.trajvae import Strokes, TrajVAE
from studies.hands.held_out import own_and_others, unheard
from studies.hands.sampling import difference_auc, sampled_strokes

FloatArray = NDArray[np.float64]

NUMBERS = (20, 40, 60, 80, 100, 140)
_KNOWN = 0.75
"""Of a session's strokes, at most."""
_SPLITS = 3
_DRAWS = 4


@dataclass(frozen=True)
class Discrimination:
    """One session, of which so many strokes are known: means over random splits."""

    session: str
    known: int
    measured: int
    auc: float
    """Of samples, as many as the strokes measured, against these."""
    auc_of_few: float
    """Of 20 samples against 20 strokes (or all, if there are fewer)."""


def auc_by_known_strokes(
    models: Mapping[str, TrajVAE], strokes: Demonstrated, config: TrajVAEConfig
) -> list[Discrimination]:
    """Of each session that a model has not seen, if at least two of ``NUMBERS`` can be known."""
    found = []
    for session, model in models.items():
        own, others = own_and_others(strokes, session)
        count = len(own.xy_m)
        numbers = [number for number in NUMBERS if number <= _KNOWN * count]
        for known in numbers if len(numbers) > 1 else []:
            aucs = [
                _aucs(model, session, own, others=others, known=known, split=split, config=config)
                for split in range(_SPLITS)
            ]
            found.append(Discrimination(session, known, count - known, *np.mean(aucs, axis=0).tolist()))
    return found


def _aucs(
    model: TrajVAE, session: str, own: Strokes, *, others: Strokes, known: int, split: int, config: TrajVAEConfig
) -> tuple[float, float]:
    """Of one split: all samples, and few."""
    rng = np.random.default_rng([config.seed, 43, split, *session.encode()])
    order = torch.from_numpy(rng.permutation(len(own.xy_m)))
    learned, rest = own.pick(order[:known]), own.pick(order[known:])
    adapted = fine_tune(model, learned, others, replace(config, seed=config.seed + split), unheard)
    people = rest.xy_m.double().numpy()
    samples = sampled_strokes(adapted, learned, len(people), rng)
    return difference_auc(list(people), list(samples), split), _of_few(people, samples, rng)


def _of_few(people: FloatArray, samples: FloatArray, rng: np.random.Generator) -> float:
    """Mean over draws of few."""
    few = min(NUMBERS[0], len(people))
    drawn = [[list(rng.permutation(each)[:few]) for each in (people, samples)] for _ in range(_DRAWS)]
    return float(np.mean([difference_auc(one, other, number) for number, (one, other) in enumerate(drawn)]))
