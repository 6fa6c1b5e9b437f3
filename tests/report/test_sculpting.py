"""The report's section on sculpting."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pentimento.contracts.errors import ContractError
from pentimento.contracts.images import encode_png
from pentimento.report.figures import time_lapse
from pentimento.report.html import Album
from pentimento.report.sculpting import read_sculpture, sculpting_section

PICTURE = np.full((8, 8, 3), 150, np.uint8)


def told(source: str, before: float, after: float) -> dict[str, Any]:
    errors = {"before": before, "planned": 0.5, "after": after, "removed": 1 - after / before, "minimum": after}
    return {
        "source": source, "actions": 2, "stopped": "all actions were made", "helped": after < before,
        "error_3d_mm2": errors, "visual_error": errors | {"removed": 0.25},
        "curve": {"error_3d_mm2": [before, 0.8, after], "visual_error": [0.1, 0.09, 0.075]},
    }  # fmt: skip


def write(folder: Path) -> None:
    wanted = {"0_A": told("letter:A", 2.0, 0.5), "10_bust": told("goals/bust<1>.stl", 1.0, 1.5)}
    wanted["0_A"]["read"] = {"clay": "A", "goal": "A", "probability": 0.9, "right": True}
    wanted["2_B"] = told("letter:B", 3.0, 0.6) | {
        "read": {"clay": "E", "goal": "B", "probability": 0.6, "right": False}
    }
    for name in wanted:
        (folder / name).mkdir(parents=True)
        for part in ("before", "goal", "plan", "result"):
            (folder / name / f"{part}.png").write_bytes(encode_png(PICTURE))
    (folder / "metrics.json").write_text(json.dumps(wanted))
    (folder / "time_lapse.gif").write_bytes(time_lapse([PICTURE, PICTURE], 50))
    scores = {"l_3d_mm2": 0.0123, "l_viz": 0.004}
    model = {"held_out": {name: scores for name in ("model", "mean_footprint", "unchanged")}, "floor": scores}
    (folder / "gap").mkdir()
    (folder / "gap/verdict.json").write_text(json.dumps({"text": "Springback & <nothing> else."}))
    (folder / "metrics_of_model").mkdir()
    (folder / "metrics_of_model/metrics.json").write_text(json.dumps(model))
    (folder / "metrics_of_model/held_out.png").write_bytes(encode_png(PICTURE))


@pytest.fixture
def section(tmp_path: Path) -> tuple[str, Album]:
    write(tmp_path)
    album = Album()
    return sculpting_section(
        read_sculpture("foam", tmp_path, tmp_path / "metrics_of_model", tmp_path / "gap"), album
    ), album


def test_goals_are_in_the_order_of_execution(section: tuple[str, Album]) -> None:
    html, album = section
    assert html.index("The letter A") < html.index("The letter B") < html.index("bust")
    assert {f"foam_{name}_{part}.png" for name in ("0_A", "2_B", "10_bust") for part in ("goal", "result")} <= set(
        album.files
    )
    assert {"foam_sculpting.gif", "foam_sculpting_curve.png", "foam_pushes.png"} <= set(album.files)


def test_sentences_state_the_direction_of_the_result(section: tuple[str, Album]) -> None:
    html, _ = section
    assert "lowered the error in height by 75\u00a0%" in html
    assert "raised the error in height by 50\u00a0%" in html
    assert "reads the letter correctly" in html and "reads it as E" in html
    assert "2 pushes" in html and "0.0123" in html
    assert "Springback &amp; &lt;nothing&gt; else." in html


def test_file_names_are_escaped(section: tuple[str, Album]) -> None:
    assert "bust&lt;1&gt;.stl" in section[0] and "bust<1>" not in section[0]


def test_folder_without_a_sculpture_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(ContractError, match="train_push_dynamics, diagnose_pushes and sculpt"):
        read_sculpture("foam", tmp_path, tmp_path, tmp_path)
