"""Scores of the compared methods: a row for each method, a value for each case in a column (Table 6.1)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray
from scipy.stats import pearsonr

from pentimento.contracts.images import decode_png
from pentimento.contracts.statistics import Estimate, difference, gap_closed, item_resamples, mean_estimate, ratio
from pentimento.control.layout import Window
from pentimento.copainting.evaluation.cases import Case
from pentimento.copainting.evaluation.methods import (
    BASE,
    COPY,
    FINE_TUNED,
    NO_CHANGE,
    ORACLE,
    Outcomes,
    complete_canvases,
)
from pentimento.copainting.goal.planner import SeededSampling, load_goal_planner
from pentimento.copainting.scenes.edits import Pair
from pentimento.copainting.scenes.ink import ink_recall
from pentimento.semantics.encoder import Encoder, as_images
from pentimento.semantics.scores import clip_score, embed_all, object_scores, recognised

FloatArray = NDArray[np.float64]
Columns = dict[str, FloatArray]
Picture = NDArray[np.uint8]
Pictures = NDArray[np.uint8]

_RIM_PX: Final = 1  # around what changed: the antialiased edge of a line
_MARGIN: Final = 0.06  # around what was added, in its sides
_CHANGED_LEVELS: Final = 64  # of 255, in any channel: a pixel that differs by less counts as unchanged


def delta_pix(goals: Pictures, plans: Pictures) -> FloatArray:
    """Mean squared difference [B] of goals and predicted drawings, uint8 [B, H, W, 3]; sRGB in [0, 1].

    Equation (6.1) of the thesis, divided by the number of values, so that it does not depend on the size of the
    picture.
    """
    difference = (goals.astype(np.float64) - plans) / 255
    return np.square(difference).mean(axis=(1, 2, 3))


def delta_sem(encoder: Encoder, goals: Pictures, plans: Pictures) -> FloatArray:
    """Semantic Sim2Real Gap [B]: 1 - cos of the embeddings of goals and predicted drawings, uint8 [B, H, W, 3].

    The thesis prints (6.2) without `1 -`, but calls it a distance and minimises it.
    """
    products = embed_all(encoder, as_images(goals)) * embed_all(encoder, as_images(plans))
    return np.asarray(1 - products.sum(-1).double().numpy())


def surviving_ink(canvases: Pictures, pictures: Pictures) -> FloatArray:
    """Fraction [B] of each canvas's ink that a picture shows within 1 px; NaN if a canvas has none."""
    return np.array([ink_recall(before, after) for before, after in zip(canvases, pictures, strict=True)])


def changed_share(canvases: Pictures, pictures: Pictures) -> FloatArray:
    """Fraction [B] of the pixels that changed, see `_CHANGED_LEVELS`."""
    moved = np.abs(canvases.astype(np.int16) - pictures).max(-1) >= _CHANGED_LEVELS
    return np.asarray(moved.mean(axis=(1, 2)), dtype=np.float64)


def added(canvas: Picture, drawing: Picture) -> Picture:
    """What a drawing [H, W, 3] shows more than its canvas, on white: the smallest square around it with a margin,
    resized to the drawing's size. All white if nothing was added.
    """
    new = _new(canvas, drawing)
    seen = cv2.dilate(new.astype(np.uint8), np.ones((2 * _RIM_PX + 1,) * 2, np.uint8))[..., None] > 0
    return _square_around(new, np.where(seen, drawing, np.uint8(255)))


def seen_in(window: Window, canvas: Picture, drawing: Picture) -> Picture:
    """What a drawing [H, W, 3] shows more than its canvas within a window, as `added` shows it."""
    inside, there = canvas.copy(), window.pixels(canvas.shape[0])
    inside[there] = drawing[there]
    return added(canvas, inside)


def seen_there(canvas: Picture, drawing: Picture, later: Picture) -> Picture:
    """What a later picture [H, W, 3] shows where a drawing was added to a canvas: the same square as of `added`."""
    return _square_around(_new(canvas, drawing), later)


def _new(canvas: Picture, drawing: Picture) -> NDArray[np.bool_]:
    return np.asarray(np.abs(canvas.astype(np.int16) - drawing).max(-1) >= _CHANGED_LEVELS)


