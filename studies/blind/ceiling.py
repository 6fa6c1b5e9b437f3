"""What the gap finder leaves of a named world's gap, without chance: `python -m studies.blind.ceiling [--worlds 8]`.

A verdict's share of the gap is read off 72 sealed photographs with all their noise. Here each world of one strong
cause is executed six times more under the same commands; what the averaged photographs still differ by from what is
foretold is misfit and no noise. Beside it stands the best that the tool's habits could do: learnt from the averaged
photographs of all other strokes, with nothing held back for any cause. Writes docs/blind_ceiling.md.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pyarrow as pa
import torch
from numpy.typing import NDArray

from pentimento.contracts.atomic import atomic_write
from pentimento.gap.diagnose import Diagnosis, diagnose
from pentimento.gap.foretell import Model, foretold, residual
from pentimento.gap.habits import learn_habits
from pentimento.gap.measured import Measured, load_measured
from pentimento.stroke_dynamics.mechanisms import VOCABULARY
from studies.blind.collect import as_table, record_world
from studies.blind.design import view_of
from studies.blind.make import Truth, commands_of, make_world
from studies.blind.one_world import ROOT
from studies.blind.score_card import STRONG_Q
from studies.blind.series import seed_of
from studies.blind.strength import StrengthError
from studies.blind.table import commit_of_head
from studies.blind.worlds import Sketch, sketch_world

Array = NDArray[Any]

PAGE = ROOT / "docs" / "blind_ceiling.md"
_REALISATIONS = range(11, 17)  # none that a strength or a shifted context was measured in
_SERIES = "ceiling"
_INTRODUCTION = """\
# What the gap finder leaves open in blind worlds

Written by `python -m studies.blind.ceiling`; do not edit. Worlds of the [blind tests](blind_tests.md) with one cause
of q ≥ 0.2 that is named exactly. *Verdict*: the share of the gap that is closed on the 72 sealed photographs, as the
verdict says it. All else is without chance: every command was executed six times more, and what the averaged
photographs differ by from what is foretold is no noise. *Left*: the mean squared misfit of the extended model on sealed
strokes over the noise floor; *closed*: the share of the base's misfit that this is short of. *Best habits*: the same
with the tool's habits learnt from the averaged, all but noiseless photographs of all other strokes, with nothing held
back for any cause: what a quieter camera and a surer hand could give these habits at most, from as many strokes."""


@dataclass(frozen=True)
class Line:
    """One world. Misfits are of sealed strokes, over the noise floor."""

    truth: Truth
    verdict: float | None
    base: float
    extended: float
    best: float

    @property
    def closed(self) -> float:
        """Share of the base's misfit that the extended model does not have."""
        return 1 - self.extended / self.base

    @property
    def closed_at_best(self) -> float:
        """The same with the best habits."""
        return 1 - self.best / self.base


def line_of(sketch: Sketch) -> Line | None:
    """None where the cause is not named exactly.

    Raises:
        StrengthError: its effect cannot be as strong as it is wanted.
    """
    table, truth = make_world(sketch)
    found = diagnose(load_measured(table), list(VOCABULARY), 0, lambda line: None)
    if tuple(finding.cause for finding in found.established) != truth.causes:
        return None
    again = list(_executed_again(sketch, truth, table))
    closed = found.gap_closed
    return Line(
        truth, None if closed is None else closed[0],
        _misfit(found.base, found, again), _misfit(found.extended, found, again), _best(found, again),
    )  # fmt: skip


def _executed_again(sketch: Sketch, truth: Truth, table: pa.Table) -> Iterator[Measured]:
    """The same strokes in other realisations, with the columns that the table has beside the contract's."""
    view = view_of(sketch.tool, fine=False)
    world = sketch.with_strengths(tuple(s.strength for s in truth.strengths))
    for realisation in _REALISATIONS:
        recording = record_world(
            world, sketch.seed, sketch.tool, sketch.palette_srgb, commands_of(sketch, view), view,
            realisation=realisation,
        )  # fmt: skip
        own = set(recording.rows[0])
        columns = {name: table[name].to_numpy() for name in table.column_names if name not in own}
        yield load_measured(as_table(recording, columns))


def _misfit(model: Model, found: Diagnosis, again: Sequence[Measured], habit: Array | None = None) -> float:
    """Mean squared misfit on sealed strokes over the noise floor, the variance of the mean taken off."""
    habit = found.measured.habit if habit is None else habit
    sealed = found.splits.test
    rest = np.stack([residual(model, replace(each, habit=habit).pick(sealed)) for each in again])
    pixels = again[0].samples.valid.numpy()[sealed].sum((1, 2)) * 3

    def mean(squares: Array) -> float:
        return float((squares.sum((1, 2, 3)) / pixels).mean())

    noise = mean(rest.var(0, ddof=1))
    return (mean(np.square(rest.mean(0))) - noise / len(rest)) / noise


def _best(found: Diagnosis, again: Sequence[Measured]) -> float:
    """The misfit with habits learnt from averaged photographs of all strokes that are not sealed."""
    plain = [replace(each, habit=np.zeros_like(each.habit)) for each in again]
    model, first = found.extended, plain[0]
    average = foretold(model, first) + np.mean([residual(model, each) for each in plain], axis=0)
    quiet = replace(first, samples=first.samples._replace(after=torch.from_numpy(average.astype(np.float32))))
    known = np.sort(np.concatenate(found.splits[:2]))
    _, learnt = learn_habits(quiet, model, known, [], 0)
    return _misfit(model, found, again, learnt.habit)


def page(lines: Sequence[Line], commit: str) -> str:
    """The whole file."""
    head = "| cause | tool | mis-shaped | q | verdict | left | closed | left, best habits | closed, best habits |"
    rows = [head, "|---|---|---|---|---|---|---|---|---|"]
    for line in lines:
        truth = line.truth
        verdict = "–" if line.verdict is None else f"{line.verdict:.2f}"
        rows.append(
            f"| {truth.causes[0]} | {truth.tool} | {'yes' if truth.misshaped else 'no'} | {truth.strengths[0].q:.2f} "
            f"| {verdict} | {line.extended:.2f} | {line.closed:.2f} "
            f"| {line.best:.2f} | {line.closed_at_best:.2f} |"
        )
    said = [line.verdict for line in lines if line.verdict is not None]
    medians = (
        f"Medians: verdict {np.median(said):.2f}, closed {np.median([line.closed for line in lines]):.2f}, "
        f"with the best habits {np.median([line.closed_at_best for line in lines]):.2f}."
    )
    origin = f"Seeds: sha256 of the commit `{commit}`, the series “{_SERIES}” and a number."
    return "\n\n".join([_INTRODUCTION, "\n".join(rows), medians, origin]) + "\n"


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(prog="python -m studies.blind.ceiling", description=__doc__)
    parser.add_argument("--worlds", type=int, default=8)
    given = parser.parse_args()
    commit, lines, index = commit_of_head(), list[Line](), 0
    while len(lines) < given.worlds:
        sketch = sketch_world("one", seed_of(commit, _SERIES, index))
        index += 1
        if sketch.q[0] < STRONG_Q:
            continue
        try:
            line = line_of(sketch)
        except StrengthError as reason:
            print(reason)
            continue
        if line is None:
            print(f"{sketch.causes[0]} of the {sketch.tool.name} is not named exactly.")
            continue
        lines.append(line)
        print(f"{sketch.causes[0]}, {sketch.tool.name}: left {line.extended:.3f}, best {line.best:.3f}", flush=True)
        atomic_write(PAGE, page(lines, commit).encode())


if __name__ == "__main__":
    main()
