"""The next strokes after a diagnosis, by a D_s-optimal design, and what the report shows beside the verdict.

Random feasible sequences provide a candidate for each turn, with the ink, wear and clock of that turn.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pentimento.contracts.schema import PATH, vector
from pentimento.diagnosis.experiment_design import (
    Question,
    design_value,
    greedy_exchange,
    most_informed_question,
    pair_aliasing,
    questions,
)
from pentimento.diagnosis.figures import Screening, screening_of
from pentimento.diagnosis.strokes.aliasing import columns_of, with_all
from pentimento.diagnosis.strokes.candidate_actions import (
    Action,
    Ranges,
    as_measured,
    draw_sequence,
    executable,
    ranges_of,
    window_of,
)
from pentimento.diagnosis.strokes.jacobian import linearise, linearise_rows
from pentimento.diagnosis.strokes.measured import Measured, covariates_shown
from pentimento.diagnosis.strokes.model import Model
from pentimento.diagnosis.strokes.modes import MODES, mode_scores
from pentimento.diagnosis.strokes.predict import residual
from pentimento.diagnosis.strokes.problem import StrokeResult, with_learned_residual
from pentimento.dynamics.strokes.mechanisms import VOCABULARY

Array = NDArray[Any]

ACTIONS = 16
_SEQUENCES = 24
"""Random sequences; each turn takes its action from one of them."""
_FOR_WAITING = 0.1
"""Gain of log det S for which waits between strokes are kept."""


class Proposal(NamedTuple):
    """Actions in the order of execution."""

    actions: tuple[Action, ...]
    question: tuple[Question, ...]
    """For each action, the question that it informs most."""
    aliasing: dict[tuple[str, str], tuple[float, float]]
    """Aliasing of each pair now, and predicted with these actions."""


def proposal_for(result: StrokeResult, seen: Screening[Measured, Model], seed: int) -> Proposal:
    """The next strokes after a diagnosis; none without a question, or where no z was commanded that presses."""
    asked = questions(result, seen.aliasing)
    if not asked or seen.measured.press_from_force:
        return Proposal((), (), {})
    wanted = {cause for question in asked for cause in question}
    wanted |= {mechanism.cause for mechanism in result.extended.model.mechanisms}
    kept = tuple(mechanism for mechanism in seen.full.mechanisms if mechanism.cause in wanted)
    return propose(replace(seen.full, mechanisms=kept), seen.measured, asked, seed)


def propose(model: Model, measured: Measured, asked: Sequence[Question], seed: int, count: int = ACTIONS) -> Proposal:
    """The ``count`` actions that inform the questions most, given the strokes so far.

    Args:
        model: with a mechanism for every cause in the questions.
        measured: the strokes so far; actions stay within their ranges.
    """
    columns, ranges = columns_of(model), ranges_of(measured)
    so_far = linearise_rows(model, measured).curvature.sum(0)
    rng = np.random.default_rng([seed, 14])
    sequences = [draw_sequence(rng, ranges, measured, count) for _ in range(_SEQUENCES)]
    _, gains = curvatures(sequences, model, measured, ranges)
    chosen = greedy_exchange(so_far, gains, columns, asked)
    # Ink and clock of a turn depend on the strokes before it: evaluate the composed sequence as a whole.
    best = [sequences[s][turn] for turn, s in enumerate(chosen)]
    (actions,), (gathered,) = curvatures([best], model, measured, ranges)
    without_waiting = [action._replace(wait_s=0.0) for action in actions]
    (hasty,), (quickly,) = curvatures([without_waiting], model, measured, ranges)
    if (
        design_value(so_far + quickly.sum(0), columns, asked)
        > design_value(so_far + gathered.sum(0), columns, asked) - _FOR_WAITING
    ):
        actions, gathered = hasty, quickly
    total = so_far + gathered.sum(0)
    about = tuple(most_informed_question(total, one, columns, asked) for one in gathered)
    pairs = [(q[0], q[1]) for q in asked if len(q) == 2]
    return Proposal(
        tuple(actions), about, {p: (pair_aliasing(so_far, columns, p), pair_aliasing(total, columns, p)) for p in pairs}
    )


def curvatures(
    sequences: Sequence[Sequence[Action]], model: Model, measured: Measured, ranges: Ranges
) -> tuple[list[list[Action]], Array]:
    """Sequences of k actions as they can be executed, each after the recorded strokes, and their curvatures [S, k, P,
    P].
    """
    turns = [executable(actions, measured, ranges) for actions in sequences]
    actions = [action for feasible, _ in turns for action in feasible]
    columns = [row for _, rows in turns for row in rows]
    curvature = linearise_rows(model, as_measured(actions, columns, model, measured, ranges)).curvature
    return [feasible for feasible, _ in turns], curvature.reshape(len(sequences), -1, *curvature.shape[1:])


def as_table(proposal: Proposal, measured: Measured) -> pa.Table:
    """The proposal as a table for a robot: one row for each action, in order, on a new sheet.

    ``order``; ``path`` [N, 5] in the recording's frame (times NaN where it has none); ``window_m`` to photograph before
    and after; ``color_srgb``; ``reload``: dip first; ``wait_s``: wait before it; ``separates``: the causes that it
    informs most about, joined by " | ".
    """
    schema = pa.schema(
        [
            ("order", pa.int32()), ("path", PATH), ("window_m", vector(4)), ("color_srgb", vector(3)),
            ("reload", pa.bool_()), ("wait_s", pa.float32()), ("separates", pa.string()),
        ]
    )  # fmt: skip
    ranges = ranges_of(measured)
    return pa.Table.from_pylist(
        [
            {
                "order": order,
                "path": action.path.tolist(),
                "window_m": window_of(action, measured, ranges).tolist(),
                "color_srgb": measured.samples.color[action.like].tolist(),
                "reload": action.reload,
                "wait_s": action.wait_s,
                "separates": " | ".join(question),
            }
            for order, (action, question) in enumerate(zip(proposal.actions, proposal.question, strict=True))
        ],
        schema=schema,
    )


def screen(result: StrokeResult) -> Screening[Measured, Model]:
    """Compare base and extended model over all strokes."""
    measured = with_learned_residual(result)
    models = result.base.model, result.extended.model
    full = with_all(result.extended.model, measured, VOCABULARY)
    base_scores, extended_scores = (mode_scores(model, measured).amounts for model in models)
    base_residual, extended_residual = (_signed(model, measured) for model in models)
    return screening_of(
        measured,
        measured.pick(result.splits.test),
        full,
        linearise(full, measured),
        columns_of(full),
        modes=MODES,
        scores=(base_scores, extended_scores),
        covariates=covariates_shown(measured),
        residuals=(base_residual, extended_residual),
        action=measured.action,
    )


def _signed(model: Model, measured: Measured) -> Array:
    """Residual, mean over the channels, [B, H, W]; NaN outside the windows."""
    rest = residual(model, measured).mean(-1)
    return np.where(measured.samples.valid.numpy() > 0, rest, np.nan)
