"""Files of a push diagnosis, its out-of-distribution evaluation, and the validated correction of a push network."""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from pentimento.contracts.atomic import atomic_write
from pentimento.diagnosis.pushes.diagnose import PushDiagnosis, diagnose
from pentimento.diagnosis.pushes.fit import fit
from pentimento.diagnosis.pushes.floor import noise_floor
from pentimento.diagnosis.pushes.jacobian import action_losses
from pentimento.diagnosis.pushes.measured import PIXELS_PER_M, MeasuredPushes, cropped, measure
from pentimento.diagnosis.pushes.next_pushes import as_table, proposal_for, screen
from pentimento.diagnosis.pushes.page import build_page
from pentimento.diagnosis.verdict import NEXT_ACTIONS, PUSHES, verdict
from pentimento.dynamics.pushes.analytic import model_as_json
from pentimento.dynamics.pushes.analytic_correction import Correction, split_hidden
from pentimento.dynamics.pushes.measured import PushSamples, load_pushes
from pentimento.dynamics.pushes.mechanisms import VOCABULARY
from pentimento.dynamics.pushes.mechanisms.mechanism import NotObservable

Array = NDArray[Any]


def write_push_diagnosis(
    table: pa.Table,
    out: Path,
    seed: int,
    *,
    log: Callable[[str], None],
    outside: pa.Table | None = None,
    left_out: str | None = None,
) -> PushDiagnosis:
    """Diagnose rows of the pushes contract and write the result into the folder ``out``.

    Files: ``verdict.json`` (schema 1, errors in mm²), ``report.html`` and ``figures/``, ``extended_model.json``,
    ``next_actions.parquet``. Each is written atomically; the verdict comes last. Nothing is written when the rows allow
    no diagnosis.

    Args:
        table: rows that keep the contract, all of them pushes; unusable rows are left out.
        out: created if it is missing; other files in it stay.
        seed: of splits, bootstraps and the next actions.
        log: receives progress messages.
        outside: another table, on which the fraction of the gap closed is measured as well.
        left_out: a sentence on rows that were left out before.

    Raises:
        ContractError: there are pinches, too few rows, or more than 1 % unusable rows (it names them).
    """
    measured, notes = usable(table)
    notes = ([left_out] if left_out else []) + notes
    for note in notes:
        log(note)
    other = None if outside is None else usable(outside, measured.scene.half_width_m)
    found = diagnose(measured, VOCABULARY, seed, log=log)
    other_gap_closed = None
    if other is not None:
        notes += ["Of the outside table: " + line for line in other[1]]
        try:
            other_gap_closed = out_of_distribution_gap_closed(other[0], found, seed)
            if other_gap_closed is None:
                notes.append("On the outside table the base model has no known gap above a noise floor.")
        except NotObservable as reason:
            notes.append(f"The extended model cannot be tested on the outside table: {reason}.")
    log("drawing the report")
    screening = screen(found)
    proposal = proposal_for(found, screening, seed)
    actions = len(set(measured.action.tolist()))
    result = verdict(found, len(measured), actions, shifted=other_gap_closed, notes=notes, kind=PUSHES)
    files = build_page(found, screening, proposal, result)
    parquet = io.BytesIO()
    pq.write_table(as_table(proposal), parquet, compression="zstd")
    files[NEXT_ACTIONS] = parquet.getvalue()
    files["extended_model.json"] = _json(model_as_json(found.extended, measured.scene.half_width_m))
    files["verdict.json"] = _json(result)
    for name, data in files.items():
        atomic_write(out / name, data)
    return found


def usable(table: pa.Table, half_width_m: float | None = None) -> tuple[MeasuredPushes, list[str]]:
    """The pushes of a table, and sentences on repairs and left-out rows."""
    samples, repairs = load_pushes(table, PIXELS_PER_M)
    return measure(samples, half_width_m), repairs.sentences()


def _json(content: object) -> bytes:
    return (json.dumps(content, indent=1, allow_nan=False) + "\n").encode()


