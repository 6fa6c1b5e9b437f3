"""The verdict of a diagnosis: numbers, evidence and a text (schema 2, docs/diagnosis.md §13)."""

from __future__ import annotations

import io
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from pentimento.contracts.atomic import atomic_write
from pentimento.diagnosis.diagnose import Finding, Result
from pentimento.diagnosis.problem import Cause, M, Quantity

SCHEMA = 2
VERDICT = "verdict.json"
NEXT_ACTIONS = "next_actions.parquet"
"""File with the proposed actions."""
_ZERO = 1e-6
"""Share of its typical size below which a quantity is said to be 0."""


def verdict(
    result: Result[M], *, shifted: float | None = None, notes: Sequence[str] = (), given_mse: float | None = None
) -> dict[str, Any]:
    """The content of ``verdict.json``. Errors are those of the test split, mean squared, in the unit of the problem.

    Unknown values (a floor without repeats, a gap without a floor) are None.

    Args:
        result: of ``diagnose``.
        shifted: fraction of the gap closed on an outside table.
        notes: sentences that are appended: what was left out of the table.
        given_mse: error of a user-supplied baseline model on the test split; becomes ``mse.given``.
    """
    floor, closed, rows = result.floor, result.gap_closed, (result.known.rows, result.test.rows)
    extended = float(result.extended_losses.mean())
    content: dict[str, Any] = {
        "schema": SCHEMA,
        "kind": result.known.kind,
        "rows": sum(len(part.action) for part in rows),
        "actions": sum(len(part.first_of_action) for part in rows),
        "mse": {
            "unit": result.known.unit,
            "base": float(result.base_losses.mean()),
            "extended": extended,
            "floor": floor and floor.mse,
            "floor_ci": floor and list(floor.interval),
        },
        "established": [_entry(finding) for finding in result.established],
        "suspected": [_entry(finding) for finding in result.suspected],
        "gap_closed": {"test": closed and closed[0], "ci": closed and list(closed[1]), "shifted": shifted},
        "unexplained": [left._asdict() for left in result.structure.unexplained],
        "floor_reached": None if floor is None else floor.interval[0] <= extended <= floor.interval[1],
        "text": "\n".join(
            [text(result), *_of_a_given_model(result, given_mse), *_on_an_outside_table(shifted), *notes]
        ),
    }
    if given_mse is not None:
        content["mse"]["given"] = given_mse
    if drift := result.drift:
        content["drift"] = {
            "mode": drift.mode, "p": drift.p, "mse": drift.mse, "mse_of_repeats": drift.mse_of_repeats,
        }  # fmt: skip
    known: dict[str, Any] = _without_nan(content)
    return known


def write_result(
    out: Path, *, page: Mapping[str, bytes], actions: pa.Table, model: Mapping[str, Any], content: Mapping[str, Any]
) -> None:
    """Write a diagnosis into the folder ``out``: each file is complete or absent, and the verdict is the last.

    Args:
        out: created if it is missing; other files in it stay.
        page: ``report.html`` and figures, by path.
        actions: the proposed actions.
        model: the extended model, as JSON.
        content: of ``verdict.json``.
    """
    parquet = io.BytesIO()
    pq.write_table(actions, parquet, compression="zstd")
    files = {**page, NEXT_ACTIONS: parquet.getvalue(), "extended_model.json": _json(model), VERDICT: _json(content)}
    for name, data in files.items():
        atomic_write(out / name, data)


def _json(content: Mapping[str, Any]) -> bytes:
    return (json.dumps(content, indent=1, allow_nan=False) + "\n").encode()


def _entry(finding: Finding) -> dict[str, Any]:
    return {
        "cause": finding.cause,
        "probability": finding.probability,
        "gain": finding.gain,
        "gain_ci": list(finding.gain_interval),
        "parameters": {name: {"value": value, "se": error} for name, (value, error) in finding.values.items()},
        "rivals": list(finding.rivals),
        "evidence": finding.evidence._asdict(),
    }


