"""Calibration of stated probabilities, and the score of any method's verdicts."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

from studies.blind.calibration import calibration, stated
from studies.blind.score import score
from studies.blind.truth import Strength, Truth


def line(cause: str, probability: float, true: bool) -> dict[str, Any]:
    entry = {"cause": cause, "probability": probability, "rivals": [], "gain": 0.5}
    status = ("suspected", "established") if probability < 0.95 else ("established", "suspected")
    return {"truth": {"causes": [cause] if true else []}, "verdict": {status[0]: [entry], status[1]: []}}


def test_perfect_calibration_has_no_error() -> None:
    lines = [line("latency", 0.75, k < 3) for k in range(4)] + [line("backlash", 1.0, True)] * 4
    assert len(stated(lines)) == 8
    page = calibration(lines)
    assert "Expected calibration error 0.000" in page and "| 0.7 – 0.8 | 4 | 0.750 | 0.750 |" in page
    assert "Brier score 0.094" in page  # (4 · 0.75 · 0.25) / 8
    assert calibration([]) == "No cause is named."


def test_overconfidence_is_an_error() -> None:
    assert "Expected calibration error 0.500" in calibration([line("latency", 1.0, k < 2) for k in range(4)])


def test_verdicts_of_any_method_are_scored(tmp_path: Path) -> None:
    for number, cause in enumerate(("latency", "backlash")):
        folder = tmp_path / "worlds" / f"{number:04d}"
        folder.mkdir(parents=True)
        truth = Truth("one", number, "marker", (cause,), None, (0.2,), (Strength(0.4, 0.2, 0.02),), False)
        (folder / "truth.json").write_text(json.dumps(asdict(truth)))
        (folder / "series.json").write_text('{"kind": "strokes", "series": "one cause"}')
    verdicts = tmp_path / "verdicts"
    verdicts.mkdir()
    (verdicts / "0000.json").write_text('{"established": [{"cause": "latency"}]}')
    printed = score(tmp_path / "worlds", verdicts)
    assert "exact set: 1 of 2" in printed  # a world without a verdict counts as missed
    assert "false names among names: 0 of 1" in printed
