"""The verdict on a problem: numbers, evidence and one paragraph."""

from __future__ import annotations

from typing import Any

from pentimento.diagnosis.engine.diagnose import Finding, Result
from pentimento.diagnosis.engine.problem import M

SCHEMA = 1


def verdict(result: Result[M], unit: str) -> dict[str, Any]:
    """The content of ``verdict.json``. Errors are those of the test split in ``unit``; unknown values are None.

    Args:
        result: of ``diagnose``.
        unit: of mean squared errors.
    """
    floor, closed = result.floor, result.gap_closed
    extended = float(result.extended_losses.mean())
    return {
        "schema": SCHEMA,
        "mse": {
            "base": float(result.base_losses.mean()),
            "extended": extended,
            "floor": floor and floor.mse,
            "floor_ci": floor and list(floor.interval),
            "unit": unit,
        },
        "established": [_entry(finding) for finding in result.established],
        "suspected": [_entry(finding) for finding in result.suspected],
        "gap_closed": {"test": closed and closed[0], "ci": closed and list(closed[1])},
        "unexplained": [left._asdict() for left in result.structure.unexplained],
        "floor_reached": floor and floor.interval[0] <= extended <= floor.interval[1],
        "sentence": sentence(result, unit),
    }


def _entry(finding: Finding) -> dict[str, Any]:
    return {
        "cause": finding.cause,
        "probability": finding.probability,
        "gain": finding.gain,
        "gain_ci": list(finding.gain_interval),
        "parameters": {name: {"value": value, "se": error} for name, (value, error) in finding.values.items()},
        "evidence": finding.evidence._asdict(),
    }


def sentence(result: Result[M], unit: str) -> str:
    """The verdict as one paragraph."""
    base, extended, floor = result.base_losses.mean(), result.extended_losses.mean(), result.floor
    parts = [f"On the test split the base model has an error of {base:.3g} (mean squared, {unit})."]
    if result.established:
        parts.append(f"Established: {'; '.join(_named(f) for f in result.established)}.")
        parts.append(f"With that the error is {extended:.3g}.")
    else:
        parts.append("No known cause is established.")
    if result.suspected:
        parts.append(f"Suspected: {'; '.join(_named(f) for f in result.suspected)}.")
    if floor is None:
        parts.append("No action is repeated often enough, so the noise floor is unknown.")
    else:
        parts.append(f"The noise floor, from repeated actions, is {floor.mse:.3g}.")
        if result.established and result.gap_closed is not None:
            parts.append(f"{result.gap_closed[0]:.0%} of the gap above it is closed.")
    if result.structure.unexplained:
        left = result.structure.unexplained[0]
        parts.append(f"Structured residual: {left.mode} depends on {left.covariate}; no established cause explains it.")
    elif floor is not None and extended > floor.interval[1]:
        parts.append("Gap above the floor, cause not observable in what was recorded.")
    return " ".join(parts)


def _named(finding: Finding) -> str:
    numbers = ", ".join(f"{name} {value:.3g} ± {error:.1g}" for name, (value, error) in finding.values.items())
    return f"{finding.cause} (probability {finding.probability:.3g}; {numbers}; removes {finding.gain:.0%} of the gap)"
