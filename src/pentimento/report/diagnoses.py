"""The report's section on the diagnosis of the stroke models: each tool's verdict and its figures."""

from __future__ import annotations

import inspect
import json
import re
import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
from markupsafe import Markup

from pentimento.contracts.errors import ContractError
from pentimento.diagnosis.problem import Quantity
from pentimento.diagnosis.verdict import NEXT_ACTIONS, VERDICT, size
from pentimento.dynamics.strokes.mechanisms import VOCABULARY
from pentimento.report.html import Album, bar
from pentimento.report.templates import render
from pentimento.report.wording import percent

_FIGURES = ("leave_one_out", "strokes", "residual_stroke", "modes", "next_actions")
_KINDS = {kind.cause: kind for kind in VOCABULARY}


@dataclass(frozen=True, eq=False)
class DiagnosisInputs:
    """The diagnosis of one tool's model."""

    tool: str
    verdict: dict[str, Any]
    figures: dict[str, bytes]
    """PNG by name; a diagnosis has some of `_FIGURES`."""
    proposed: Mapping[str, int] = field(default_factory=dict)
    """Number of proposed strokes by what they inform about: a cause, or several joined by " | "."""
    recorded: bool = False
    """Whether the strokes come from a recorded table, and not from the robot in the studio."""


def read_diagnosis(tool: str, folder: Path, *, recorded: bool = False) -> DiagnosisInputs:
    """Read the folder that a diagnosis wrote: ``verdict.json``, ``figures/`` and ``next_actions.parquet``.

    Raises:
        ContractError: the verdict is missing, not JSON, or of another schema.
    """
    path = folder / VERDICT
    try:
        verdict = json.loads(path.read_text(encoding="utf-8"))
        if verdict["schema"] != 2:
            raise ValueError(f"schema {verdict['schema']}, not 2")
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ContractError(f"{path} is not a verdict ({error}); run the stage diagnose_gap again.") from error
    drawn = {name: folder / "figures" / f"{name}.png" for name in _FIGURES}
    figures = {name: file.read_bytes() for name, file in drawn.items() if file.exists()}
    following = folder / NEXT_ACTIONS
    asked = pq.read_table(following, columns=["separates"]).column(0).to_pylist() if following.exists() else []
    return DiagnosisInputs(tool, verdict, figures, dict(Counter(asked).most_common()), recorded)


def diagnoses_section(diagnoses: Sequence[DiagnosisInputs], album: Album) -> Markup:
    """HTML of the section on the studio's tools, or on recorded ones; its pictures go into the album."""
    words = {word for each in diagnoses for word in re.findall(r"\w+", each.verdict["text"])}
    return render(
        "report/diagnoses.html",
        album=album,
        recorded=diagnoses[0].recorded,
        tools=[_values(inputs) for inputs in diagnoses],
        meanings=[(cause, _meaning(cause)) for cause in sorted(words & _KINDS.keys())],
    )


def _values(inputs: DiagnosisInputs) -> dict[str, Any]:
    verdict = inputs.verdict
    lines = verdict["text"].splitlines()
    named = [line for line in lines if line.startswith(("Established:", "Suspected:"))]
    undecided = [line for line in lines if line.startswith("Not ")]
    return {
        "name": inputs.tool,
        "figures": inputs.figures,
        "strokes": verdict["rows"],
        "named": _findings(verdict),
        "observed": [line for line in lines if line not in (*named, *undecided)],
        "undecided": undecided,
        "proposed": [(number, question.split(" | ")) for question, number in inputs.proposed.items()],
        "rows": _cause_rows(verdict),
        "actions": verdict["actions"],
        "base": verdict["mse"]["base"],
        "extended": verdict["mse"]["extended"],
        "floor": verdict["mse"]["floor"],
        "closed": verdict["gap_closed"]["test"],
    }


def _findings(verdict: dict[str, Any]) -> list[dict[str, Any]]:
    """The established and the suspected causes, for one sentence each."""
    return [
        entry | {"status": status, "meaning": _meaning(entry["cause"]).rstrip("."), "sizes": _sizes_in_words(entry)}
        for status in ("established", "suspected")
        for entry in verdict[status]
    ]


def _meaning(cause: str) -> str:
    """What a cause is: the first line of the module that implements it, without references to the thesis."""
    line = (inspect.getdoc(sys.modules[_KINDS[cause].__module__]) or "").partition("\n")[0]
    return re.sub(r" \(the thesis.*?\)", "", line)


def _sizes_in_words(entry: dict[str, Any]) -> str:
    """The quantities of a cause that differ from 0."""
    sizes = _sizes(entry)
    return ", ".join([each for each in sizes if not each.endswith(" 0")] or sizes)


def _sizes(entry: dict[str, Any]) -> list[str]:
    """The quantities of a cause with standard errors and units."""
    found = entry["parameters"]
    return [
        size(Quantity(*quantity), found[quantity.name]["value"], found[quantity.name]["se"])
        for quantity in _KINDS[entry["cause"]].quantities
        if quantity.name in found
    ]


def _cause_rows(verdict: dict[str, Any]) -> list[tuple[str, ...]]:
    return [
        (
            entry["cause"],
            f"{status} ({entry['probability']:.2f})",
            Markup(percent(entry["gain"]) + bar(entry["gain"])),
            "\u00a0… ".join(percent(bound) for bound in entry["gain_ci"]),
            Markup("<br>").join(_sizes(entry)),
            ", ".join(entry["rivals"]) or "none",
        )
        for status in ("established", "suspected")
        for entry in verdict[status]
    ]
