"""The files of a diagnosis of strokes, and diagnosis in rounds with newly collected strokes."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import cast

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from pentimento.contracts.strokes import CONTRACT
from pentimento.contracts.tables import write_table
from pentimento.diagnosis.diagnose import diagnose
from pentimento.diagnosis.gauss_newton import covariance
from pentimento.diagnosis.splits import few_actions
from pentimento.diagnosis.strokes.executed import measures_paths
from pentimento.diagnosis.strokes.measured import Measured, load_measured
from pentimento.diagnosis.strokes.model import BASE, WIDTHS, model_as_json
from pentimento.diagnosis.strokes.next_actions import as_table, proposal_for, screen
from pentimento.diagnosis.strokes.out_of_distribution import evaluate_baseline, gap_closed_outside, paints_of
from pentimento.diagnosis.strokes.problem import StrokeProblem, StrokeResult, as_commanded, stroke_problem
from pentimento.diagnosis.strokes.quarantine import usable_rows
from pentimento.diagnosis.strokes.report import build_page
from pentimento.diagnosis.verdict import NEXT_ACTIONS, verdict, write_result
from pentimento.dynamics.strokes.mechanisms import VOCABULARY
from pentimento.dynamics.strokes.simulation import NotObservable
from pentimento.dynamics.strokes.traj2stroke import Traj2StrokeParameters
from pentimento.report.wording import count

STROKES = "strokes"
"""Folder of the table that includes the added rows."""


def write_diagnosis(
    table: pa.Table,
    out: Path,
    seed: int,
    *,
    log: Callable[[str], None],
    outside: pa.Table | None = None,
    left_out: str | None = None,
    given: Traj2StrokeParameters | None = None,
) -> StrokeResult:
    """Diagnose rows of the strokes contract and write the result into the folder ``out``.

    ``verdict.json`` (schema 2), ``report.html`` and ``figures/``, ``extended_model.json``, ``next_actions.parquet``.
    Each file is complete or absent; the verdict is written last. Nothing is written when the rows allow no diagnosis.

    Args:
        table: rows that keep the contract; those of which no sample can be made are left out.
        out: created where it is missing; other files in it stay.
        seed: of splits, bootstraps and the next actions.
        log: gets progress lines.
        outside: another table, for the out-of-distribution evaluation.
        left_out: a sentence on rows that were left out before.
        given: a user-supplied baseline model, whose error is reported beside the base's.

    Raises:
        ContractError: too few rows, or more than 1 % of them cannot be used (it names them).
    """
    if outside is not None and measures_paths(table) != measures_paths(outside):
        table, outside = (_without_measured_paths(each) for each in (table, outside))
    measured, notes = _usable(table, "")
    notes = ([left_out] if left_out else []) + notes
    for note in notes:
        log(note)
    other = None if outside is None else _usable(outside, "Of the outside table: ")
    if following := measured.following:
        notes.append(following.sentence())
    if measured.press_from_force:
        notes.append("Press is taken from the force, because z does not vary.")
    problem = stroke_problem(measured, VOCABULARY, seed)
    notes += filter(None, [few_actions(problem.rows)])
    result = diagnose(problem, seed=seed, log=log)
    notes += _effect_of_press(result)
    shifted = None
    if other is not None:
        notes += other[1]
        try:
            shifted = gap_closed_outside(other[0], problem, result)
            if shifted is None:
                notes.append("On the outside table the base model has no known gap above a noise floor.")
        except NotObservable as reason:
            notes.append(f"The extended model cannot be tested on the outside table: {reason}.")
    log("drawing the report")
    seen = screen(result)
    proposal = proposal_for(result, seen, seed)
    beside = None if given is None else evaluate_baseline(given, seen.test)
    content = verdict(result, shifted=shifted, notes=notes, given_mse=beside and beside.mse)
    if following:
        content["following"] = following._asdict()
    write_result(
        out,
        page=build_page(result, seen, proposal, content, beside),
        actions=as_table(proposal, measured),
        model=model_as_json(as_commanded(result.extended.model, measured), paints_of(measured)),
        content=content,
    )
    return result


def _effect_of_press(result: StrokeResult) -> list[str]:
    """What the base model says of press, in a sentence; none where press does not vary."""
    known, base = cast(StrokeProblem, result.known), result.base
    if not (press_m := -known.measured.samples.path[..., 3]).max() > press_m.min():
        return []
    at = BASE.index("density_by_press")
    error = np.sqrt(covariance(known.linearise(base, ()))[at, at])
    light_mm, deep_mm = base.model.base[0], base.model.base[len(WIDTHS) - 1]
    opacity = np.exp(base.model.base[at])
    return [
        f"From the lightest to the deepest press, the base model's half-width goes from {light_mm:.2g} mm to "
        f"{deep_mm:.2g} mm, and its opacity is multiplied by {opacity:.3g} ± {opacity * error:.1g}."
    ]


def _without_measured_paths(table: pa.Table) -> pa.Table:
    return table.drop_columns([name for name in ("measured_path",) if name in table.schema.names])


def _usable(table: pa.Table, whose: str) -> tuple[Measured, list[str]]:
    """The strokes of a table, and sentences on what was left out."""
    sound = usable_rows(table)
    return load_measured(sound.table), [whose + line for line in sound.sentences()]


def diagnose_in_rounds(
    table: pa.Table,
    out: Path,
    rounds: int,
    *,
    diagnosed: Callable[[pa.Table, str | None], StrokeResult],
    made: Callable[[pa.Table, pa.Table, int], pa.Table],
    log: Callable[[str], None],
) -> StrokeResult:
    """Diagnose a table, and while a named cause has rivals add strokes to it, at most ``rounds`` times.

    ``out`` holds the last diagnosis, and ``out/strokes`` its table if that grew.

    Args:
        table: rows of the strokes contract.
        out: where ``diagnosed`` writes.
        rounds: at most.
        diagnosed: diagnoses a table with a note on how it grew, and writes the result.
        made: rows of the proposed actions (as in ``next_actions.parquet``), given the table so far and the round's
            number.
        log: gets a line for each round, and the reason for stopping.

    Returns:
        The last diagnosis.
    """
    found = diagnosed(table, None)
    recorded = table.num_rows
    for number in range(1, rounds + 1):
        rivals = _open_questions(found)
        if not rivals:
            log("No named cause has rivals: no more strokes are needed.")
            break
        actions = pq.read_table(out / NEXT_ACTIONS)
        if actions.num_rows == 0:
            log("No strokes are proposed that could tell the rivals apart.")
            break
        log(f"Round {number}: {actions.num_rows} strokes to separate {', '.join(rivals)}.")
        rows = made(actions, table, number)
        if lost := _not_recorded(rows, table):
            log(f"The robot does not record {', '.join(lost)}: causes that depend on it are no longer observable.")
        table = pa.concat_tables([table, rows])
        card = f"# Strokes of a diagnosis\n\n{recorded} rows as given, {table.num_rows - recorded} added.\n"
        write_table(out / STROKES, table, CONTRACT, card)
        added = f"{table.num_rows - recorded} of the strokes were collected as proposed"
        found = diagnosed(table, f"{added}, in {count(number, 'round')}.")
    return found


def _open_questions(found: StrokeResult) -> list[str]:
    """Established or suspected causes with rivals that are not established themselves."""
    named = {finding.cause for finding in found.established}
    findings = (*found.established, *found.suspected)
    pairs = [(finding.cause, rival) for finding in findings for rival in finding.rivals]
    return [f"{cause} from {rival}" for cause, rival in pairs if rival not in named]


def _not_recorded(rows: pa.Table, table: pa.Table) -> list[str]:
    """Columns with values in the table and none in the new rows, identities left out."""
    return [
        name
        for name in table.schema.names
        if not name.endswith("_id") and rows[name].null_count == rows.num_rows and table[name].null_count < len(table)
    ]
