"""Everything that a diagnosis leaves behind, in one folder: used by the command line and by the pipeline."""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from pentimento.contracts.atomic import atomic_write
from pentimento.diagnosis.page import build_page
from pentimento.diagnosis.strokes.diagnose import Diagnosis, diagnose
from pentimento.diagnosis.strokes.measured import Measured, load_measured
from pentimento.diagnosis.strokes.model_file import model_as_json
from pentimento.diagnosis.strokes.next_actions import as_table, proposal_for
from pentimento.diagnosis.strokes.out_of_distribution import gap_closed_on, paints_of
from pentimento.diagnosis.strokes.quarantine import sound_rows
from pentimento.diagnosis.strokes.screening import survey
from pentimento.diagnosis.strokes.user_baseline import given_on
from pentimento.diagnosis.strokes.verdict import NEXT_ACTIONS, verdict
from pentimento.dynamics.strokes.mechanisms import VOCABULARY
from pentimento.dynamics.strokes.simulation import NotObservable
from pentimento.dynamics.strokes.traj2stroke import Traj2StrokeParameters


def write_diagnosis(
    table: pa.Table,
    out: Path,
    seed: int,
    log: Callable[[str], None],
    outside: pa.Table | None = None,
    left_out: str | None = None,
    given: Traj2StrokeParameters | None = None,
) -> Diagnosis:
    """Diagnose rows of the strokes contract and write what was found into the folder ``out``.

    ``verdict.json`` (schema 1), ``report.html`` and ``figures/``, ``extended_model.json``, ``next_actions.parquet``.
    Each file is whole or not there; the verdict comes last. Nothing is written when the rows allow no diagnosis.

    Args:
        table: rows that keep the contract; those of which no sample can be made are left out.
        out: made where it is missing; other files in it stay.
        seed: of splits, bootstraps and the next actions.
        log: gets a line now and then.
        outside: another table, on which the share of the gap that is closed is measured, too.
        left_out: a sentence on rows that were left out before.
        given: a stroke model whose error on sealed strokes is told beside that of the finder's own base.

    Raises:
        ContractError: too few rows, or more than 1 % of them cannot be used (it names them).
    """
    measured, notes = _usable(table, "")
    notes = ([left_out] if left_out else []) + notes
    for note in notes:
        log(note)
    elsewhere = None if outside is None else _usable(outside, "Of the outside table: ")
    found = diagnose(measured, VOCABULARY, seed, log)
    shifted = None
    if elsewhere is not None:
        notes += elsewhere[1]
        try:
            shifted = gap_closed_on(elsewhere[0], found, paints_of(measured), seed)
            if shifted is None:
                notes.append("On the outside table the base model has no known gap above a noise floor.")
        except NotObservable as reason:
            notes.append(f"The extended model cannot be tested on the outside table: {reason}.")
    log("drawing the report")
    seen = survey(found)
    proposal = proposal_for(found, seen, seed)
    beside = None if given is None else given_on(given, seen.test_split)
    actions = len(set(measured.action.tolist()))
    result = verdict(found, len(measured), actions, shifted, notes, beside and beside.mse)
    written = build_page(found, seen, proposal, result, beside)
    parquet = io.BytesIO()
    pq.write_table(as_table(proposal, measured), parquet, compression="zstd")
    written[NEXT_ACTIONS] = parquet.getvalue()
    written["extended_model.json"] = _json(model_as_json(found.extended, paints_of(measured)))
    written["verdict.json"] = _json(result)
    for name, data in written.items():
        atomic_write(out / name, data)
    return found


def _usable(table: pa.Table, whose: str) -> tuple[Measured, list[str]]:
    """The strokes of a table, and sentences on what was left out."""
    sound = sound_rows(table)
    return load_measured(sound.table), [whose + line for line in sound.sentences()]


def _json(content: object) -> bytes:
    return (json.dumps(content, indent=1, allow_nan=False) + "\n").encode()
