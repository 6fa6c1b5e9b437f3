"""The report's section on the diagnosis of the stroke models: each tool's verdict and its figures."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from markupsafe import Markup

from pentimento.contracts.errors import ContractError
from pentimento.report.html import Album, bar
from pentimento.report.templates import render
from pentimento.report.wording import percent

_FIGURES = ("leave_one_out", "strokes", "residual_stroke", "modes")


@dataclass(frozen=True, eq=False)
class DiagnosisInputs:
    """The diagnosis of one tool's model."""

    tool: str
    verdict: dict[str, Any]
    figures: dict[str, bytes]
    """PNG by name; a diagnosis has some of `_FIGURES`."""


def read_diagnosis(tool: str, folder: Path) -> DiagnosisInputs:
    """Read the folder that a diagnosis wrote: ``verdict.json`` and ``figures/``.

    Raises:
        ContractError: the verdict is missing, not JSON, or of another schema.
    """
    path = folder / "verdict.json"
    try:
        verdict = json.loads(path.read_text(encoding="utf-8"))
        if verdict["schema"] != 2:
            raise ValueError(f"schema {verdict['schema']}, not 2")
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ContractError(f"{path} is not a verdict ({error}); run the stage diagnose_gap again.") from error
    drawn = {name: folder / "figures" / f"{name}.png" for name in _FIGURES}
    return DiagnosisInputs(tool, verdict, {name: file.read_bytes() for name, file in drawn.items() if file.exists()})


def diagnoses_section(diagnoses: Sequence[DiagnosisInputs], album: Album) -> Markup:
    """HTML of the section; its pictures go into the album."""
    return render("report/diagnoses.html", album=album, tools=[_values(inputs) for inputs in diagnoses])


def _values(inputs: DiagnosisInputs) -> dict[str, Any]:
    verdict = inputs.verdict
    return {
        "name": inputs.tool,
        "figures": inputs.figures,
        "text": verdict["text"],
        "rows": _cause_rows(verdict),
        "actions": verdict["actions"],
        "base": verdict["mse"]["base"],
        "extended": verdict["mse"]["extended"],
        "floor": verdict["mse"]["floor"],
        "closed": verdict["gap_closed"]["test"],
    }


def _cause_rows(verdict: dict[str, Any]) -> list[tuple[str, ...]]:
    return [
        (
            entry["cause"],
            f"{status} ({entry['probability']:.2f})",
            Markup(percent(entry["gain"]) + bar(entry["gain"])),
            "\u00a0… ".join(percent(bound) for bound in entry["gain_ci"]),
            Markup("<br>").join(f"{name} {_with_error(value)}" for name, value in entry["parameters"].items()),
            ", ".join(entry["rivals"]) or "none",
        )
        for status in ("established", "suspected")
        for entry in verdict[status]
    ]


def _with_error(parameter: dict[str, float]) -> str:
    return f"{parameter['value']:.3g} ± {parameter['se']:.1g}".replace("-", "−")
