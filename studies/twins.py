"""What a hidden effect adds to the error, and how much of that a verdict takes away again, in blind worlds and their
twins: `python -m studies.twins [--strokes 8] [--pushes 8]`.

A verdict's share of the gap is of all that a base gets wrong, its tool's shape included. A world's twin is the same
world, with the same actions under the same chance, without the effect: what its base misses is what no cause could have
explained. Writes docs/blind_twins.md.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

import studies.blind.make as strokes
import studies.blind_pushes.make as pushes
from pentimento.contracts.atomic import atomic_write
from pentimento.diagnosis.strokes.diagnose import diagnose
from pentimento.diagnosis.strokes.measured import load_measured
from pentimento.diagnosis.verdict import DiagnosisResult
from pentimento.dynamics.strokes.mechanisms import VOCABULARY
from studies.blind.collect import as_table, record_world
from studies.blind.design import view_of
from studies.blind.one_world import ROOT
from studies.blind.score_card import STRONG_Q
from studies.blind.series import seed_of
from studies.blind.strength import StrengthError
from studies.blind.table import commit_of_head
from studies.blind.worlds import sketch_world as sketch_strokes
from studies.blind_pushes.collect import as_table as as_push_table
from studies.blind_pushes.collect import decoys, rows_with_and_without
from studies.blind_pushes.verdict_of import verdict_on
from studies.blind_pushes.worlds import sketch_world as sketch_pushes

PAGE = ROOT / "docs" / "blind_twins.md"
_SERIES = "twins"
_INTRODUCTION = """\
# What a hidden effect adds, and what a verdict takes away

Written by `python -m studies.twins`; do not edit. Worlds of the blind tests of [strokes](blind_tests.md) and
[pushes](blind_pushes.md) with one cause of q ≥ 0.2 that is named exactly. Each has a *twin*: the same world, actions
and chance without the effect; of pushes on the same surfaces, too, so that each finds what the world's has left. Errors
are of sealed rows over the noise floor: of the *base* in the world, of the *extended* model there, and of the base in
the *twin*. *Gap closed* is the verdict's, (base − extended) / (base − 1): of all that the base gets wrong. *Of the
effect* is (base − extended) / (base − twin): of what the effect adds to that, which is all that a cause can explain.
Where it is above 1, the base fares better with the effect explained than without it: chance, or a shape that the
cause's own numbers help to draw; a dash, where the base misses no less without the effect."""


@dataclass(frozen=True)
class Pair:
    """A world and its twin. Errors are of sealed rows, over the world's noise floor."""

    cause: str
    tool: str
    misshaped: bool
    q: float
    base: float
    extended: float
    counterfactual: float

    @property
    def closed(self) -> float:
        """Share of the gap above the floor."""
        return (self.base - self.extended) / (self.base - 1)

    @property
    def of_the_effect(self) -> float | None:
        """Share of what the effect adds; None where it adds nothing."""
        return (
            (self.base - self.extended) / (self.base - self.counterfactual) if self.counterfactual < self.base else None
        )


def pair_of(
    truth: strokes.Truth | pushes.Truth, world: DiagnosisResult, counterfactual: DiagnosisResult
) -> Pair | None:
    """None where the cause is not named exactly, or the floor is not known."""
    if tuple(finding.cause for finding in world.established) != truth.causes or world.floor is None:
        return None
    base, extended, of_counterfactual = (
        float(losses.mean() / world.floor.mse)
        for losses in (world.base_losses, world.extended_losses, counterfactual.base_losses)
    )
    return Pair(truth.causes[0], truth.tool, truth.misshaped, truth.strengths[0].q, base, extended, of_counterfactual)


