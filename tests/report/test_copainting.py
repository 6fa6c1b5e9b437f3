"""The report's section on co-painting, from files as the stage writes them."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pentimento.contracts.errors import ContractError
from pentimento.contracts.images import write_png
from pentimento.report.copainting import copainting_section, read_copainting
from pentimento.report.html import Album
from tests.report.test_page import read


def estimate(value: float) -> dict[str, float]:
    return {"value": value, "low": value - 0.01, "high": value + 0.01}


def row(score: float, gap: float | None) -> dict[str, dict[str, float]]:
    found = {"clip_score": score, "judge_score": score, "drawing_keeps": 0.97}
    return {name: estimate(v) for name, v in (found | ({} if gap is None else {"delta_pix": gap})).items()}


TURN = {
    "judge_score_no_change": 0.1, "judge_score": 0.325, "goal_keeps": None, "drawing_keeps": 0.9, "changed": 0.1,
    "strokes": 12.0, "covered": 0.05, "first_found": None,
}  # fmt: skip
PICTURES = ("begun", "on_paper", "other_medium", "turns", "executed", "composed_seen")
METRICS: dict[str, Any] = {
    "begun": {
        "no_change": row(0.11, None), "copy_input": row(0.11, 0.0), "ignore_input": row(0.12, 0.061),
        "text_only": row(0.44, None), "base": row(0.2, 0.062), "fine_tuned": row(0.31, 0.013), "oracle": row(0.4, 0.01),
    },
    "comparisons": {"delta_pix_closed": estimate(0.94), "delta_pix_ratio": estimate(4.769)},
    "on_paper": {"no_change": row(0.0, None), "fine_tuned": row(0.5, 0.02), "oracle": row(0.6, 0.01)},
    "composed_seen": {"fine_tuned": row(0.41, 0.02)},
    "other_medium": {"no_change": row(0.1, None), "fine_tuned": row(0.3, 0.02)},
    "turns": {"fine_tuned": [TURN] * 3, "base": [TURN] * 3},
    "executed": {"begun": estimate(0.62), "on_paper": estimate(0.73)},
    "correlation": {"delta_sem": {"r": -0.48, "p": 2.4e-31, "paintings": 300}},
    "vae_ink_recall": {"fine_tuned": 0.99},
    "cases": {"begun": 100, "composed_seen": 7, "on_paper": 50, "other_medium": 1},
}  # fmt: skip


def test_missing_gap_between_base_and_oracle_is_stated(folder: Path) -> None:
    section = copainting_section([read_copainting("marker", folder)], Album())
    assert "of the gap in Δ<sub>pix</sub> between base and oracle." in section
    assert "The base’s Δ<sub>sem</sub> is no larger than the oracle’s: there is no gap to close." in section


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "metrics.json").write_text(json.dumps(METRICS))
    for name in PICTURES:
        write_png(tmp_path / f"{name}.png", np.full((4, 4, 3), 200, np.uint8))
    return tmp_path


def test_every_method_is_in_the_table_with_its_interval(folder: Path) -> None:
    album = Album()
    section = copainting_section([read_copainting("marker", folder)], album)
    assert read(section).open == []
    for words in ("no change", "copy the input", "ignore the input", "text-guided", "no fine-tuning", "oracle"):
        assert words in section
    assert "13.00<br><small>3.00&nbsp;… 23.00</small>" in section
    assert section.count('<td class="number">–</td>') >= 2  # no gap where there is no goal
    assert "4.769 (4.759\u00a0… 4.779)" in section and "100 held-out prompts" in section and "1 prompt." in section
    assert "in training: 7 prompts." in section and "0.410" in section
    assert "beside another drawing" in section and "62\u00a0%" in section and "73\u00a0%" in section
    assert "turn 3" in section and "0.325" in section and "r = −0.480, p = 2e−31" in section
    assert {f"copainting_marker_{name}.png" for name in PICTURES} == set(album.files)


def test_incomplete_evaluation_is_an_error(folder: Path) -> None:
    (folder / "turns.png").unlink()
    with pytest.raises(ContractError, match="run the stage evaluate_copainting"):
        read_copainting("marker", folder)
    (folder / "metrics.json").write_text("{}")
    with pytest.raises(ContractError, match="run the stage evaluate_copainting"):
        read_copainting("marker", folder)
