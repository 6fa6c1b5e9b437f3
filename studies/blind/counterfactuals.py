"""How much error a hidden effect adds, and how much of it a verdict removes: `python -m studies.blind.counterfactuals`.

The verdict's fraction of the gap closed is relative to all errors of a base, its tool's shape included. The
counterfactual world is the same world without the effect, with the same actions and random numbers: its base error is
what no cause could have explained. Writes docs/counterfactual_worlds.md.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pentimento.contracts.atomic import atomic_write
from pentimento.diagnosis.diagnose import Result
from studies.blind.one_world import ROOT
from studies.blind.pushes import make as pushes
from studies.blind.pushes.collect import as_table as as_push_table
from studies.blind.pushes.collect import decoys, rows_with_and_without
from studies.blind.pushes.verdict_of import verdict_on
from studies.blind.pushes.worlds import sketch_world as sketch_pushes
from studies.blind.score_card import STRONG_Q
from studies.blind.series import seed_of
from studies.blind.strokes import make as strokes
from studies.blind.strokes.collect import as_table, record_world
from studies.blind.strokes.design import view_of
from studies.blind.strokes.verdict_of import verdict_on as stroke_verdict_on
from studies.blind.strokes.worlds import sketch_world as sketch_strokes
from studies.blind.table import commit_of_head
from studies.blind.truth import StrengthError, Truth

PAGE = ROOT / "docs" / "counterfactual_worlds.md"
_SERIES = {"strokes": "twins of strokes", "pushes": "twins of pushes"}  # seeds are drawn from these texts
_INTRODUCTION = """\
# The error that a hidden effect adds, and the part that a verdict removes

Written by `python -m studies.blind.counterfactuals`; do not edit. Worlds of the blind benchmarks of
[strokes](blind_tests.md) and [pushes](blind_pushes.md) with one cause of q ≥ 0.2 that is named exactly. The
*counterfactual* world has the same seed, actions and random numbers without the effect; pushes have the same surfaces,
too. Errors are of the test split over the noise floor: of the *base* and the *extended* model in the world, and of the
base in the *counterfactual* world. *Gap closed* is the verdict's, (base − extended) / (base − 1), relative to all
errors of the base. *Of the effect* is (base − extended) / (base − counterfactual), relative to the error that the
effect adds, which is all that a cause can explain. It is above 1 where the extended model's error is below the base's
without the effect, by chance or because the cause's parameters also fit the tool's shape. A dash: the effect adds no
error."""


@dataclass(frozen=True)
class Pair:
    """A world and its counterfactual. Errors are of the test split, over the world's noise floor."""

    cause: str
    tool: str
    misshaped: bool
    q: float
    base: float
    extended: float
    counterfactual: float

    @property
    def closed(self) -> float:
        """Fraction of the gap above the floor that is closed."""
        return (self.base - self.extended) / (self.base - 1)

    @property
    def of_the_effect(self) -> float | None:
        """Fraction of the error added by the effect that is removed; None where it adds none."""
        added = self.base - self.counterfactual
        return (self.base - self.extended) / added if added > 0 else None


def pair_of(truth: Truth, world: Result[Any], counterfactual: Result[Any]) -> Pair | None:
    """None where the cause is not named exactly, or the floor is not known."""
    if tuple(finding.cause for finding in world.established) != truth.causes or world.floor is None:
        return None
    base, extended, of_counterfactual = (
        float(losses.mean() / world.floor.mse)
        for losses in (world.base_losses, world.extended_losses, counterfactual.base_losses)
    )
    return Pair(truth.causes[0], truth.tool, truth.misshaped, truth.strengths[0].q, base, extended, of_counterfactual)


def stroke_pair(seed: int) -> Pair | None:
    """The pair of the world of strokes with this seed; None where its effect is faint or not named exactly.

    Raises:
        StrengthError: no strength gives its effect the wanted energy.
    """
    sketch = sketch_strokes("one", seed)
    if sketch.q[0] < STRONG_Q:
        return None
    table, truth = strokes.make_world(sketch)
    view = view_of(sketch.tool, fine=False)
    recording = record_world(
        sketch.world,
        sketch.seed,
        sketch.tool,
        palette_srgb=sketch.palette_srgb,
        commands=strokes.commands_of(sketch, view),
        view=view,
    )
    own = set(recording.rows[0])
    counterfactual = as_table(
        recording, {name: table[name].to_numpy() for name in table.column_names if name not in own}
    )
    return pair_of(truth, *(stroke_verdict_on(each, 0).result for each in (table, counterfactual)))


def push_pair(seed: int) -> Pair | None:
    """The pair of the world of pushes with this seed; None where its effect is faint or not named exactly."""
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
        "| cause | tool | mis-shaped | q | base | extended | counterfactual | gap closed | of the effect |",
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
    of_the_effect = f"{np.median(shares):.2f} (min {min(shares):.2f})" if shares else "–"
    return f"Medians: gap closed {np.median([pair.closed for pair in pairs]):.2f}, of the effect {of_the_effect}."


def _two(share: float | None) -> str:
    return "–" if share is None else f"{share:.2f}"


def _pairs(pair: Callable[[int], Pair | None], commit: str, series: str, wanted: int) -> Iterator[Pair]:
    index = found = 0
    while found < wanted:
        try:
            found_pair = pair(seed_of(commit, series, index))
        except StrengthError as reason:
            print(reason)
            found_pair = None
        index += 1
        if found_pair is not None:
            found += 1
            print(f"{found_pair.cause}, {found_pair.tool}: {found_pair.closed:.2f} closed", flush=True)
            yield found_pair


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(prog="python -m studies.blind.counterfactuals", description=__doc__)
    parser.add_argument("--strokes", type=int, default=8, help="worlds")
    parser.add_argument("--pushes", type=int, default=8, help="worlds")
    args = parser.parse_args()
    commit, of_strokes, of_pushes = commit_of_head(), list[Pair](), list[Pair]()
    for pairs, pair, series, wanted in (
        (of_strokes, stroke_pair, _SERIES["strokes"], args.strokes),
        (of_pushes, push_pair, _SERIES["pushes"], args.pushes),
    ):
        for found in _pairs(pair, commit, series, wanted):
            pairs.append(found)
            atomic_write(PAGE, page(of_strokes, of_pushes, commit).encode())


if __name__ == "__main__":
    main()
