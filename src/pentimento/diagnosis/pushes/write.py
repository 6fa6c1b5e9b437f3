"""Everything that a diagnosis of pushes leaves behind, in one folder: used by the command line and by the pipeline."""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from pentimento.contracts.atomic import atomic_write
from pentimento.diagnosis.pushes.diagnose import PushDiagnosis, diagnose
from pentimento.diagnosis.pushes.measured import PIXELS_PER_M, MeasuredPushes, measure
from pentimento.diagnosis.pushes.next_pushes import as_table, proposal_for
from pentimento.diagnosis.pushes.out_of_distribution import gap_closed_on
from pentimento.diagnosis.pushes.page import build_page
from pentimento.diagnosis.pushes.screening import survey
from pentimento.diagnosis.verdict import NEXT_ACTIONS, PUSHES, verdict
from pentimento.dynamics.pushes.analytic import model_as_json
from pentimento.dynamics.pushes.measured import load_pushes
from pentimento.dynamics.pushes.mechanisms import VOCABULARY
from pentimento.dynamics.pushes.mechanisms.mechanism import NotObservable


def write_push_diagnosis(
    table: pa.Table,
    out: Path,
    seed: int,
    log: Callable[[str], None],
    outside: pa.Table | None = None,
    left_out: str | None = None,
) -> PushDiagnosis:
    """Diagnose rows of the pushes contract and write what was found into the folder ``out``.

    ``verdict.json`` (schema 1, errors in mm²), ``report.html`` and ``figures/``, ``extended_model.json``,
    ``next_actions.parquet``. Each file is whole or not there; the verdict comes last. Nothing is written when the rows
    allow no diagnosis.

    Args:
        table: rows that keep the contract, all of them pushes; those of which no sample can be made are left out.
        out: made where it is missing; other files in it stay.
        seed: of splits, bootstraps and the next actions.
        log: gets a line now and then.
        outside: another table, on which the share of the gap that is closed is measured, too.
        left_out: a sentence on rows that were left out before.

    Raises:
        ContractError: pinches, too few rows, or more than 1 % of them cannot be used (it names them).
    """
    measured, notes = usable(table)
    notes = ([left_out] if left_out else []) + notes
    for note in notes:
        log(note)
    elsewhere = None if outside is None else usable(outside, measured.scene.half_width_m)
    found = diagnose(measured, VOCABULARY, seed, log)
    shifted = None
    if elsewhere is not None:
        notes += ["Of the outside table: " + line for line in elsewhere[1]]
        try:
            shifted = gap_closed_on(elsewhere[0], found, seed)
            if shifted is None:
                notes.append("On the outside table the base model has no known gap above a noise floor.")
        except NotObservable as reason:
            notes.append(f"The extended model cannot be tested on the outside table: {reason}.")
    log("drawing the report")
    seen = survey(found)
    proposal = proposal_for(found, seen, seed)
    actions = len(set(measured.action.tolist()))
    result = verdict(found, len(measured), actions, shifted, notes, kind=PUSHES)
    written = build_page(found, seen, proposal, result)
    parquet = io.BytesIO()
    pq.write_table(as_table(proposal), parquet, compression="zstd")
    written[NEXT_ACTIONS] = parquet.getvalue()
    written["extended_model.json"] = _json(model_as_json(found.extended, measured.scene.half_width_m))
    written["verdict.json"] = _json(result)
    for name, data in written.items():
        atomic_write(out / name, data)
    return found


def usable(table: pa.Table, half_width_m: float | None = None) -> tuple[MeasuredPushes, list[str]]:
    """The pushes of a table, and sentences on what was repaired or left out."""
    samples, repairs = load_pushes(table, PIXELS_PER_M)
    return measure(samples, half_width_m), repairs.sentences()


def _json(content: object) -> bytes:
    return (json.dumps(content, indent=1, allow_nan=False) + "\n").encode()
