"""Results of a tiny synthetic pipeline: six strokes and their model, a painting of three strokes on 60 × 40 mm."""

import json
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pentimento.contracts.images import write_png
from pentimento.contracts.plan import Plan, PlanHeader, PlannedStroke, write_plan
from pentimento.contracts.strokes import CONTRACT, example_table
from pentimento.contracts.tables import write_table
from pentimento.dynamics.strokes.evaluation import constant_width
from pentimento.dynamics.strokes.traj2stroke import Traj2StrokeParameters
from pentimento.report.benchmarks import BenchmarkInputs, Timing
from pentimento.report.paintings import PaintingInputs, read_painting
from pentimento.report.tools import StrokePictures, ToolInputs, read_tool

PICTURES = StrokePictures(shown=3, path_points=16, pixels_per_m=1000.0, margin_m=0.012)
MODEL = Traj2StrokeParameters((0.98, 1.02), (0.0003, -0.0002), 0.6, 0.0008, 0.2, 0.9)
HELD_OUT = [1, 2, 3]
METRICS: dict[str, Any] = {
    "strokes": 3,
    "error": {"blank": 0.2, "plan": 0.01, "without_replanning": 0.05, "with_replanning": 0.04},
    "replanning_lowers_error_by": 0.2,
    "pixel_mse": {"without_replanning": 0.06, "with_replanning": 0.05},
    "sim2real_mse": {"model": 0.01, "polyline": 0.025, "blank": 0.2},
    "sim2real_factor": 2.5,
    "deviation": {"with": 0.03, "without": 0.02},
}


@pytest.fixture(scope="session")
def tool_folders(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """(strokes, weights) of a tool, as the stages write them."""
    folder = tmp_path_factory.mktemp("tool")
    write_table(folder / "strokes", example_table(6), CONTRACT, "# Synthetic")
    weights = folder / "weights"
    weights.mkdir()
    scores = {
        "model": {"iou": 0.8, "l1": 0.01, "mse": 0.002},
        "polyline": {"iou": 0.6, "l1": 0.02, "mse": 0.005},
        "blank": {"iou": 0.0, "l1": 0.1, "mse": 0.08},
    }
    counts = {"training": 3, "held_out": 3, "quarantined": 0}
    for name, value in {
        "parameters": asdict(MODEL),
        "polyline": asdict(constant_width(0.001, 0.9)),
        "polyline_for_iou": asdict(constant_width(0.0012, 0.99)),
        "metrics": {"held_out": scores, "training": scores, "strokes": counts},
        "held_out_actions": HELD_OUT,
        "curve": {"epoch": [0, 1, 2], "weighted_l1": [0.05, 0.03, 0.02]},
    }.items():
        (weights / f"{name}.json").write_text(json.dumps(value))
    return folder / "strokes", weights


@pytest.fixture(scope="session")
def painting_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A setting's folder as the stage `paint` writes it."""
    folder = tmp_path_factory.mktemp("paintings") / "colour"
    (folder / "frames").mkdir(parents=True)
    generator = np.random.default_rng(0)
    names = ("photograph", "target", "plan", "polyline", "painting_with", "painting_without")
    for name in (*names, "frames/000", "frames/001", "frames/002"):
        write_png(folder / f"{name}.png", generator.integers(0, 256, (40, 60, 3), dtype=np.uint8))
    palette = np.array([[0.2, 0.3, 0.9], [0.8, 0.1, 0.1]])
    header = PlanHeader("round_brush", palette, (0.06, 0.04), "envelope")
    path = np.array([[0.0, 0.01, 0.03, -0.001, 0.0], [0.5, 0.03, 0.03, -0.002, 0.0]])
    strokes = tuple(PlannedStroke(path, palette[paint], True) for paint in (0, 0, 1))
    for name in ("plan", "executed_with", "executed_without"):
        write_plan(folder / f"{name}.jsonl", Plan(header, strokes))
    (folder / "plan.svg").write_text("<svg/>")
    for name, value in {
        "metrics": METRICS,
        "deviation": {"strokes": [0, 2, 3], "with": [0.0, 0.02, 0.03], "without": [0.0, 0.01, 0.02]},
        "curve": {"iteration": [0, 1], "objective": [0.2, 0.01]},
        "palette": palette.tolist(),
    }.items():
        (folder / f"{name}.json").write_text(json.dumps(value))
    return folder


@pytest.fixture(scope="session")
def tool(tool_folders: tuple[Path, Path]) -> ToolInputs:
    return read_tool("round_brush", *tool_folders, PICTURES)


@pytest.fixture(scope="session")
def painting(painting_folder: Path) -> PaintingInputs:
    return read_painting("colour", painting_folder)


@pytest.fixture(scope="session")
def benchmarks() -> BenchmarkInputs:
    """Synthetic times, proportional to strokes and to the canvas's width."""
    ours = {size: [Timing(n, 1e-5 * n * size / 256) for n in (20, 100, 400)] for size in (256, 512)}
    peers = {"FRIDA, 256²": [Timing(20, 0.25), Timing(400, 6.0)], "Guessed, 256²": [Timing(400, 30.0, True)]}
    return BenchmarkInputs("a synthetic processor", ours, [Timing(20, 2.0)], peers)


@pytest.fixture(scope="session")
def worse(painting: PaintingInputs) -> Callable[[], PaintingInputs]:
    """The same painting with a harmful replanning and a learned model worse than the polyline."""

    def make() -> PaintingInputs:
        return replace(
            painting,
            lowered_by=-0.25,
            error=painting.error | {"with_replanning": 0.0625},
            deviation_with=[0.0, 0.005, 0.01],
            sim2real_mse={"model": 0.05, "polyline": 0.025, "blank": 0.2},
            sim2real_factor=0.5,
        )

    return make
