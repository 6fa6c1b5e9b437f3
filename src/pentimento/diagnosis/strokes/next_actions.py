"""The strokes that would best tell rival causes apart: a D_s-optimal design (Atkinson, Donev & Tobias 2007, ch. 10).

What strokes say of a cause's quantities when base, rivals and all else are free is the Schur complement S of their
curvature; it is small where a rival can take the cause's place. Strokes are chosen one after another to raise the sum
of log det S over the causes in question, among random feasible ones whose ink, wear and clock are those of their turn;
then each is exchanged while another one is better (Fedorov 1972).
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
    Aliasing,
    Question,
    aliasing,
    alike,
    best_of_turns,
    detectable,
    questions,
    says_most_about,
    worth,
)
from pentimento.diagnosis.residual_structure import Dependence, dependences, mode_strength, standing
from pentimento.diagnosis.strokes.aliasing import columns_of, with_all
from pentimento.diagnosis.strokes.candidate_actions import (
    Action,
    Ranges,
    as_measured,
    draw_sequence,
    in_turn,
    ranges_of,
    window_of,
)
from pentimento.diagnosis.strokes.diagnose import Diagnosis
from pentimento.diagnosis.strokes.jacobian import linearise, linearise_rows
from pentimento.diagnosis.strokes.measured import Measured, covariates_shown
from pentimento.diagnosis.strokes.model import Model
from pentimento.diagnosis.strokes.modes import MODES, mode_scores
from pentimento.diagnosis.strokes.predict import residual
from pentimento.dynamics.strokes.mechanisms import VOCABULARY

Array = NDArray[Any]

ACTIONS = 16
_SEQUENCES = 24
"""Random ones; each turn takes its action from one of them."""
_FOR_WAITING = 0.1
"""Of log det S: what waiting between strokes must be worth."""


class Proposal(NamedTuple):
    """Actions in the order in which they are to be made."""

    actions: tuple[Action, ...]
    question: tuple[Question, ...]
    """For each action, what it says most about."""
    aliasing: dict[tuple[str, str], tuple[float, float]]
    """Of each pair: so far, and as it will be with these actions."""


def proposal_for(diagnosis: Diagnosis, seen: Survey, seed: int) -> Proposal:
    """The next strokes after a diagnosis; none where nothing is in question."""
    asked = questions(diagnosis, seen.aliasing)
    if not asked:
        return Proposal((), (), {})
    wanted = {cause for question in asked for cause in question}
    wanted |= {mechanism.cause for mechanism in diagnosis.extended.mechanisms}
    kept = tuple(mechanism for mechanism in seen.full.mechanisms if mechanism.cause in wanted)
    return propose(replace(seen.full, mechanisms=kept), seen.measured, asked, seed)


def propose(model: Model, measured: Measured, asked: Sequence[Question], seed: int, count: int = ACTIONS) -> Proposal:
    """The ``count`` actions that say most about the questions, given the strokes made so far.

    Args:
        model: with a mechanism for every cause that the questions name.
        measured: the strokes so far; actions stay within their ranges.
    """
    columns, ranges = columns_of(model), ranges_of(measured)
    so_far = linearise_rows(model, measured)[0].sum(0)
    rng = np.random.default_rng([seed, 14])
    sequences = [draw_sequence(rng, ranges, measured, count) for _ in range(_SEQUENCES)]
    _, says = curvatures(sequences, model, measured, ranges)
    chosen = best_of_turns(so_far, says, columns, asked)
    # A turn's ink and clock follow from the strokes before it, so that the sequence is looked at once more as a whole.
    best = [sequences[s][turn] for turn, s in enumerate(chosen)]
    (actions,), (gathered,) = curvatures([best], model, measured, ranges)
    without_waiting = [action._replace(wait_s=0.0) for action in actions]
    (hasty,), (quickly,) = curvatures([without_waiting], model, measured, ranges)
    if worth(so_far + quickly.sum(0), columns, asked) > worth(so_far + gathered.sum(0), columns, asked) - _FOR_WAITING:
        actions, gathered = hasty, quickly
    total = so_far + gathered.sum(0)
    about = tuple(says_most_about(total, one, columns, asked) for one in gathered)
    pairs = [(q[0], q[1]) for q in asked if len(q) == 2]
    return Proposal(tuple(actions), about, {p: (alike(so_far, columns, p), alike(total, columns, p)) for p in pairs})


def curvatures(
    sequences: Sequence[Sequence[Action]], model: Model, measured: Measured, ranges: Ranges
) -> tuple[list[list[Action]], Array]:
    """Sequences of k actions as they can be made one after another, each where the recorded strokes end, and what every
    action will say of the model's numbers, [S, k, P, P].
    """
    turns = [in_turn(actions, measured, ranges) for actions in sequences]
    actions = [action for made, _ in turns for action in made]
    columns = [row for _, rows in turns for row in rows]
    curvature = linearise_rows(model, as_measured(actions, columns, model, measured, ranges))[0]
    return [made for made, _ in turns], curvature.reshape(len(sequences), -1, *curvature.shape[1:])


def as_table(proposal: Proposal, measured: Measured) -> pa.Table:
    """What a robot needs, to be made in its order on a new sheet: one row for each action.

    ``order``; ``path`` [N, 5] in the recording's frame (times NaN where it has none); ``window_m`` to photograph
    before and after; ``color_srgb``; ``reload``: dip first; ``wait_s``: wait before it; ``separates``: the causes that
    it says most about, joined by " | ".
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


class Survey(NamedTuple):
    """All that is drawn."""

    measured: Measured
    test_split: Measured
    full: Model
    """The extended model with every other observable cause at no effect."""
    aliasing: Aliasing
    detectable: dict[str, float]
    """Smallest share of the error that a cause must remove to be found in four of five such collections."""
    base_strength: Array
    """[modes, covariates] of the base's residual, correlation times the root of the number of strokes."""
    extended_strength: Array
    covariates: tuple[str, ...]
    modes: tuple[str, ...]
    dependence: tuple[Dependence, ...]
    base_residual: Array
    """[B, H, W] of all strokes, measured less foretold, mean over the channels; NaN outside the windows."""
    extended_residual: Array


def survey(diagnosis: Diagnosis) -> Survey:
    """Look at base and extended model over all strokes."""
    measured = diagnosis.measured
    full = with_all(diagnosis.extended, measured, VOCABULARY)
    statistics = linearise(full, measured)
    columns = columns_of(full)
    covariates = covariates_shown(measured)
    amounts = {
        name: standing(mode_scores(model, measured)[0])
        for name, model in (("base", diagnosis.base), ("extended", diagnosis.extended))
    }
    strengths = {name: mode_strength(values, covariates) for name, values in amounts.items()}
    return Survey(
        measured=measured,
        test_split=measured.pick(diagnosis.splits.test),
        full=full,
        aliasing=aliasing(statistics, columns),
        detectable=detectable(statistics, columns),
        base_strength=strengths["base"],
        extended_strength=strengths["extended"],
        covariates=tuple(covariates),
        modes=MODES,
        dependence=dependences(MODES, amounts["base"], amounts["extended"], covariates, strengths, measured.action),
        base_residual=_signed(diagnosis.base, measured),
        extended_residual=_signed(diagnosis.extended, measured),
    )


def _signed(model: Model, measured: Measured) -> Array:
    rest = residual(model, measured).mean(-1)
    return np.where(measured.samples.valid.numpy() > 0, rest, np.nan)
