"""The report's section on a painting that was planned with a recorded tool's model, and not executed."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from pentimento.contracts.images import encode_png, read_image
from pentimento.contracts.plan import Plan, read_plan
from pentimento.report.figures import stroke_lines
from pentimento.report.files import incomplete, read_json
from pentimento.report.html import Album
from pentimento.report.templates import render

Image = NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class PlanInputs:
    """One tool's plan. Pictures are sRGB uint8 [H, W, 3]."""

    tool: str
    target: Image
    predicted: Image
    plan: Plan
    error: dict[str, float]
    """[`blank` or `plan`] against the target."""
    warnings: list[str]
    """Where the plan leaves what the model was fitted to."""


def read_painting_plan(tool: str, folder: Path) -> PlanInputs:
    """Read the folder that the stage `plan_painting` wrote for a tool.

    Raises:
        ContractError, ImageError: a file is missing or does not hold what it should.
    """
    metrics = read_json(folder / "metrics.json")
    try:
        return PlanInputs(
            tool=tool,
            target=read_image(folder / "target.png"),
            predicted=read_image(folder / "plan.png"),
            plan=read_plan(folder / "plan.jsonl"),
            error={part: metrics["error"][part] for part in ("blank", "plan")},
            warnings=read_json(folder / "warnings.json"),
        )
    except (KeyError, TypeError) as error:
        raise incomplete(folder, error, "plan_painting") from error


def plan_section(inputs: PlanInputs, album: Album) -> Markup:
    """HTML of the section; its pictures go into the album."""
    width_m, height_m = inputs.plan.header.canvas_size_m
    return render(
        "report/plan.html",
        album=album,
        tool=inputs.tool,
        strokes=len(inputs.plan.strokes),
        size=f"{1000 * width_m:.0f} x {1000 * height_m:.0f} mm",
        target=encode_png(inputs.target),
        predicted=encode_png(inputs.predicted),
        lines=stroke_lines(inputs.plan) if inputs.plan.strokes else None,
        share=inputs.error["plan"] / inputs.error["blank"] if inputs.error["blank"] > 0 else 0.0,
        warnings=inputs.warnings,
    )
