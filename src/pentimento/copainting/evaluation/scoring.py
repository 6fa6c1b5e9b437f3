"""Numbers for what goal planners answered: a row for each method, a value for each case in a column (Table 6.1)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import pearsonr

from pentimento.copainting.evaluation.answers import BASE, COPY, FINE_TUNED, NO_CHANGE, ORACLE, Answers
from pentimento.copainting.evaluation.intervals import difference, gap_closed, mean_estimate, ratio, resamples
from pentimento.copainting.evaluation.measures import as_tensor, changed_share, delta_pix, delta_sem, surviving_ink
from pentimento.copainting.scenes.collage import Half, close_up
from pentimento.semantics.encoder import Encoder
from pentimento.semantics.scores import clip_score, object_scores, recognised

FloatArray = NDArray[np.float64]
Columns = dict[str, FloatArray]
Pictures = NDArray[np.uint8]

_RESAMPLES = 2000


@dataclass(frozen=True)
class Judges:
    """Who scores: the encoder that may have guided a plan, and one that never did."""

    main: Encoder
    judge: Encoder
    kinds: tuple[str, ...]
    """Kinds of objects that the judge is asked to tell apart; empty where scenes name none."""


def score(
    answers: Answers, captions: Sequence[str], asked: Sequence[Sequence[str]], rooms: Sequence[Half | None],
    judges: Judges,
) -> dict[str, Columns]:  # fmt: skip
    """Columns [B] by name for each method; NaN where a number does not exist.

    `clip_score` and `judge_score` are cosines of the foretold drawing with the prompt. `objects` is the share of the
    kinds asked for that the judge finds in the drawing, in the half of the sheet that was left free for them (`rooms`;
    None: on all of it).
    `delta_pix` and `delta_sem` are between goal and drawing. `goal_keeps` is the share of the canvas's ink that the
    goal shows, `drawing_keeps` that the drawing shows. `changed` is the share of pixels that the drawing changed.
    """
    table = {}
    for method, drawings in answers.drawings.items():
        shown = as_tensor(drawings)
        nothing = np.full(len(drawings), np.nan)
        goals = answers.goals.get(method)
        table[method] = {
            "clip_score": clip_score(judges.main, shown, captions).double().numpy(),
            "judge_score": clip_score(judges.judge, shown, captions).double().numpy(),
            "objects": found(judges, drawings, asked, rooms) if judges.kinds else nothing,
            "delta_pix": nothing if goals is None else delta_pix(goals, drawings),
            "delta_sem": nothing if goals is None else delta_sem(judges.main, goals, drawings),
            "goal_keeps": nothing if goals is None else surviving_ink(answers.canvases, goals),
            "drawing_keeps": surviving_ink(answers.canvases, drawings),
            "changed": changed_share(answers.canvases, drawings),
            "strokes": np.array(answers.strokes[method], dtype=np.float64),
        }
    return table


def found(
    judges: Judges, drawings: Pictures, asked: Sequence[Sequence[str]], rooms: Sequence[Half | None]
) -> FloatArray:
    """Share [B] of the kinds asked for that the judge finds among its best as many; NaN where none was asked for.

    Where a half of the sheet was left free, the judge looks at that half alone. It names what a picture shows most
    plainly: of the whole sheet that would often be what stood there before, however well the other thing is drawn.
    """
    seen = [drawing if room is None else close_up(drawing, room) for drawing, room in zip(drawings, rooms, strict=True)]
    hits = recognised(object_scores(judges.judge, as_tensor(np.stack(seen)), judges.kinds), judges.kinds, asked)
    return np.array([np.mean(of) if of else np.nan for of in hits])


def summary(table: Mapping[str, Columns], seed: int) -> dict[str, dict[str, Any]]:
    """Mean and 95 % bootstrap interval over cases of each column of each method, where the column exists."""
    drawn = resamples(_cases(table), _RESAMPLES, seed)
    rows = {}
    for method, columns in table.items():
        estimates = {name: mean_estimate(values, drawn) for name, values in columns.items()}
        rows[method] = {name: found for name, found in estimates.items() if found is not None}
    return rows


def comparisons(table: Mapping[str, Columns], seed: int) -> dict[str, Any]:
    """What fine-tuning gains, each case compared with itself: shares of the gap closed, plain ratios, differences."""
    drawn = resamples(_cases(table), _RESAMPLES, seed)
    base, fine, oracle = table[BASE], table[FINE_TUNED], table[ORACLE]
    made: dict[str, Any] = {}
    for gap in ("delta_pix", "delta_sem"):
        made[f"{gap}_closed"] = gap_closed(base[gap], fine[gap], oracle[gap], drawn)
        made[f"{gap}_ratio"] = ratio(base[gap], fine[gap], drawn)
    for column in ("clip_score", "judge_score", "objects"):
        for other in (NO_CHANGE, COPY, BASE):
            made[f"{column}_over_{other}"] = difference(fine[column], table[other][column], drawn)
        made[f"{column}_base_over_{NO_CHANGE}"] = difference(base[column], table[NO_CHANGE][column], drawn)
    return {name: found for name, found in made.items() if found is not None}


def correlations(deltas: Mapping[str, FloatArray], scores: FloatArray) -> dict[str, dict[str, float]]:
    """Pearson's r of each gap with a score over paintings, and its two-sided p (thesis 6.8.2).

    Nothing for a gap or scores that do not vary, or fewer than three paintings.
    """
    results = {}
    for name, values in deltas.items():
        if len(values) >= 3 and np.ptp(values) > 0 and np.ptp(scores) > 0:
            answer = pearsonr(values, scores)
            results[name] = {"r": float(answer.statistic), "p": float(answer.pvalue), "paintings": len(values)}
    return results


def _cases(table: Mapping[str, Columns]) -> int:
    return len(next(iter(next(iter(table.values())).values())))
