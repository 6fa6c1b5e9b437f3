"""The report's page: its sections in order, in one file that needs no other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

from pentimento.report.benchmarks import BenchmarkInputs, benchmark_section
from pentimento.report.copainting import CopaintingInputs, copainting_section
from pentimento.report.diagnoses import DiagnosisInputs, diagnoses_section
from pentimento.report.hands import HandInputs, hands_section
from pentimento.report.html import Album, row
from pentimento.report.inputs import PaintingInputs, StrokePictures, ToolInputs
from pentimento.report.painting_words import summary
from pentimento.report.paintings import hero, painting_section
from pentimento.report.performances import PerformanceInputs, performances_section
from pentimento.report.sculpting import SculptureInputs, sculpting_section
from pentimento.report.tools import tool_section
from pentimento.report.wording import tool_name

_HERE = Path(__file__).parent


@dataclass(frozen=True)
class ReportConfig:
    """What the report shows."""

    frame_ms: int
    """Of the time-lapse: how long each photograph stays."""
    strokes: StrokePictures

    def __post_init__(self) -> None:
        if self.frame_ms < 20:
            raise ValueError(f"frame_ms is {self.frame_ms}; browsers show nothing faster than 20 ms.")


def build_report(
    paintings: Sequence[PaintingInputs],
    tools: Sequence[ToolInputs],
    benchmarks: BenchmarkInputs,
    config: ReportConfig,
    diagnoses: Sequence[DiagnosisInputs] = (),
    evaluations: Sequence[CopaintingInputs] = (),
    performances: Sequence[PerformanceInputs] = (),
    sculptures: Sequence[SculptureInputs] = (),
    hands: HandInputs | None = None,
) -> dict[str, bytes]:
    """The report's files by name: `index.html`, which holds every picture, and the pictures beside it.

    The first painting opens the page. Equal inputs give equal bytes. Without diagnoses, evaluations of co-painting,
    sculptures, drawings in hands, or paintings of the runner, their section is left out.
    """
    album = Album()
    links = _links(paintings, tools, diagnoses, evaluations, performances, sculptures, hands)
    body = f"""<header>
<h1>Pentimento</h1>
<p class="lead">A robot strokes, looks, learns its brush, plans a picture, paints it, and changes its mind.</p>
{hero(paintings[0], config.frame_ms, album)}
{row([summary(painting) for painting in paintings])}
</header>
<nav aria-label="Sections"><ul>{links}</ul></nav>
<main>
{"".join(painting_section(painting, config.frame_ms, album) for painting in paintings)}
<section id="tools">
<h2>What the robot learned of its tools</h2>
{_text("tools.html")}
</section>
{"".join(tool_section(tool, config.strokes.shown, album) for tool in tools)}
{diagnoses_section(diagnoses, album) if diagnoses else ""}
{hands_section(hands, album) if hands else ""}
{copainting_section(evaluations, album) if evaluations else ""}
{"".join(sculpting_section(sculpture, album) for sculpture in sculptures)}
{performances_section(performances, album) if performances else ""}
{benchmark_section(benchmarks, album)}
{_text("closing.html")}
</main>"""
    page = f"""<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<title>Pentimento: the report</title>
<style>
{_text("templates/style.css")}</style>
</head>
<body>
{body}
</body>
</html>
"""
    return album.files | {"index.html": page.encode("utf-8")}


def _links(
    paintings: Sequence[PaintingInputs],
    tools: Sequence[ToolInputs],
    diagnoses: Sequence[DiagnosisInputs],
    evaluations: Sequence[CopaintingInputs],
    performances: Sequence[PerformanceInputs],
    sculptures: Sequence[SculptureInputs],
    hands: HandInputs | None,
) -> str:
    links = [(painting.setting, f"{painting.setting.capitalize()} painting") for painting in paintings]
    links += [(f"tool-{tool.name}", tool_name(tool.name).capitalize()) for tool in tools]
    links += [("gap", "What was wrong")] if diagnoses else []
    links += [("hands", "In a person’s hand")] if hands else []
    links += [("copainting", "Drawing with a person")] if evaluations else []
    links += [(f"sculpting-{sculpture.material}", f"Sculpting in {sculpture.material}") for sculpture in sculptures]
    links += [("runner", "On the robot")] if performances else []
    links += [("speed", "Speed"), ("runs", "Runs and timings"), ("brush", "Add a brush"), ("glossary", "Glossary")]
    return "".join(f'<li><a href="#{escape(target)}">{escape(text)}</a></li>' for target, text in links)


def _text(name: str) -> str:
    """A fragment that says the same in every report."""
    return (_HERE / name).read_text(encoding="utf-8")
