"""The report's last section: what the lean runner painted and sculpted from the bundle."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

from pentimento.contracts.errors import ContractError
from pentimento.report.html import Album, row, table
from pentimento.report.wording import count, decimal, lowered, percent

_PAINT = ("goal", "plan", "canvas")
_CLAY = {
    "before": ("The {material} before the letter {letter}.", "Before."),
    "goal": ("The goal: the letter {letter} in the {material}.", "The goal, fitted to the clay at hand."),
    "result": ("The letter {letter} in the {material} as the runner left it.", "The sculpture."),
}


@dataclass(frozen=True, eq=False)
class PaintingInputs:
    """One painting of the runner."""

    name: str
    metrics: dict[str, Any]
    goal: bytes
    """PNG, as the two below."""
    plan: bytes
    canvas: bytes


@dataclass(frozen=True, eq=False)
class CarvingInputs:
    """One sculpture of the runner."""

    name: str
    metrics: dict[str, Any]
    pictures: dict[str, bytes]
    """PNG photographs of the clay: before, goal, result."""


PerformanceInputs = PaintingInputs | CarvingInputs


def read_performances(folder: Path) -> list[PerformanceInputs]:
    """Read the folder that the stage run_bundle wrote: paintings, then sculptures.

    Raises:
        ContractError: the metrics or a picture are missing.
    """
    try:
        painted = json.loads((folder / "metrics.json").read_text(encoding="utf-8"))
        carved = json.loads((folder / "sculptures.json").read_text(encoding="utf-8"))
        paintings = [PaintingInputs(name, told, *_pictures(folder / name, _PAINT)) for name, told in painted.items()]
        carvings = [
            CarvingInputs(name, told, dict(zip(_CLAY, _pictures(folder / name, _CLAY), strict=True)))
            for name, told in carved.items()
        ]
    except (OSError, ValueError, AttributeError) as error:
        raise ContractError(
            f"{folder} holds no paintings and sculptures of the runner ({error}); run the stage run_bundle."
        ) from error
    return [*paintings, *carvings]


def performances_section(performances: Sequence[PerformanceInputs], album: Album) -> str:
    """HTML of the section; its pictures go into the album."""
    paintings = [inputs for inputs in performances if isinstance(inputs, PaintingInputs)]
    carvings = [inputs for inputs in performances if isinstance(inputs, CarvingInputs)]
    return f"""<section id="runner">
<h2>On the robot</h2>
<p>Everything that execution needs is exported into a bundle: the stroke models with what extends them, each objective
with its gradient, and the goal planner, as graphs that were compared with PyTorch. A lean runner checks the bundle,
looks, plans, paints and replans by gradient in a process in which PyTorch was never loaded. These are its paintings in
the studio, and what it sculpted there.</p>
{"".join(_of_painting(inputs, album) for inputs in paintings)}
{_errors(paintings)}
{"".join(_of_carving(inputs, album) for inputs in carvings)}
</section>"""


def _pictures(folder: Path, parts: Iterable[str]) -> list[bytes]:
    return [(folder / f"{part}.png").read_bytes() for part in parts]


def _of_painting(inputs: PaintingInputs, album: Album) -> str:
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


def _of_carving(inputs: CarvingInputs, album: Album) -> str:
    told = inputs.metrics
    words = {"material": told["material"], "letter": told["letter"]}
    shown = [
        album.photo(f"runner_{inputs.name}_{part}.png", inputs.pictures[part], alt.format(**words), caption)
        for part, (alt, caption) in _CLAY.items()
    ]
    height, slope = told["error_3d_mm2"], told["visual_error"]
    return f"""<h3>The letter {escape(told["letter"])} in {escape(told["material"])}</h3>
<p>By {count(told["actions"], "action")}, planned anew every few upon a scan of the clay. They
{lowered("the error in height", 1 - height["after"] / height["before"])}, from {decimal(height["before"])} to
{decimal(height["after"])} mm², and {lowered("that in slope", 1 - slope["after"] / slope["before"])}.
Nothing done leaves both as they were.</p>
{row(shown)}"""


def _errors(paintings: Sequence[PaintingInputs]) -> str:
    rows = []
    for inputs in paintings:
        told, beside = inputs.metrics, inputs.metrics.get("workshop")
        rows.append([
            escape(inputs.name), str(told["strokes"]), decimal(told["error"]["plan"], 5),
            decimal(told["error"]["canvas"], 5), "–" if beside is None else decimal(beside["error"], 5),
            "–" if beside is None else percent(told["error"]["canvas"] / beside["error"] - 1),
        ])  # fmt: skip
    head = ["painting", "strokes", "plan", "painting", "the workshop’s", "difference"]
    return table(head, rows, "Error against the goal, by the print objective. The workshop’s sheet is another one.")
