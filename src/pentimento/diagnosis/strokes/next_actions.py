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
from pentimento.diagnosis.result import Judged
from pentimento.diagnosis.strokes.aliasing import Aliasing, Columns, aliasing, columns_of, pairs_alike
from pentimento.diagnosis.strokes.candidate_actions import Action, as_measured, draw_sequence, in_turn, window_of
from pentimento.diagnosis.strokes.design_ranges import Ranges, ranges_of
from pentimento.diagnosis.strokes.diagnose import Diagnosis
from pentimento.diagnosis.strokes.jacobian import Statistics, linearise_rows
from pentimento.diagnosis.strokes.measured import Measured
from pentimento.diagnosis.strokes.predict import Model
from pentimento.diagnosis.strokes.screening import Survey

Array = NDArray[Any]

ACTIONS = 16
_SEQUENCES = 24
"""Random ones; each turn takes its action from one of them."""
_EXCHANGES = 10
_MIN_RISE = 1e-3
_FOR_WAITING = 0.1
"""Of log det S: what waiting between strokes must be worth."""

Question = tuple[str, ...]
"""Causes to be told apart, or one whose quantities are to be known better."""


class Proposal(NamedTuple):
    """Actions in the order in which they are to be made."""

    actions: tuple[Action, ...]
    question: tuple[Question, ...]
    """For each action, what it says most about."""
    aliasing: dict[tuple[str, str], tuple[float, float]]
    """Of each pair: so far, and as it will be with these actions."""


def questions(diagnosis: Judged, found: Aliasing) -> list[Question]:
    """What the next actions should decide.

    Named causes against their rivals and imitators; without any, the quantities of what is established; without that,
    the cause that the strokes spoke for most against what imitates it, or against the second.
    """
    named = {f.cause: f.rivals for f in (*diagnosis.established, *diagnosis.suspected)}
    known = set(found.causes)
    seen = {c: tuple(r for r in rivals if r in known) for c, rivals in named.items() if c in known}
    pairs: list[Question] = list(pairs_alike(found, seen))
    if pairs:
        return pairs
    if seen:
        return [(cause,) for cause in seen]
    evidence = diagnosis.search.steps[-1].evidence if diagnosis.search.steps else {}
    strongest = [cause for _, cause in sorted((e.p, cause) for cause, e in evidence.items() if cause in known)]
    if len(strongest) < 2:
        return []
    return list(pairs_alike(found, {strongest[0]: ()})) or [(strongest[0], strongest[1])]


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


def best_of_turns(so_far: Array, says: Array, columns: Columns, asked: Sequence[Question]) -> list[int]:
    """For each turn, which sequence's action: one after another the best, then exchanged while anything improves."""
    turns = range(says.shape[1])
    chosen: list[int] = []
    total = so_far.copy()
    for turn in turns:
        chosen.append(int(np.argmax(_worth(total + says[:, turn], columns, asked))))
        total += says[chosen[turn], turn]
    for _ in range(_EXCHANGES):
        changed = False
        for turn in turns:
            total -= says[chosen[turn], turn]
            values = _worth(total + says[:, turn], columns, asked)
            best = int(np.argmax(values))
            if values[best] > values[chosen[turn]] + _MIN_RISE:
                chosen[turn], changed = best, True
            total += says[chosen[turn], turn]
        if not changed:
            break
    return chosen


def worth(total: Array, columns: Columns, asked: Sequence[Question]) -> float:
    """Sum of log det S over the questions' causes, for a curvature [P, P] summed over all actions."""
    return float(_worth(total[None], columns, asked)[0])


def alike(total: Array, columns: Columns, pair: tuple[str, str]) -> float:
    """Largest canonical correlation of two causes' derivatives without the part of everything else in the model."""
    rest = [index for cause, index in columns.causes.items() if cause not in pair]
    held = Columns(np.concatenate([columns.nuisances, *rest]), {cause: columns.causes[cause] for cause in pair})
    nothing = np.zeros((1, len(total)))
    return aliasing(Statistics(total[None], nothing, nothing[:, 0]), held).of(*pair)


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


def _worth(totals: Array, columns: Columns, asked: Sequence[Question]) -> Array:
    """The same for curvatures [M, P, P]: [M]. log det of a Schur complement is a difference of two."""
    everything = np.arange(totals.shape[1])
    of_all = _log_det(totals, everything)
    worth = np.zeros(len(totals))
    for cause in (cause for question in asked for cause in question):
        worth += of_all - _log_det(totals, np.setdiff1d(everything, columns.causes[cause]))
    return worth


def _log_det(totals: Array, index: Array) -> Array:
    """Of parts of [M, P, P], [M]; a hundred-millionth more on the diagonal, for what nothing depends on."""
    own = np.maximum(np.einsum("mpp->mp", totals)[:, index], 1e-150)  # whose square is still a number
    scaled = totals[:, index][:, :, index] / np.sqrt(own[:, :, None] * own[:, None, :])
    log_det: Array = np.linalg.slogdet(scaled + 1e-8 * np.eye(len(index)))[1] + np.log(own).sum(1)
    return log_det


def says_most_about(total: Array, says: Array, columns: Columns, asked: Sequence[Question]) -> Question:
    """The question on which most is lost without the action."""
    lost = [worth(total, columns, [q]) - worth(total - says, columns, [q]) for q in asked]
    return asked[int(np.argmax(lost))]
