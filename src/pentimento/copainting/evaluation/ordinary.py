"""What a goal planner makes of ordinary pictures that lack something, with no robot about: is the base fair at all?"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pentimento.copainting.evaluation.answers import Asking, ask
from pentimento.copainting.evaluation.intervals import Estimate, difference, mean_estimate, resamples
from pentimento.copainting.evaluation.measures import as_tensor, surviving_ink
from pentimento.copainting.goal.planner import load_goal_planner
from pentimento.copainting.scenes.edits import Pair
from pentimento.semantics.encoder import Encoder
from pentimento.semantics.scores import clip_score

_RESAMPLES = 2000


def ordinary_scores(folder: Path, edits: Sequence[Pair], asking: Asking, judge: Path, seed: int) -> dict[str, Estimate]:
    """How a judge scores a goal planner's completions of held-out ordinary edits; both are folders.

    Beside the completions stand the inputs, for that is what doing nothing scores, and the true pictures:
    `judge_score_over_copy_input` and `target_over_copy_input` compare each with its own input. `goal_keeps` is the
    share of the inputs' ink that stays.
    """
    planner = load_goal_planner(folder)
    encoder = Encoder.load(judge)
    captions = [edit.caption for edit in edits]
    inputs, targets = np.stack([edit.input for edit in edits]), np.stack([edit.target for edit in edits])
    made = ask(planner, inputs, captions, asking)
    scores = {
        name: clip_score(encoder, as_tensor(pictures), captions).double().numpy()
        for name, pictures in (("judge_score", made), ("copy_input", inputs), ("target", targets))
    }
    drawn = resamples(len(edits), _RESAMPLES, seed)
    found = {name: mean_estimate(values, drawn) for name, values in scores.items()}
    for name in ("judge_score", "target"):
        found[f"{name}_over_copy_input"] = difference(scores[name], scores["copy_input"], drawn)
    found["goal_keeps"] = mean_estimate(surviving_ink(inputs, made), drawn)
    return {name: estimate for name, estimate in found.items() if estimate is not None}
