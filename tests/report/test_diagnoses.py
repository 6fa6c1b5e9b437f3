"""The report's section on diagnoses, from files as the stage writes them."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pentimento.contracts.errors import ContractError
from pentimento.contracts.images import write_png
from pentimento.report.benchmarks import BenchmarkInputs
from pentimento.report.diagnoses import DiagnosisInputs, diagnoses_section, read_diagnosis
from pentimento.report.html import Album
from pentimento.report.inputs import PaintingInputs, ToolInputs
from pentimento.report.page import build_report
from tests.report.test_page import CONFIG, read

VERDICT: dict[str, Any] = {
    "schema": 1,
    "kind": "strokes",
    "rows": 168,
    "actions": 120,
    "mse": {"base": 4.2e-4, "extended": 1.3e-4, "floor": 1.1e-4, "floor_ci": [1e-4, 1.4e-4]},
    "established": [
        {
            "cause": "ink_depletion", "p_adj": 0.0002, "gain": 0.93, "gain_ci": [0.88, 0.97],
            "parameters": {"density_loss": {"value": -0.31, "se": 0.02}}, "rivals": [],
        }
    ],
    "suspected": [],
    "gap_closed": {"test": 0.94, "ci": [0.9, 0.98], "shifted": None},
    "unexplained": [],
    "floor_reached": True,
    "next_actions": "next_actions.parquet",
    "sentence": "Established: ink_depletion & nothing else.",
}  # fmt: skip


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "figures").mkdir()
    (tmp_path / "verdict.json").write_text(json.dumps(VERDICT))
    for name in ("leave_one_out", "strokes"):
        write_png(tmp_path / "figures" / f"{name}.png", np.full((4, 4, 3), 200, np.uint8))
    return tmp_path


def test_the_section_says_what_was_found_for_each_tool(folder: Path) -> None:
    album = Album()
    html = diagnoses_section([read_diagnosis("round_brush", folder), read_diagnosis("marker", folder)], album)
    assert read(html).open == []
    assert "The round brush" in html and "The marker" in html
    assert "ink_depletion &amp; nothing else" in html and "93\u00a0%" in html and "−0.31" in html
    assert set(album.files) == {
        f"gap_{t}_{n}.png" for t in ("round_brush", "marker") for n in ("leave_one_out", "strokes")
    }


def test_nothing_found_makes_no_table() -> None:
    nothing = VERDICT | {"established": [], "sentence": "No known cause is established."}
    html = diagnoses_section([DiagnosisInputs("marker", nothing, {})], Album())
    assert "No known cause" in html and "<table" not in html and "<img" not in html


def test_an_unknown_floor_is_not_spoken_of() -> None:
    unknown = VERDICT | {
        "mse": VERDICT["mse"] | {"floor": None, "floor_ci": None},
        "gap_closed": {"test": None, "ci": None, "shifted": None},
    }
    html = diagnoses_section([DiagnosisInputs("marker", unknown, {})], Album())
    assert "noise floor is" not in html and "None" not in html and "share of the error" in html


def test_a_missing_or_other_verdict_is_named(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(ContractError, match="diagnose_gap"):
        read_diagnosis("marker", tmp_path / "nowhere")
    (folder / "verdict.json").write_text(json.dumps(VERDICT | {"schema": 2}))
    with pytest.raises(ContractError, match="schema 2"):
        read_diagnosis("marker", folder)


def test_the_page_holds_the_section_and_leads_to_it(
    painting: PaintingInputs, tool: ToolInputs, benchmarks: BenchmarkInputs, folder: Path
) -> None:
    files = build_report([painting], [tool], benchmarks, CONFIG, [read_diagnosis("round_brush", folder)])
    page = files["index.html"].decode()
    assert read(page).open == [] and '<a href="#gap">' in page and 'id="gap"' in page
    assert "gap_round_brush_leave_one_out.png" in files
    without = build_report([painting], [tool], benchmarks, CONFIG)["index.html"].decode()
    assert 'id="gap"' not in without and "#gap" not in without
