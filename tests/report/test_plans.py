"""The report's section on a plan that nobody executed."""

import json
from pathlib import Path

import numpy as np
import pytest

from pentimento.contracts.errors import ContractError
from pentimento.contracts.images import write_png
from pentimento.contracts.plan import Plan, PlanHeader, PlannedStroke, write_plan
from pentimento.report.html import Album
from pentimento.report.plans import plan_section, read_painting_plan
from tests.report.test_page import read


def write(folder: Path, strokes: int = 2) -> Path:
    """A plan as the stage `plan_painting` writes it, on a sheet of 60 x 40 mm."""
    for name in ("target", "plan"):
        write_png(folder / f"{name}.png", np.full((40, 60, 3), 200, np.uint8))
    path = np.array([[0.0, 0.01, 0.03, -0.001, 0.0], [0.5, 0.03, 0.03, -0.002, 0.0]])
    planned = tuple(PlannedStroke(path, np.zeros(3), False) for _ in range(strokes))
    write_plan(folder / "plan.jsonl", Plan(PlanHeader("pen", np.zeros((1, 3)), (0.06, 0.04), "envelope"), planned))
    (folder / "metrics.json").write_text(json.dumps({"strokes": strokes, "error": {"blank": 0.2, "plan": 0.05}}))
    (folder / "warnings.json").write_text(json.dumps(["humidity is not determined."]))
    return folder


def test_section_says_that_nobody_executed_the_plan(tmp_path: Path) -> None:
    album = Album()
    html = plan_section(read_painting_plan("fine_pen", write(tmp_path)), album)
    assert read(html).open == []
    assert "2 strokes on a white sheet of 60 x 40 mm" in html and "Nobody has executed this plan" in html
    assert "25\u00a0% of that of the blank sheet" in html and "humidity is not determined" in html
    assert set(album.files) == {"plan_fine_pen.png", "plan_fine_pen_target.png", "plan_fine_pen_strokes.png"}


def test_plan_without_strokes_has_no_paths(tmp_path: Path) -> None:
    album = Album()
    html = plan_section(read_painting_plan("fine_pen", write(tmp_path, strokes=0)), album)
    assert read(html).open == [] and "plan_fine_pen_strokes.png" not in album.files


def test_missing_error_names_the_stage(tmp_path: Path) -> None:
    write(tmp_path)
    (tmp_path / "metrics.json").write_text(json.dumps({"error": {"blank": 0.2}}))
    with pytest.raises(ContractError, match="plan_painting"):
        read_painting_plan("fine_pen", tmp_path)
