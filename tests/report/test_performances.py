"""The report's section on execution from the bundle."""

import json
from pathlib import Path

import numpy as np
import pytest

from pentimento.contracts.errors import ContractError
from pentimento.contracts.images import encode_png
from pentimento.report.html import Album
from pentimento.report.performances import performances_section, read_performances
from pentimento.report.wording import percent

PICTURE = encode_png(np.full((4, 6, 3), 200, np.uint8))


def write(folder: Path, name: str, words: str | None) -> dict[str, object]:
    (folder / name).mkdir()
    for part in ("goal", "plan", "canvas"):
        (folder / name / f"{part}.png").write_bytes(PICTURE)
    metrics_: dict[str, object] = {
        "setting": "colour", "words": words, "strokes": 40, "error": {"plan": 0.004, "canvas": 0.0055},
    }  # fmt: skip
    return metrics_ if words else metrics_ | {"workshop": {"strokes": 42, "error": 0.005}}


def test_paintings_are_compared_with_those_of_pytorch(tmp_path: Path) -> None:
    metrics = {"cat": write(tmp_path, "cat", None), "hut": write(tmp_path, "hut", "a hut & a <tree>")}
    (tmp_path / "metrics.json").write_text(json.dumps(metrics))
    (tmp_path / "sculptures.json").write_text("{}")
    album = Album()
    html = performances_section(read_performances(tmp_path), album)
    assert set(album.files) == {f"runner_{n}_{p}.png" for n in ("cat", "hut") for p in ("goal", "plan", "canvas")}
    assert "a hut &amp; a &lt;tree&gt;" in html and "<tree>" not in html
    assert percent(0.0055 / 0.005 - 1) in html


def test_sculpture_with_an_increased_error_says_raised(tmp_path: Path) -> None:
    (tmp_path / "metrics.json").write_text("{}")
    metrics_ = {
        "material": "foam", "letter": "A", "actions": 12,
        "error_3d_mm2": {"before": 2.0, "after": 0.5}, "visual_error": {"before": 0.02, "after": 0.03},
    }  # fmt: skip
    (tmp_path / "sculptures.json").write_text(json.dumps({"letter": metrics_}))
    (tmp_path / "letter").mkdir()
    for part in ("before", "goal", "result"):
        (tmp_path / f"letter/{part}.png").write_bytes(PICTURE)
    album = Album()
    html = performances_section(read_performances(tmp_path), album)
    assert set(album.files) == {f"runner_letter_{part}.png" for part in ("before", "goal", "result")}
    assert f"lowered the error in height by {percent(0.75)}" in html
    assert f"raised that in slope by {percent(0.5)}" in html


def test_folder_without_paintings_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(ContractError, match="run_bundle"):
        read_performances(tmp_path)
