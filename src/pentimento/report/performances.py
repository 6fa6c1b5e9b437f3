"""The report's section on execution from the bundle: paintings and sculptures without PyTorch."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from markupsafe import Markup

from pentimento.contracts.errors import ContractError
from pentimento.report.html import Album
from pentimento.report.templates import render
from pentimento.report.wording import decimal, percent

_PAINT = ("goal", "plan", "canvas")
_CLAY = ("before", "goal", "result")


@dataclass(frozen=True, eq=False)
class PerformedPainting:
    """One painting executed from the bundle."""

    name: str
    metrics: dict[str, Any]
    goal: bytes
    """PNG, as the two below."""
    plan: bytes
    canvas: bytes


@dataclass(frozen=True, eq=False)
class PerformedSculpture:
    """One sculpture executed from the bundle."""

    name: str
    metrics: dict[str, Any]
    pictures: dict[str, bytes]
    """PNG photographs of the clay: before, goal, result."""


PerformanceInputs = PerformedPainting | PerformedSculpture


def read_performances(folder: Path) -> list[PerformanceInputs]:
    """Read the folder that the stage run_bundle wrote: paintings, then sculptures.

    Raises:
        ContractError: the metrics or a picture are missing.
    """
    try:
        painted = json.loads((folder / "metrics.json").read_text(encoding="utf-8"))
        carved = json.loads((folder / "sculptures.json").read_text(encoding="utf-8"))
        paintings = [
            PerformedPainting(name, metrics, *_pictures(folder / name, _PAINT)) for name, metrics in painted.items()
        ]
        sculptures = [
            PerformedSculpture(name, metrics, dict(zip(_CLAY, _pictures(folder / name, _CLAY), strict=True)))
            for name, metrics in carved.items()
        ]
    except (OSError, ValueError, AttributeError) as error:
        raise ContractError(
            f"{folder} holds no paintings and sculptures from the bundle ({error}); run the stage run_bundle."
        ) from error
    return [*paintings, *sculptures]


def performances_section(performances: Sequence[PerformanceInputs], album: Album) -> Markup:
    """HTML of the section; its pictures go into the album."""
    paintings = [inputs for inputs in performances if isinstance(inputs, PerformedPainting)]
    return render(
        "report/performances.html",
        album=album,
        paintings=paintings,
        carvings=[inputs for inputs in performances if isinstance(inputs, PerformedSculpture)],
        error_rows=[_error_row(inputs) for inputs in paintings],
    )


def _pictures(folder: Path, parts: Iterable[str]) -> list[bytes]:
    return [(folder / f"{part}.png").read_bytes() for part in parts]


def _error_row(inputs: PerformedPainting) -> list[str]:
    metrics, reference = inputs.metrics, inputs.metrics.get("workshop")
    error = metrics["error"]
    return [
        inputs.name,
        str(metrics["strokes"]),
        decimal(error["plan"], 5),
        decimal(error["canvas"], 5),
        "–" if reference is None else decimal(reference["error"], 5),
        "–" if reference is None else percent(error["canvas"] / reference["error"] - 1),
    ]