def out_of_distribution_gap_closed(outside: MeasuredPushes, diagnosis: PushDiagnosis, seed: int) -> float | None:
    """Fraction of the gap above the noise floor that the extension closes on other pushes.

    None where the floor is unknown, or no gap is above it. ``outside`` has the same half-width of the footprint as the
    diagnosed pushes.

    Raises:
        NotObservable: the table lacks a column that the extended model depends on.
    """
    outside = diagnosis.learned_residual.of(outside)
    before, after = (float(action_losses(m, outside).mean()) for m in (diagnosis.base, diagnosis.extended))
    floor = noise_floor(diagnosis.extended, outside, seed) or diagnosis.floor
    if floor is None or before <= floor.mse:
        return None
    return (before - after) / (before - floor.mse)


class ValidatedCorrection(NamedTuple):
    """Result of a validation. Errors are mean squared, mm², over windows around the pushes."""

    correction: Correction | None
    """None where it does not lower the error, or no established cause is hidden from the network."""
    causes: tuple[str, ...]
    """Hidden causes that were tried."""
    deciding: tuple[float, float] | None
    """Error of the network alone and corrected, on the half of the held-out actions that decides."""
    held_out: tuple[float, float]
    """The same on the other half: alone, and as it is used for planning."""


def validate_correction(
    diagnosis: PushDiagnosis, samples: PushSamples, predicted: Array, *, held_out: Array, seed: int
) -> ValidatedCorrection:
    """Fit the established causes to the network's training pushes, and validate the correction on held-out ones.

    Args:
        diagnosis: of the same rows.
        samples: whole scans, on the diagnosis's pixels.
        predicted: heights [N, H, W] that the network predicts, metres, on the same pixels (``averaged``).
        held_out: numbers of the actions that the network was not trained on.
        seed: of the halves.
    """
    measured = diagnosis.measured
    unseen = np.isin(measured.action, held_out)
    deciding_actions = np.random.default_rng([seed, 16]).permutation(held_out)[: len(held_out) // 2]
    deciding = np.isin(measured.action, deciding_actions)
    after = cropped(samples._replace(after=predicted.astype(np.float32))).after
    alone = _row_errors(after, measured)
    trained = measured.pick(np.flatnonzero(~unseen))
    models = split_hidden(diagnosis.extended, lambda model: fit(model, trained))
    rest = unseen & ~deciding
    if models is None:
        return ValidatedCorrection(None, (), None, (float(alone[rest].mean()),) * 2)
    typical = {name: float(np.nanmean(v)) for name, v in measured.scene.covariates.items() if np.isfinite(v).any()}
    correction = Correction(*models, measured.scene.half_width_m, typical)
    with_it = _row_errors(after + correction.of(measured.scene), measured)
    errors = float(alone[deciding].mean()), float(with_it[deciding].mean())
    kept = errors[1] < errors[0]
    causes = tuple(m.cause for m in models[0].mechanisms if m.cause not in {one.cause for one in models[1].mechanisms})
    planned = with_it if kept else alone
    return ValidatedCorrection(
        correction if kept else None, causes, errors, (float(alone[rest].mean()), float(planned[rest].mean()))
    )


def averaged(height_m: Array, pixels_per_m: float) -> Array:
    """Heights [N, H, W] on the pixels of a diagnosis, means over blocks as in ``load_pushes``."""
    factor = max(round(pixels_per_m / PIXELS_PER_M), 1)
    rows, columns = (side // factor for side in height_m.shape[1:])
    blocks = height_m[:, : rows * factor, : columns * factor].reshape(-1, rows, factor, columns, factor)
    return np.asarray(blocks.mean(axis=(2, 4)))


def _row_errors(after: Array, measured: MeasuredPushes) -> Array:
    """Mean squared error of each row, mm² [B]."""
    error = np.where(measured.valid, (measured.samples.after - after) * 1e3, 0.0)
    return np.asarray(np.square(error).sum((1, 2)) / measured.valid.sum((1, 2)))
