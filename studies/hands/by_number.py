"""How many strokes of a session a model must know until its samples are not told from the session's other strokes."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray

from pentimento.stroke_hands.demonstrated import Demonstrated
from pentimento.stroke_hands.sampling import sampled_strokes
from pentimento.stroke_hands.training import TrajVAEConfig, fine_tune, pretrain
from pentimento.stroke_hands.who_drew import difference_auc
from studies.hands.held_out import own_and_others, unheard

FloatArray = NDArray[np.float64]

NUMBERS = (20, 40, 60, 80, 100, 140)
_KNOWN = 0.75
"""Of a session's strokes, at most."""
_SPLITS = 3
_DRAWS = 4


@dataclass(frozen=True)
class Told:
    """One session, of which so many strokes are known: means over random splits."""

    session: str
    known: int
    measured: int
    auc: float
    """Of samples, as many as the strokes measured, against these."""
    auc_of_few: float
    """Of 20 samples against 20 strokes (or all, if there are fewer)."""


def told_by_number(strokes: Demonstrated, config: TrajVAEConfig) -> list[Told]:
    """Sessions of which at least two of ``NUMBERS`` can be known."""
    found = []
    for session in dict.fromkeys(strokes.session):
        own, others = own_and_others(strokes, session)
        numbers = [number for number in NUMBERS if number <= _KNOWN * len(own.xy_m)]
        if len(numbers) > 1:
            model = pretrain(others, config, unheard)
            for known in numbers:
                aucs = []
                for split in range(_SPLITS):
                    rng = np.random.default_rng([config.seed, 43, split, *session.encode()])
                    order = torch.from_numpy(rng.permutation(len(own.xy_m)))
                    learned, rest = own.pick(order[:known]), own.pick(order[known:])
                    again = replace(config, seed=config.seed + split)
                    adapted = fine_tune(model, learned, others, again, unheard)
                    people = rest.xy_m.double().numpy()
                    samples = sampled_strokes(adapted, learned, len(people), rng)
                    aucs.append((difference_auc(list(people), list(samples), split), _of_few(people, samples, rng)))
                found.append(Told(session, known, len(own.xy_m) - known, *np.mean(aucs, axis=0).tolist()))
    return found


def _of_few(people: FloatArray, samples: FloatArray, rng: np.random.Generator) -> float:
    """Mean over draws of few."""
    few = min(NUMBERS[0], len(people))
    drawn = [[list(rng.permutation(each)[:few]) for each in (people, samples)] for _ in range(_DRAWS)]
    return float(np.mean([difference_auc(one, other, number) for number, (one, other) in enumerate(drawn)]))
