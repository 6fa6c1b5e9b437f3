"""The report's last section: what the lean runner painted from the bundle."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

from pentimento.contracts.errors import ContractError
from pentimento.report.html import Album, row, table
from pentimento.report.wording import count, decimal, percent


@dataclass(frozen=True, eq=False)
class PerformanceInputs:
    """One painting of the runner."""

    name: str
    metrics: dict[str, Any]
    goal: bytes
    """PNG, as the two below."""
    plan: bytes
    canvas: bytes


def read_performances(folder: Path) -> list[PerformanceInputs]:
    """Read the folder that the stage run_bundle wrote.

    Raises:
        ContractError: the metrics or a picture are missing.
    """
    try:
        metrics = json.loads((folder / "metrics.json").read_text(encoding="utf-8"))
        return [
            PerformanceInputs(
                name, told, *((folder / name / f"{part}.png").read_bytes() for part in ("goal", "plan", "canvas"))
            )
            for name, told in metrics.items()
        ]
    except (OSError, ValueError, AttributeError) as error:
        raise ContractError(
            f"{folder} holds no paintings of the runner ({error}); run the stage run_bundle."
        ) from error


def performances_section(performances: Sequence[PerformanceInputs], album: Album) -> str:
    """HTML of the section; its pictures go into the album."""
    return f"""<section id="runner">
<h2>On the robot</h2>
<p>Everything that execution needs is exported into a bundle: the stroke models with what extends them, each objective
with its gradient, and the goal planner, as graphs that were compared with PyTorch. A lean runner checks the bundle,
looks, plans, paints and replans by gradient in a process in which PyTorch was never loaded. These are its paintings in
the studio.</p>
{"".join(_of_painting(inputs, album) for inputs in performances)}
{_errors(performances)}
</section>"""


def _of_painting(inputs: PerformanceInputs, album: Album) -> str:
    words, name = inputs.metrics["words"], inputs.name
    asked = "a photograph" if words is None else f"“{escape(words)}”"
    goal = "The photograph." if words is None else f"The goal for {asked}."
    strokes = count(inputs.metrics["strokes"], "stroke")
    pictures = (
        ("goal", inputs.goal, f"What the runner aims at in the painting {name}.", goal),
        ("plan", inputs.plan, f"What its first plan foretells in the painting {name}.", "Foretold by the first plan."),
        ("canvas", inputs.canvas, f"The runner’s painting {name}.", f"The painting: {strokes}."),
    )
    shown = [album.photo(f"runner_{name}_{part}.png", data, alt, caption) for part, data, alt, caption in pictures]
    return f"<h3>From {asked}</h3>\n{row(shown)}"


def _errors(performances: Sequence[PerformanceInputs]) -> str:
    rows = []
    for inputs in performances:
        told, beside = inputs.metrics, inputs.metrics.get("workshop")
        rows.append([
            escape(inputs.name), str(told["strokes"]), decimal(told["error"]["plan"], 5),
            decimal(told["error"]["canvas"], 5), "–" if beside is None else decimal(beside["error"], 5),
            "–" if beside is None else percent(told["error"]["canvas"] / beside["error"] - 1),
        ])  # fmt: skip
    head = ["painting", "strokes", "plan", "painting", "the workshop’s", "difference"]
    return table(head, rows, "Error against the goal, by the print objective. The workshop’s sheet is another one.")
