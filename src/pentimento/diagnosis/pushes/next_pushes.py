"""Screening of the residual after a diagnosis, and the pushes that best separate its open questions (D_s-optimal
design).

The proposed pushes come in pairs: one into freshly smoothed material, and one that meets what the first left. Pairs are
chosen greedily from random ones to maximise the sum of log det S over the causes in question; then each is exchanged
while another one is better (Fedorov 1972).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pentimento.contracts.schema import vector
from pentimento.diagnosis.experiment_design import (
    Columns,
    Question,
    greedy_exchange,
    most_informed_question,
    pair_aliasing,
    questions,
)
from pentimento.diagnosis.figures import Screening, screening_of
from pentimento.diagnosis.pushes.jacobian import KeptColumns, linearise, linearise_rows, residual
from pentimento.diagnosis.pushes.measured import MeasuredPushes
from pentimento.diagnosis.pushes.modes import MODES, mode_scores, varying_covariates
from pentimento.diagnosis.pushes.problem import PushResult, observable_causes, with_learned_residual
from pentimento.planning.pushes.analytic.mechanisms import VOCABULARY
from pentimento.planning.pushes.analytic.model import AnalyticPush
from pentimento.planning.pushes.analytic.scene import PushScene, local_places, push_scene, surface_at_start, swept_m

Array = NDArray[Any]
PushScreening = Screening[MeasuredPushes, AnalyticPush]
PAIRS = 8
"""Pairs of a proposal."""
_SEQUENCES = 10
"""Random candidates for each turn."""
_BESIDE = 0.7
"""Standard deviation of the second push's offset from the path of the first, in half-widths of the footprint."""
_TRIES = 60
"""Draws of an action before one that leaves the recorded area is accepted."""
_SPEEDS = ("speed_m_s", "dwell_s", "retract_speed_m_s")
"""Settings of a push that are drawn from the recorded ones."""


class PushProposal(NamedTuple):
    """Pushes in their order of execution; the material is smoothed before the first of each pair."""

    action: Array
    """float64[K, 5]"""
    settings: dict[str, Array]
    """[K] each: speed of travel, dwell, speed of retracting, as far as they were recorded."""
    question: tuple[Question, ...]
    """For each push, the question to which it contributes most."""
    aliasing: dict[tuple[str, str], tuple[float, float]]
    """Of each pair of causes: so far, and predicted with these pushes."""


def proposal_for(result: PushResult, seen: PushScreening, seed: int) -> PushProposal:
    """The next pushes after a diagnosis; none where no question is open."""
    asked = questions(result, seen.aliasing)
    if not asked:
        return PushProposal(np.zeros((0, 5)), {}, (), {})
    wanted = {cause for question in asked for cause in question}
    wanted |= {mechanism.cause for mechanism in result.extended.model.mechanisms}
    kept = tuple(mechanism for mechanism in seen.full.mechanisms if mechanism.cause in wanted)
    return propose(replace(seen.full, mechanisms=kept), seen.measured, asked, seed=seed)


def propose(
    model: AnalyticPush, measured: MeasuredPushes, asked: Sequence[Question], *, seed: int, pairs: int = PAIRS
) -> PushProposal:
    """The ``pairs`` of pushes that contribute most to the questions, given the pushes executed so far.

    Args:
        model: with a mechanism for every cause that the questions name.
        measured: the pushes so far; actions and speeds stay within their ranges.
    """
    columns = columns_of(model)
    so_far = linearise_rows(model, measured).curvature.sum(0)
    rng = np.random.default_rng([seed, 14])
    drawn = _SEQUENCES * pairs
    action, settings = _drawn_pairs(measured, drawn, rng)
    candidates = as_measured(action, settings, model, measured)
    candidate_curvature = linearise_rows(model, candidates).curvature.reshape(_SEQUENCES, pairs, 2, *so_far.shape)
    best = greedy_exchange(so_far, candidate_curvature.sum(2), columns, asked)
    of_turn = np.array([sequence * pairs + turn for turn, sequence in enumerate(best)])
    rows = (2 * of_turn[:, None] + np.arange(2)).ravel()
    chosen = candidate_curvature.reshape(-1, *so_far.shape)[rows]
    total = so_far + chosen.sum(0)
    about = tuple(most_informed_question(total, one, columns, asked) for one in chosen)
    return PushProposal(
        action[rows], {name: values[rows] for name, values in settings.items()}, about,
        _aliasing_before_and_after(so_far, total, columns, asked),
    )  # fmt: skip


def as_table(proposal: PushProposal) -> pa.Table:
    """Table for a robot, one row for each push in order of execution.

    ``order``; ``action`` [5] in the canvas frame; ``smooth``: smooth the material first; ``speed_m_s``, ``dwell_s``,
    ``retract_speed_m_s`` (NaN: default); ``separates``: the causes to which it contributes most, joined by " | ".
    """
    count = len(proposal.action)
    columns: dict[str, pa.Array] = {
        "order": pa.array(np.arange(count), pa.int32()),
        "action": pa.array(proposal.action.tolist(), vector(5)),
        "smooth": pa.array(np.arange(count) % 2 == 0, pa.bool_()),
    }
    for name in _SPEEDS:
        columns[name] = pa.array(proposal.settings.get(name, np.full(count, np.nan)), pa.float32())
    columns["separates"] = pa.array([" | ".join(question) for question in proposal.question], pa.string())
    return pa.table(columns)


