"""Files of a push diagnosis, its out-of-distribution evaluation, and the validated correction of a push network."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pentimento.diagnosis.diagnose import diagnose, gap_closed_on
from pentimento.diagnosis.pushes.fit import fit
from pentimento.diagnosis.pushes.measured import PIXELS_PER_M, MeasuredPushes, cropped, measure
from pentimento.diagnosis.pushes.next_pushes import as_table, proposal_for, screen
from pentimento.diagnosis.pushes.page import build_page
from pentimento.diagnosis.pushes.problem import PushResult, push_problem, with_learned_residual
from pentimento.diagnosis.splits import few_actions
from pentimento.diagnosis.verdict import verdict, write_result
from pentimento.dynamics.pushes.measured import PushSamples, load_pushes
from pentimento.planning.pushes.analytic.correction import Correction, Range, split_hidden
from pentimento.planning.pushes.analytic.mechanisms import VOCABULARY
from pentimento.planning.pushes.analytic.mechanisms.mechanism import NotObservable
from pentimento.planning.pushes.analytic.model import model_as_json

Array = NDArray[Any]


def write_push_diagnosis(
    table: pa.Table,
    out: Path,
    seed: int,
    *,
    log: Callable[[str], None],
    outside: pa.Table | None = None,
    left_out: str | None = None,
) -> PushResult:
    """Diagnose rows of the pushes contract and write the result into the folder ``out``.

    Files: ``verdict.json`` (schema 2, errors in mm²), ``report.html`` and ``figures/``, ``extended_model.json``,
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
    problem = push_problem(measured, VOCABULARY, seed)
    notes += filter(None, [few_actions(problem.rows)])
    result = diagnose(problem, seed=seed, log=log)
    shifted = None
    if other is not None:
        notes += ["Of the outside table: " + line for line in other[1]]
        try:
            outside_problem = replace(problem, measured=other[0])
            shifted = gap_closed_on(outside_problem, result, base=result.base, extended=result.extended)
            if shifted is None:
                notes.append("On the outside table the base model has no known gap above a noise floor.")
        except NotObservable as reason:
            notes.append(f"The extended model cannot be tested on the outside table: {reason}.")
    log("drawing the report")
    screening = screen(result)
    proposal = proposal_for(result, screening, seed)
    content = verdict(result, shifted=shifted, notes=notes)
    write_result(
        out,
        page=build_page(result, screening, proposal, content),
        actions=as_table(proposal),
        model=model_as_json(result.extended.model, measured.scene.half_width_m),
        content=content,
    )
    return result


def usable(table: pa.Table, half_width_m: float | None = None) -> tuple[MeasuredPushes, list[str]]:
    """The pushes of a table, and sentences on repairs and left-out rows."""
    samples, repairs = load_pushes(table, PIXELS_PER_M)
    return measure(samples, half_width_m), repairs.sentences()


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
    result: PushResult, samples: PushSamples, predicted: Array, *, held_out: Array, seed: int
) -> ValidatedCorrection:
    """Fit the established causes to the network's training pushes, and validate the correction on held-out ones.

    Args:
        result: of the diagnosis of the same rows.
        samples: whole scans, on the diagnosis's pixels.
        predicted: heights [N, H, W] that the network predicts, metres, on the same pixels (``averaged``).
        held_out: numbers of the actions that the network was not trained on.
        seed: of the halves.
    """
    measured = with_learned_residual(result)
    unseen = np.isin(measured.action, held_out)
    deciding_actions = np.random.default_rng([seed, 16]).permutation(held_out)[: len(held_out) // 2]
    deciding = np.isin(measured.action, deciding_actions)
    after = cropped(samples._replace(after=predicted.astype(np.float32))).after
    alone = _row_errors(after, measured)
    trained = measured.pick(np.flatnonzero(~unseen))
    models = split_hidden(result.extended.model, lambda model: fit(model, trained))
    rest = unseen & ~deciding
    if models is None:
        return ValidatedCorrection(None, (), None, (float(alone[rest].mean()),) * 2)
    ranges = {
        name: Range(float(np.nanmin(values)), float(np.nanmean(values)), float(np.nanmax(values)))
        for name, values in measured.scene.covariates.items()
        if np.isfinite(values).any()
    }
    correction = Correction(*models, measured.scene.half_width_m, ranges)
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
