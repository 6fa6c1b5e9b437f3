"""The verdict: what was found, as numbers and as a paragraph that a person can read (schema 1)."""

from __future__ import annotations

from typing import Any

from pentimento.gap.diagnose import Diagnosis, Finding

SCHEMA = 1
_SHOWN = 12


def verdict(diagnosis: Diagnosis, rows: int, actions: int) -> dict[str, Any]:
    """What ``verdict.json`` holds. Errors are of sealed strokes: sRGB in [0, 1] squared, over the whole window."""
    floor, closed = diagnosis.floor, diagnosis.gap_closed
    extended = float(diagnosis.extended_losses.mean())
    return {
        "schema": SCHEMA,
        "kind": "strokes",
        "rows": rows,
        "actions": actions,
        "mse": {
            "base": float(diagnosis.base_losses.mean()),
            "extended": extended,
            "floor": floor and floor.mse,
            "floor_ci": floor and list(floor.interval),
        },
        "established": [_entry(finding) for finding in diagnosis.established],
        "suspected": [_entry(finding) for finding in diagnosis.suspected],
        "gap_closed": {"test": closed and closed[0], "ci": closed and list(closed[1]), "shifted": None},
        "unexplained": [left._asdict() for left in diagnosis.unexplained[:_SHOWN]],
        "not_observable": diagnosis.search.not_observable,
        "floor_reached": None if floor is None else floor.interval[0] <= extended <= floor.interval[1],
        "sentence": sentence(diagnosis),
    }


def _entry(finding: Finding) -> dict[str, Any]:
    return {
        "cause": finding.cause,
        "p_adj": finding.p_adjusted,
        "gain": finding.gain,
        "gain_ci": list(finding.gain_interval),
        "parameters": {name: {"value": value, "se": error} for name, (value, error) in finding.values.items()},
        "rivals": list(finding.rivals),
    }


def sentence(diagnosis: Diagnosis) -> str:
    """One paragraph."""
    base, extended = diagnosis.base_losses.mean(), diagnosis.extended_losses.mean()
    said = [f"On sealed strokes the base model misses by {base:.3g} (mean squared, sRGB)."]
    if diagnosis.established:
        named = "; ".join(_named(finding) for finding in diagnosis.established)
        said.append(f"Established: {named}. With that the error is {extended:.3g}.")
    else:
        said.append("No known cause is established.")
    if diagnosis.suspected:
        causes = ", ".join(finding.cause for finding in diagnosis.suspected)
        said.append(f"Suspected, not confirmed on strokes that had no part in the search: {causes}.")
    if diagnosis.floor is None:
        said.append("No action is repeated often enough, so the noise floor is unknown.")
    else:
        said.append(f"The noise floor, from repeated actions, is {diagnosis.floor.mse:.3g}.")
        if diagnosis.gap_closed is not None:
            said.append(f"{diagnosis.gap_closed[0]:.0%} of the gap above it is closed.")
    if diagnosis.unexplained:
        mode, covariate = diagnosis.unexplained[0].mode, diagnosis.unexplained[0].covariate
        said.append(f"Structured residual: {mode} depends on {covariate}; no known cause explains it.")
    elif diagnosis.floor is not None and extended > diagnosis.floor.interval[1]:
        said.append("What remains above the floor depends on nothing that was recorded.")
    return " ".join(said)


def _named(finding: Finding) -> str:
    numbers = ", ".join(f"{name} {value:.3g} ± {error:.1g}" for name, (value, error) in finding.values.items())
    rivals = f"; rivals {', '.join(finding.rivals)}" if finding.rivals else ""
    return f"{finding.cause} ({numbers}; removes {finding.gain:.0%} of the gap{rivals})"