def stroke_pair(seed: int) -> Pair | None:
    """Of the world of strokes with this seed; None where its effect is faint, too, or not named.

    Raises:
        StrengthError: its effect cannot be as strong as it is wanted.
    """
    sketch = sketch_strokes("one", seed)
    if sketch.q[0] < STRONG_Q:
        return None
    table, truth = strokes.make_world(sketch)
    view = view_of(sketch.tool, fine=False)
    recording = record_world(
        sketch.world, sketch.seed, sketch.tool, sketch.palette_srgb, strokes.commands_of(sketch, view), view
    )
    own = set(recording.rows[0])
    counterfactual = as_table(
        recording, {name: table[name].to_numpy() for name in table.column_names if name not in own}
    )
    return pair_of(
        truth,
        *(diagnose(load_measured(each), list(VOCABULARY), 0, lambda line: None) for each in (table, counterfactual)),
    )


def push_pair(seed: int) -> Pair | None:
    """The same of pushes."""
    sketch = sketch_pushes("one", seed)
    if sketch.q[0] < STRONG_Q:
        return None
    table, truth = pushes.make_world(sketch)
    hidden = sketch.with_strengths({sketch.causes[0]: truth.strengths[0].strength})
    _, quiet = rows_with_and_without(sketch, hidden, sketch.seed, sketch.config)
    counterfactual = as_push_table(quiet, decoys(len(quiet), sketch.seed))
    return pair_of(truth, *(verdict_on(each, 0)[1] for each in (table, counterfactual)))


def page(of_strokes: Sequence[Pair], of_pushes: Sequence[Pair], commit: str) -> str:
    """The whole file."""
    parts = [_INTRODUCTION]
    for name, pairs in (("Strokes", of_strokes), ("Pushes", of_pushes)):
        if pairs:
            parts += [f"## {name}", _table(pairs), _medians(pairs)]
    return "\n\n".join([*parts, f"Seeds: sha256 of the commit `{commit}`, the series and a number."]) + "\n"


def _table(pairs: Sequence[Pair]) -> str:
    rows = [
        "| cause | tool | mis-shaped | q | base | extended | twin | gap closed | of the effect |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    rows += [
        f"| {pair.cause} | {pair.tool} | {'yes' if pair.misshaped else 'no'} | {pair.q:.2f} | {pair.base:.2f} "
        f"| {pair.extended:.2f} | {pair.counterfactual:.2f} | {pair.closed:.2f} | {_two(pair.of_the_effect)} |"
        for pair in pairs
    ]
    return "\n".join(rows)


def _medians(pairs: Sequence[Pair]) -> str:
    shares = [pair.of_the_effect for pair in pairs if pair.of_the_effect is not None]
    of_the_effect = f"{np.median(shares):.2f} (least {min(shares):.2f})" if shares else "–"
    return f"Medians: gap closed {np.median([pair.closed for pair in pairs]):.2f}, of the effect {of_the_effect}."


def _two(share: float | None) -> str:
    return "–" if share is None else f"{share:.2f}"


def _pairs(pair: Callable[[int], Pair | None], commit: str, series: str, wanted: int) -> Iterator[Pair]:
    index = found = 0
    while found < wanted:
        try:
            made = pair(seed_of(commit, series, index))
        except StrengthError as reason:
            print(reason)
            made = None
        index += 1
        if made is not None:
            found += 1
            print(f"{made.cause}, {made.tool}: {made.closed:.2f} closed, {_two(made.of_the_effect)}", flush=True)
            yield made


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(prog="python -m studies.twins", description=__doc__)
    parser.add_argument("--strokes", type=int, default=8, help="worlds")
    parser.add_argument("--pushes", type=int, default=8, help="worlds")
    given = parser.parse_args()
    commit, of_strokes, of_pushes = commit_of_head(), list[Pair](), list[Pair]()
    for pairs, pair, series, wanted in (
        (of_strokes, stroke_pair, f"{_SERIES} of strokes", given.strokes),
        (of_pushes, push_pair, f"{_SERIES} of pushes", given.pushes),
    ):
        for made in _pairs(pair, commit, series, wanted):
            pairs.append(made)
            atomic_write(PAGE, page(of_strokes, of_pushes, commit).encode())


if __name__ == "__main__":
    main()
