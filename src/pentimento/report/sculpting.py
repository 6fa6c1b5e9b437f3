"""The report's section on sculpting in one material: push model, diagnosis and sculptures."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from markupsafe import Markup

from pentimento.contracts.errors import ContractError
from pentimento.report.figures import BLUE, OCHRE, Series, line_chart
from pentimento.report.html import Album, bar
from pentimento.report.templates import render
from pentimento.report.wording import decimal, percent

_PARTS = ("before", "goal", "plan", "result")


@dataclass(frozen=True, eq=False)
class SculptureInputs:
    """The sculptures in one material and its push model."""

    material: str
    goals: dict[str, dict[str, Any]]
    """metrics.json of the stage sculpt by goal, in the order of execution."""
    pictures: dict[str, dict[str, bytes]]
    """PNG by goal and by its part, one of `_PARTS`."""
    time_lapse: bytes
    """GIF."""
    model: dict[str, Any]
    """metrics.json of the push model."""
    held_out: bytes
    """PNG: held-out pushes as measured and as predicted."""
    verdict: str
    """The verdict on an analytic push model, one sentence."""
    diagnosed: bool
    """Whether there is a report of the diagnosis; of pinches there is none."""


def read_sculpture(material: str, folder: Path, weights: Path, gap: Path) -> SculptureInputs:
    """Read the output of the stage sculpt, the scores of the material's push model, and its diagnosis.

    Raises:
        ContractError: metrics or a picture are missing.
    """
    try:
        goals = json.loads((folder / "metrics.json").read_text(encoding="utf-8"))
        ordered = {name: goals[name] for name in sorted(goals, key=lambda name: int(name.partition("_")[0]))}
        pictures = {name: {part: (folder / name / f"{part}.png").read_bytes() for part in _PARTS} for name in ordered}
        lapse = (folder / "time_lapse.gif").read_bytes()
        model = json.loads((weights / "metrics.json").read_text(encoding="utf-8"))
        held_out = (weights / "held_out.png").read_bytes()
        verdict = str(json.loads((gap / "verdict.json").read_text(encoding="utf-8"))["text"])
    except (OSError, ValueError, AttributeError, KeyError, TypeError) as error:
        raise ContractError(
            f"{folder}, {weights} and {gap} hold no sculpture with its push model and diagnosis ({error}); run the "
            "stages train_push_dynamics, diagnose_pushes and sculpt."
        ) from error
    diagnosed = (gap / "report.html").is_file()
    return SculptureInputs(material, ordered, pictures, lapse, model, held_out, verdict, diagnosed)


def sculpting_section(inputs: SculptureInputs, album: Album) -> Markup:
    """HTML of the section; its pictures go into the album."""
    return render(
        "report/sculpting.html",
        album=album,
        inputs=inputs,
        model_rows=_model_rows(inputs.model),
        last_result=inputs.pictures[list(inputs.goals)[-1]]["result"],
        goals=[_goal_values(name, inputs) for name in inputs.goals],
        result_rows=[_result_row(metrics) for metrics in inputs.goals.values()],
        curve=_curve(inputs),
        pushes=sum(metrics["actions"] for metrics in inputs.goals.values()),
    )


def _model_rows(model: dict[str, Any]) -> list[list[str]]:
    held_out = model["held_out"]
    scores = [
        ("learned model", held_out["model"]),
        ("mean footprint of all pushes", held_out["mean_footprint"]),
        ("no change", held_out["unchanged"]),
    ]
    if "floor" in model:
        scores.append(("repeatability floor", model["floor"]))
    return [[name, decimal(score["l_3d_mm2"]), decimal(score["l_viz"])] for name, score in scores]


def _goal_values(name: str, inputs: SculptureInputs) -> dict[str, Any]:
    metrics = inputs.goals[name]
    return {
        "name": name,
        "title": _title(metrics),
        "pictures": inputs.pictures[name],
        "actions": metrics["actions"],
        "height": metrics["error_3d_mm2"]["removed"],
        "slope": metrics["visual_error"]["removed"],
        "stopped": metrics["stopped"],
        "read": metrics.get("read"),
    }


def _title(metrics: dict[str, Any]) -> str:
    kind, _, name = metrics["source"].partition(":")
    return f"The {kind} {name}" if name and kind in ("letter", "shape") else Path(metrics["source"]).name


def _result_row(metrics: dict[str, Any]) -> list[str]:
    height, slope = metrics["error_3d_mm2"], metrics["visual_error"]
    return [
        _title(metrics),
        decimal(height["before"]),
        decimal(height["planned"]),
        decimal(height["after"]),
        Markup(percent(height["removed"]) + bar(max(height["removed"], 0.0))),
        percent(slope["removed"]),
        str(metrics["actions"]),
    ]


def _curve(inputs: SculptureInputs) -> bytes:
    series: list[Series] = []
    pushes = 0
    for metrics in inputs.goals.values():
        for name, label, colour in (("error_3d_mm2", "height", BLUE), ("visual_error", "slope", OCHRE)):
            values = metrics["curve"][name]
            top = values[0] if values[0] > 0 else 1.0
            actions = [float(pushes + number) for number in range(len(values))]
            series.append(Series(label if pushes == 0 else "", actions, [value / top for value in values], colour))
        pushes += metrics["actions"]
    return line_chart(series, "pushes executed", "error relative to the start", (11, 3))
