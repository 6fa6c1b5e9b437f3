"""The report's section on diagnoses, from files as the stage writes them."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pentimento.contracts.errors import ContractError
from pentimento.contracts.images import write_png
from pentimento.report.diagnoses import DiagnosisInputs, diagnoses_section, read_diagnosis
from pentimento.report.html import Album
from tests.report.test_page import read

VERDICT: dict[str, Any] = {
    "schema": 2,
    "kind": "strokes",
    "rows": 168,
    "actions": 120,
    "mse": {"unit": "sRGB", "base": 4.2e-4, "extended": 1.3e-4, "floor": 1.1e-4, "floor_ci": [1e-4, 1.4e-4]},
    "established": [
        {
            "cause": "ink_depletion", "probability": 0.998, "gain": 0.93, "gain_ci": [0.88, 0.97],
            "parameters": {"density_loss": {"value": -0.31, "se": 0.02}}, "rivals": [],
            "evidence": {"discovery_z": 7.1},
        }
    ],
    "suspected": [],
    "gap_closed": {"test": 0.94, "ci": [0.9, 0.98], "shifted": None},
    "unexplained": [],
    "floor_reached": True,
    "text": "Established: ink_depletion.\nErrors & more.\nNot decided, because no times are known: latency.",
}  # fmt: skip


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "figures").mkdir()
    (tmp_path / "verdict.json").write_text(json.dumps(VERDICT))
    for name in ("leave_one_out", "strokes"):
        write_png(tmp_path / "figures" / f"{name}.png", np.full((4, 4, 3), 200, np.uint8))
    return tmp_path


def test_section_has_the_verdict_and_figures_of_each_tool(folder: Path) -> None:
    album = Album()
    html = diagnoses_section([read_diagnosis("round_brush", folder), read_diagnosis("marker", folder)], album)
    assert read(html).open == []
    assert "The round brush" in html and "The marker" in html
    assert "Errors &amp; more" in html and "93\u00a0%" in html and "established (1.00)" in html and "−0.31" in html
    assert set(album.files) == {
        f"gap_{t}_{n}.png" for t in ("round_brush", "marker") for n in ("leave_one_out", "strokes")
    }


def test_verdict_without_causes_has_no_table() -> None:
    nothing = VERDICT | {"established": [], "text": "No known cause is established."}
    html = diagnoses_section([DiagnosisInputs("marker", nothing, {})], Album())
    assert "No known cause" in html and "<table" not in html and "<img" not in html


def test_unknown_floor_is_left_out() -> None:
    unknown = VERDICT | {
        "mse": VERDICT["mse"] | {"floor": None, "floor_ci": None},
        "gap_closed": {"test": None, "ci": None, "shifted": None},
    }
    html = diagnoses_section([DiagnosisInputs("marker", unknown, {})], Album())
    assert "noise floor is" not in html and "None" not in html and "fraction of the error" in html


def test_missing_verdict_or_other_schema_is_an_error(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(ContractError, match="diagnose_gap"):
        read_diagnosis("marker", tmp_path / "nowhere")
    (folder / "verdict.json").write_text(json.dumps(VERDICT | {"schema": 1}))
    with pytest.raises(ContractError, match="schema 1"):
        read_diagnosis("marker", folder)


def test_each_line_of_the_verdict_is_on_the_page_once_and_findings_are_sentences() -> None:
    html = diagnoses_section([DiagnosisInputs("big_brush", VERDICT, {}, recorded=True)], Album())
    assert read(html).open == []
    assert 'id="recorded"' in html and "What the recorded tools do" in html
    assert html.count("Not decided, because no times are known: latency.") == html.count("Errors &amp; more.") == 1
    assert "Established: ink_depletion" not in html
    assert "<b>Coverage and width fall with the length drawn since the last dip</b>: density_loss −0.31 ± 0.02" in html
    assert html.index("Errors &amp; more") < html.index("cannot decide, and why") < html.index("Not decided")
    assert "<dt>latency</dt>" in html and "Some strokes several times" not in html


def test_what_to_record_next_is_counted_by_question(folder: Path) -> None:
    questions = ["bristle_lag | latency"] * 3 + ["bristle_lag"]
    pq.write_table(pa.table({"separates": questions}), folder / "next_actions.parquet")
    found = read_diagnosis("big_brush", folder, recorded=True)
    assert found.proposed == {"bristle_lag | latency": 3, "bristle_lag": 1}
    html = diagnoses_section([found], Album())
    assert (
        "3 strokes of <code>data/gap/big_brush/next_actions.parquet</code>, which distinguish bristle_lag from latency"
        in html
    )
    assert "1 stroke of" in html and "which reduce the standard errors of bristle_lag" in html