def _square_around(new: NDArray[np.bool_], drawing: Picture) -> Picture:
    if not new.any():
        return np.full_like(drawing, 255)
    rows, columns = np.flatnonzero(new.any(1)), np.flatnonzero(new.any(0))
    side = int(max(np.ptp(rows), np.ptp(columns))) + 1
    side += 2 * round(_MARGIN * side)
    top, left = (int(ends[0] + ends[-1] + 1 - side) // 2 for ends in (rows, columns))
    padded = np.pad(drawing, ((side, side), (side, side), (0, 0)), constant_values=255)
    square = padded[top + side : top + 2 * side, left + side : left + 2 * side]
    method = cv2.INTER_AREA if side > drawing.shape[0] else cv2.INTER_CUBIC
    return np.asarray(cv2.resize(square, drawing.shape[1::-1], interpolation=method), dtype=np.uint8)


@dataclass(frozen=True)
class Judges:
    """The encoders that score."""

    main: Encoder
    """It may have guided plans."""
    judge: Encoder
    """It never guided a plan."""
    kinds: tuple[str, ...]
    """Kinds of objects that the judge ranks; empty if the scenes name none."""


def score(outcomes: Outcomes, cases: Sequence[Case], judges: Judges) -> dict[str, Columns]:
    """Columns [B] by name for each method; NaN where a value does not exist.

    `clip_score` and `judge_score` are cosines of the predicted drawing and the prompt. `objects` is the fraction of the
    requested kinds that the judge recognises, see `objects_found`. `delta_pix` and `delta_sem` compare goal and
    drawing. `goal_keeps` and `drawing_keeps` are the fractions of the canvas's ink that the goal and the drawing show.
    `changed` is the fraction of pixels that the drawing changed.
    """
    captions = [case.caption for case in cases]
    table = {}
    for method, drawings in outcomes.drawings.items():
        images = as_images(drawings)
        missing = np.full(len(drawings), np.nan)
        goals = outcomes.goals.get(method)
        table[method] = {
            "clip_score": clip_score(judges.main, images, captions).double().numpy(),
            "judge_score": clip_score(judges.judge, images, captions).double().numpy(),
            "objects": objects_found(judges, outcomes.canvases, drawings, cases) if judges.kinds else missing,
            "delta_pix": missing if goals is None else delta_pix(goals, drawings),
            "delta_sem": missing if goals is None else delta_sem(judges.main, goals, drawings),
            "goal_keeps": missing if goals is None else surviving_ink(outcomes.canvases, goals),
            "drawing_keeps": surviving_ink(outcomes.canvases, drawings),
            "changed": changed_share(outcomes.canvases, drawings),
            "strokes": np.array(outcomes.strokes[method], dtype=np.float64),
        }
    return table


def objects_found(judges: Judges, canvases: Pictures, drawings: Pictures, cases: Sequence[Case]) -> FloatArray:
    """Fraction [B] of the requested things that the judge recognises; NaN if a prompt asks for no known kind.

    The judge sees what was added to the canvas. On the whole sheet it would often rank the other thing first, however
    well the requested one is drawn. Where a case has windows, it sees each thing in its own and must rank that kind
    first; otherwise it sees all that was added, and the k kinds asked for must be among its k best.
    """
    views: list[Picture] = []
    asked: list[tuple[str, ...]] = []
    owners: list[int] = []
    for number, (canvas, drawing, case) in enumerate(zip(canvases, drawings, cases, strict=True)):
        if case.windows:
            seen = [seen_in(window, canvas, drawing) for window in case.windows]
            asked.extend((kind,) for kind in case.objects)
        else:
            seen = [added(canvas, drawing)]
            asked.append(case.objects)
        views += seen
        owners += [number] * len(seen)
    hits = recognised(object_scores(judges.judge, as_images(views), judges.kinds), judges.kinds, asked)
    of_case: list[list[bool]] = [[] for _ in cases]
    for owner, of_view in zip(owners, hits, strict=True):
        of_case[owner] += of_view
    return np.array([np.mean(found) if found else np.nan for found in of_case])


def summary(table: Mapping[str, Columns], seed: int) -> dict[str, dict[str, Any]]:
    """Mean and 95 % bootstrap interval over cases of each column of each method, where the column has values."""
    drawn = item_resamples(_cases(table), seed)
    rows = {}
    for method, columns in table.items():
        estimates = {name: mean_estimate(values, drawn) for name, values in columns.items()}
        rows[method] = {name: found for name, found in estimates.items() if found is not None}
    return rows


def comparisons(table: Mapping[str, Columns], seed: int) -> dict[str, Any]:
    """Gains by fine-tuning, paired by case: fractions of the gap closed, ratios and differences."""
    drawn = item_resamples(_cases(table), seed)
    base, fine, oracle = table[BASE], table[FINE_TUNED], table[ORACLE]
    estimates: dict[str, Any] = {}
    for gap in ("delta_pix", "delta_sem"):
        estimates[f"{gap}_closed"] = gap_closed(base[gap], fine[gap], oracle[gap], drawn)
        estimates[f"{gap}_ratio"] = ratio(base[gap], fine[gap], drawn)
    for column in ("clip_score", "judge_score", "objects"):
        for other in (NO_CHANGE, COPY, BASE):
            estimates[f"{column}_over_{other}"] = difference(fine[column], table[other][column], drawn)
        estimates[f"{column}_base_over_{NO_CHANGE}"] = difference(base[column], table[NO_CHANGE][column], drawn)
    return {name: found for name, found in estimates.items() if found is not None}


def correlations(deltas: Mapping[str, FloatArray], scores: FloatArray) -> dict[str, dict[str, float]]:
    """Pearson's r of each gap with a score over paintings, and its two-sided p (thesis 6.8.2).

    A gap is left out if it or the scores are constant, or for fewer than three paintings.
    """
    results = {}
    for name, values in deltas.items():
        if len(values) >= 3 and np.ptp(values) > 0 and np.ptp(scores) > 0:
            found = pearsonr(values, scores)
            results[name] = {"r": float(found.statistic), "p": float(found.pvalue), "paintings": len(values)}
    return results


def _cases(table: Mapping[str, Columns]) -> int:
    return len(next(iter(next(iter(table.values())).values())))


def painted_gap(pairs: pa.Table, scenes: pa.Table, main: Encoder) -> dict[str, dict[str, float]]:
    """Correlation of the gap between a scene and its full painting with the painting's score; empty if no id matches.

    Args:
        pairs: a checked `copaintings` table.
        scenes: the checked `scenes` table that it was synthesised from.
    """
    pictures = {row["scene_id"]: row["image"]["bytes"] for row in scenes.select(["scene_id", "image"]).to_pylist()}
    whole = pairs.filter(pc.is_null(pairs["region"]))  # the captions of the others name one thing of the scene
    rows = {row["scene_id"]: row for row in whole.select(["scene_id", "full", "caption"]).to_pylist()}
    known = [row for name, row in sorted(rows.items()) if name in pictures]
    if not known:
        return {}
    painted = np.stack([decode_png(row["full"]["bytes"]) for row in known])
    targets = np.stack([decode_png(pictures[row["scene_id"]]) for row in known])
    scores = clip_score(main, as_images(painted), [row["caption"] for row in known]).double().numpy()
    return correlations(
        {"delta_pix": delta_pix(targets, painted), "delta_sem": delta_sem(main, targets, painted)}, scores
    )  # fmt: skip


def edit_scores(
    folder: Path, edits: Sequence[Pair], sampling: SeededSampling, *, judge: Path, seed: int
) -> dict[str, Estimate]:
    """Judge scores of a goal planner's completions of held-out edits; `folder` and `judge` are folders of models.

    The same scores are given for the inputs (`copy_input`) and the true targets (`target`).
    `judge_score_over_copy_input` and `target_over_copy_input` are paired differences to the inputs. `goal_keeps` is the
    fraction of the inputs' ink that the completions keep.
    """
    planner = load_goal_planner(folder)
    encoder = Encoder.load(judge)
    captions = [edit.caption for edit in edits]
    inputs, targets = np.stack([edit.input for edit in edits]), np.stack([edit.target for edit in edits])
    completions = complete_canvases(planner, inputs, captions, sampling)
    scores = {
        name: clip_score(encoder, as_images(pictures), captions).double().numpy()
        for name, pictures in (("judge_score", completions), ("copy_input", inputs), ("target", targets))
    }
    drawn = item_resamples(len(edits), seed)
    found = {name: mean_estimate(values, drawn) for name, values in scores.items()}
    for name in ("judge_score", "target"):
        found[f"{name}_over_copy_input"] = difference(scores[name], scores["copy_input"], drawn)
    found["goal_keeps"] = mean_estimate(surviving_ink(inputs, completions), drawn)
    return {name: estimate for name, estimate in found.items() if estimate is not None}