def as_measured(
    action: Array, settings: dict[str, Array], model: AnalyticPush, measured: MeasuredPushes
) -> MeasuredPushes:
    """Pairs of planned pushes [2 K, 5] as rows: the second of a pair meets the surface that the model predicts after
    the first."""
    like = np.full(len(action), len(measured) - 1)
    shape, k = measured.after.shape[1:], 1 / measured.scene.pixel_m
    middle = action[:, :2] + _ahead(action) / 2
    half = np.array([shape[1], shape[0]]) / k / 2
    windows = np.concatenate([middle - half, middle + half], axis=1)
    known = {name: values[like] for name, values in measured.scene.covariates.items()} | settings
    flat = np.zeros((len(action), *shape), np.float32)
    half_width = measured.scene.half_width_m

    def scene(pushes: Array, before: Array, worked: Array, rows: Array) -> PushScene:
        along, across = local_places(windows[rows], shape, action=pushes, pixels_per_m=k)
        columns = {name: values[rows] for name, values in known.items()}
        level = before - surface_at_start(before, along, across)[:, None, None].astype(np.float32)
        history = measured.scene.history_known
        return push_scene(
            level,
            along,
            across,
            worked=worked,
            action=pushes,
            history_known=history,
            covariates=columns,
            pixel_m=1 / k,
            half_width_m=half_width,
        )

    first, second = np.arange(0, len(action), 2), np.arange(1, len(action), 2)
    # The first push in the window of the second: it may start outside, where the surface is level.
    along, across = local_places(windows[second], shape, action=action[first], pixels_per_m=k)
    seen = push_scene(
        flat[first], along, across, worked=flat[first], action=action[first],
        history_known=measured.scene.history_known, covariates={name: v[first] for name, v in known.items()},
        pixel_m=1 / k, half_width_m=half_width,
    )  # fmt: skip
    left, worked = flat.copy(), flat.copy()
    left[second] = model.change(seen)
    worked[second] = swept_m(
        along, across, length_m=action[first, 3], depth_m=action[first, 4], half_width_m=half_width
    )
    everything = scene(action, left, worked, np.arange(len(action)))
    samples = measured.samples.pick(like)._replace(
        before=left, after=left, known=np.ones(left.shape, bool), action=action, window_m=windows,
        action_id=np.arange(len(action)),
    )  # fmt: skip
    return MeasuredPushes(
        samples, everything, everything.before, np.arange(len(action)), np.arange(len(action)), np.ones_like(left),
        np.zeros_like(left),
    )  # fmt: skip


def _drawn_pairs(measured: MeasuredPushes, count: int, rng: np.random.Generator) -> tuple[Array, dict[str, Array]]:
    """Actions [2 K, 5] within the recorded ranges, and settings [2 K]; every second push aims at the path of the one
    before."""
    executed = measured.scene.action
    low, high = executed.min(0), executed.max(0)
    low[2], high[2] = -np.pi, np.pi
    place = np.concatenate([executed[:, :2], executed[:, :2] + _ahead(executed)])
    inside = place.min(0), place.max(0)
    action = np.empty((2 * count, 5))
    for row in range(2 * count):
        for _ in range(_TRIES):
            one = rng.uniform(low, high)
            if row % 2:
                on_path = action[row - 1, :2] + rng.random() * _ahead(action[row - 1 : row])[0]
                beside = _BESIDE * measured.scene.half_width_m * rng.standard_normal(2)
                one[:2] = on_path + beside - _ahead(one[None])[0] / 2
            ends = np.stack([one[:2], one[:2] + _ahead(one[None])[0]])
            action[row] = one
            if (ends >= inside[0]).all() and (ends <= inside[1]).all():
                break
    settings = {}
    for name in _SPEEDS:
        recorded = measured.scene.covariates.get(name)
        if recorded is not None and np.isfinite(recorded).all():
            settings[name] = rng.choice(recorded, 2 * count)
    return action, settings


def _ahead(action: Array) -> Array:
    """Vector from start to end of travel, [B, 2]."""
    return action[:, 3:4] * np.stack([np.cos(action[:, 2]), np.sin(action[:, 2])], axis=1)


def _aliasing_before_and_after(
    so_far: Array, total: Array, columns: Columns, asked: Sequence[Question]
) -> dict[tuple[str, str], tuple[float, float]]:
    pairs = [(question[0], question[1]) for question in asked if len(question) == 2]
    return {pair: (pair_aliasing(so_far, columns, pair), pair_aliasing(total, columns, pair)) for pair in pairs}


def screen(result: PushResult) -> PushScreening:
    """Screen the residuals of base and extended model over all pushes."""
    measured = with_learned_residual(result)
    there = set(result.extended.causes)
    others, _ = observable_causes(measured, [kind for kind in VOCABULARY if kind.cause not in there])
    full = result.extended.model.plus(*others.values())
    kept = KeptColumns(measured)
    statistics = linearise(full, measured, kept)
    base, extended = (
        (mode_scores(model, measured, kept).amounts, np.where(measured.valid, residual(model, measured), np.nan))
        for model in (result.base.model, result.extended.model)
    )
    return screening_of(
        measured,
        measured.pick(result.splits.test),
        full,
        statistics,
        columns_of(full),
        modes=MODES,
        scores=(base[0], extended[0]),
        covariates=varying_covariates(measured),
        residuals=(base[1], extended[1]),
        action=measured.action,
    )


def columns_of(model: AnalyticPush) -> Columns:
    """Indices of the nuisance parameters, and of the quantities of each mechanism, in the Jacobian of ``model``."""
    causes = {mechanism.cause: model.columns_of(mechanism.cause) for mechanism in model.mechanisms}
    return Columns(np.arange(model.nuisances), causes)