def text(result: Result[M]) -> str:
    """The verdict in words: a line for each named cause, the errors, and what is left."""
    gap = "gap" if result.floor is not None else "error"
    lines = [
        f"{status}: {_named(finding, result.known.causes[finding.cause], gap)}"
        for status, findings in (("Established", result.established), ("Suspected", result.suspected))
        for finding in findings
    ]
    if not result.established:
        lines.insert(0, "No known cause is established.")
    lines.append(_errors(result))
    if result.structure.unexplained:
        lines.append(_structured(result))
    else:
        if drift := result.drift:
            lines.append(
                f"Temporal drift: {drift.mode} drifts in the order of execution (error {drift.mse:.3g}), and no "
                "recorded covariate correlates with it."
            )
        if result.floor is not None and result.extended_losses.mean() > result.floor.interval[1]:
            lines.append("Gap above the floor, cause not observable in what was recorded.")
    lines += _not_observable(result.known.unobservable)
    findings = (*result.established, *result.suspected)
    rivals = [(finding.cause, rival) for finding in findings for rival in finding.rivals]
    if rivals:
        pairs = ", ".join(f"{cause} from {rival}" for cause, rival in rivals)
        lines.append(f"Not told apart by this table: {pairs}.")
    return "\n".join(lines)


def _errors(result: Result[M]) -> str:
    errors = [f"{result.base_losses.mean():.3g} of the base model"]
    if result.established:
        errors.append(f"{result.extended_losses.mean():.3g} with the established causes")
    if result.floor is not None:
        errors.append(f"{result.floor.mse:.3g} at the noise floor, from repeated actions")
    sentences = [f"Errors on the test split (mean squared, {result.known.unit}): {', '.join(errors)}."]
    if result.floor is None:
        sentences.append("No action is repeated often enough, so the noise floor is unknown.")
    elif result.gap_closed is not None and result.established:
        sentences.append(f"{result.gap_closed[0]:.0%} of the gap is closed.")
    return " ".join(sentences)


def _structured(result: Result[M]) -> str:
    """The strongest unexplained dependence, and the established causes that share its covariate."""
    mode, covariate = result.structure.unexplained[0].mode, result.structure.unexplained[0].covariate
    causes = result.known.causes
    sharing = [name for name in result.extended.causes if covariate in causes[name].covariates]
    known = "established" if result.suspected else "known"
    if sharing:
        beyond = f"beyond its established effect ({', '.join(sharing)}); no other {known} cause explains that"
        return f"Structured residual: {mode} depends on {covariate}, {beyond}."
    return f"Structured residual: {mode} depends on {covariate}; no {known} cause explains it."


def _named(finding: Finding, cause: Cause, gap: str) -> str:
    sizes = [size(q, *finding.values[q.name]) for q in cause.quantities]
    probability = f"probability {finding.probability:.3g}"
    return f"{finding.cause} ({probability}): {', '.join(sizes)}; removes {finding.gain:.0%} of the {gap}."


def size(quantity: Quantity, value: float, error: float) -> str:
    """A quantity with its standard error, lengths in mm: ``x −0.101 ± 0.01 mm``."""
    name, factor, unit = quantity.name, 1.0, quantity.unit
    if unit == "s":
        name = name.removesuffix("_s")
    if unit == "m" or unit.startswith(("m ", "m/")):
        name, factor, unit = name.removesuffix("_m"), 1e3, f"m{unit}"
    if max(abs(value), error) < _ZERO * quantity.typical:
        return f"{name} 0"
    unit = unit.removeprefix("1").replace("/", " per ").strip()
    return f"{name} {factor * value:.3g} ± {factor * error:.1g} {unit}".replace("-", "−").strip()


def _not_observable(reasons: Mapping[str, str]) -> list[str]:
    """One sentence for each reason why causes could not be tested."""
    by_reason: dict[str, list[str]] = {}
    for cause, reason in reasons.items():
        by_reason.setdefault(reason.rstrip("."), []).append(cause)
    return [f"Not decided, because {reason}: {', '.join(causes)}." for reason, causes in by_reason.items()]


def _of_a_given_model(result: Result[M], mse: float | None) -> list[str]:
    """Its error compared with the base, which differs by its free nuisances only."""
    if mse is None:
        return []
    base = float(result.base_losses.mean())
    same = f"The given model has an error of {mse:.3g} on the same {result.known.kind}"
    if base < mse:
        return [f"{same}: {1 - base / mse:.0%} of that is calibration, which the free base removes without any cause."]
    return [f"{same}, no more than the base."]


def _on_an_outside_table(shifted: float | None) -> list[str]:
    return [] if shifted is None else [f"On the outside table {shifted:.0%} of the gap is closed."]


def _without_nan(value: Any) -> Any:
    """The value with None for NaN and infinity, which JSON lacks."""
    if isinstance(value, dict):
        return {name: _without_nan(inner) for name, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_without_nan(inner) for inner in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
