"""The report's page: all sections in one self-contained file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from pentimento.report.benchmarks import BenchmarkInputs, benchmark_section
from pentimento.report.by_meaning import MeaningInputs, meanings_section
from pentimento.report.copainting import CopaintingInputs, copainting_section
from pentimento.report.diagnoses import DiagnosisInputs, diagnoses_section
from pentimento.report.duet import DuetInputs, duet_section
from pentimento.report.handwriting import HandwritingInputs, handwriting_section
from pentimento.report.html import Album
from pentimento.report.paintings import PaintingInputs, opening, painting_section, summary
from pentimento.report.performances import PerformanceInputs, performances_section
from pentimento.report.plans import PlanInputs, plan_section
from pentimento.report.sculpting import SculptureInputs, sculpting_section
from pentimento.report.templates import render
from pentimento.report.tools import StrokePictures, ToolInputs, tool_section
from pentimento.report.wording import tool_name


@dataclass(frozen=True)
class ReportConfig:
    """What the report shows."""

    frame_ms: int
    """Duration of each photograph in the time-lapse."""
    note: str | None
    """One line at the top about what was made; null for none."""
    strokes: StrokePictures

    def __post_init__(self) -> None:
        if self.frame_ms < 20:
            raise ValueError(f"frame_ms is {self.frame_ms}; browsers show nothing faster than 20 ms.")


@dataclass(frozen=True, eq=False)
class ReportInputs:
    """The results of the other stages, in the order in which the page shows them. Sections without any are left out."""

    paintings: Sequence[PaintingInputs]
    """The first opens the page."""
    tools: Sequence[ToolInputs]
    benchmarks: BenchmarkInputs | None = None
    meanings: Sequence[MeaningInputs] = ()
    duet: DuetInputs | None = None
    diagnoses: Sequence[DiagnosisInputs] = ()
    """Of recorded tools and of the studio's."""
    plans: Sequence[PlanInputs] = ()
    handwriting: HandwritingInputs | None = None
    evaluations: Sequence[CopaintingInputs] = ()
    sculptures: Sequence[SculptureInputs] = ()
    performances: Sequence[PerformanceInputs] = ()


def build_report(inputs: ReportInputs, config: ReportConfig) -> dict[str, bytes]:
    """The report's files by name: `index.html`, which embeds every picture, and the pictures as files.

    Equal inputs give equal bytes.
    """
    album = Album()
    recorded, made = _by_origin(inputs.diagnoses)
    page = render(
        "report/page.html",
        opening=opening(inputs.paintings[0], config.frame_ms, album) if inputs.paintings else None,
        recorded=bool(recorded),
        modelled=bool(inputs.tools),
        note=config.note,
        summaries=[summary(painting) for painting in inputs.paintings],
        links=_links(inputs),
        painting_sections=[
            *([diagnoses_section(recorded, album)] if recorded else []),
            *(plan_section(plan, album) for plan in inputs.plans),
            *(painting_section(painting, config.frame_ms, album) for painting in inputs.paintings),
            *([meanings_section([*inputs.meanings], album)] if inputs.meanings else []),
            *([duet_section(inputs.duet, album)] if inputs.duet else []),
        ],
        other_sections=[
            *(tool_section(tool, config.strokes.shown, album) for tool in inputs.tools),
            *([diagnoses_section(made, album)] if made else []),
            *([handwriting_section(inputs.handwriting, album)] if inputs.handwriting else []),
            *([copainting_section(inputs.evaluations, album)] if inputs.evaluations else []),
            *(sculpting_section(sculpture, album) for sculpture in inputs.sculptures),
            *([performances_section(inputs.performances, album)] if inputs.performances else []),
            *([benchmark_section(inputs.benchmarks, album)] if inputs.benchmarks else []),
        ],
    )
    return album.files | {"index.html": page.encode("utf-8")}


def _by_origin(diagnoses: Sequence[DiagnosisInputs]) -> tuple[list[DiagnosisInputs], list[DiagnosisInputs]]:
    """The diagnoses of recorded strokes, and those of strokes that the robot made in the studio."""
    recorded = [diagnosis for diagnosis in diagnoses if diagnosis.recorded]
    return recorded, [diagnosis for diagnosis in diagnoses if not diagnosis.recorded]


def _links(inputs: ReportInputs) -> list[tuple[str, str]]:
    """Targets and texts of the page's navigation."""
    recorded, made = _by_origin(inputs.diagnoses)
    links = [("recorded", "What the recorded tools do")] if recorded else []
    links += [(f"plan-{plan.tool}", f"Plan for the {tool_name(plan.tool)}") for plan in inputs.plans]
    links += [(painting.setting, f"{painting.setting.capitalize()} painting") for painting in inputs.paintings]
    links += [("meaning", "Painting by meaning")] if inputs.meanings else []
    links += [("duet", "Drawn in turns")] if inputs.duet else []
    links += [(f"tool-{tool.name}", tool_name(tool.name).capitalize()) for tool in inputs.tools]
    links += [("gap", "Diagnosis")] if made else []
    links += [("hands", "Handwriting styles")] if inputs.handwriting else []
    links += [("copainting", "Co-painting")] if inputs.evaluations else []
    links += [
        (f"sculpting-{sculpture.material}", f"Sculpting in {tool_name(sculpture.material)}")
        for sculpture in inputs.sculptures
    ]
    links += [("runner", "On the robot")] if inputs.performances else []
    links += [("speed", "Speed")] if inputs.benchmarks else []
    return [
        *links,
        ("runs", "Runs and timings"),
        ("brush", "Add a brush"),
        ("glossary", "Glossary"),
    ]
