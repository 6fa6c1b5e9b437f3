import io
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import PIL.Image
import pytest

from pentimento.contracts.errors import ContractError
from pentimento.report.benchmarks import (
    BenchmarkInputs,
    Timing,
    benchmark_section,
    comparison,
    draw_times,
    read_benchmarks,
)
from pentimento.report.figures import OCHRE
from pentimento.report.html import Album


def case(strokes: int, seconds: float, **other: Any) -> dict[str, Any]:
    row = {"strokes": strokes, "points": 32, "size_px": 256, "threads": 1, "kind": "plain"}
    return row | {"forward_backward": {"median_s": seconds}} | other


RESULTS: dict[str, Any] = {
    "machine": {"cpu": "a processor"},
    "cases": [
        case(20, 0.001), case(400, 0.006), case(400, 0.02, size_px=512), case(400, 0.004, threads=2),
        case(400, 0.003, points=4), case(400, 0.009, kind="pickup"),
    ],
    "reference": [case(20, 5.0), case(20, 0.6, points=4)],
    "peers": [{"name": "FRIDA", "canvas": "256²", "points": [{"strokes": 400, "s": 6.33, "extrapolated": False}]}],
}  # fmt: skip


def written(folder: Path, results: dict[str, Any]) -> Path:
    path = folder / "benchmarks.json"
    path.write_text(json.dumps(results))
    return path


def test_only_plain_cases_of_one_thread_and_charted_paths_are_read(tmp_path: Path) -> None:
    inputs = read_benchmarks(written(tmp_path, RESULTS))
    assert inputs.ours == {256: [Timing(20, 0.001), Timing(400, 0.006)], 512: [Timing(400, 0.02)]}
    assert inputs.reference == [Timing(20, 5.0)]
    assert inputs.peers == {"FRIDA, 256²": [Timing(400, 6.33)]}


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("{", r"benchmarks\.json is not a file of benchmarks .*make bench"),
        ("{}", r"'cases'.*make bench"),
        (json.dumps(RESULTS | {"cases": []}), r"holds no times of 32-point paths.*make bench"),
    ],
)
def test_invalid_file_of_benchmarks_is_an_error(tmp_path: Path, text: str, sentence: str) -> None:
    path = tmp_path / "benchmarks.json"
    with pytest.raises(ContractError, match="make bench"):
        read_benchmarks(path)
    path.write_text(text)
    with pytest.raises(ContractError, match=sentence):
        read_benchmarks(path)


def test_comparison_states_which_renderer_is_faster(benchmarks: BenchmarkInputs) -> None:
    assert comparison(benchmarks) == (
        "400 strokes on 256² pixels and all of their gradients take 4.00 ms, 1500 times less than the 6.00 s of FRIDA."
    )
    slow = replace(benchmarks, ours={256: [Timing(400, 12.0)]})
    assert "2.00 times more than the 6.00 s" in comparison(slow)
    assert "No common case" in comparison(replace(benchmarks, ours={256: [Timing(7, 1.0)]}))


def test_section_has_its_picture_and_names_extrapolation(benchmarks: BenchmarkInputs) -> None:
    album = Album()
    html = benchmark_section(benchmarks, album)
    assert set(album.files) == {"renderer_time.png"} and 'id="speed"' in html
    assert "a synthetic processor" in html and "extrapolated" in html


def test_slower_renderer_is_drawn_higher(benchmarks: BenchmarkInputs) -> None:
    def mean_row(seconds: float) -> float:
        peers = {"FRIDA, 256²": [Timing(20, seconds), Timing(400, seconds)], "other": [Timing(400, 30.0)]}
        picture = PIL.Image.open(io.BytesIO(draw_times(replace(benchmarks, peers=peers)))).convert("RGB")
        pixels = np.asarray(picture).astype(int)
        wanted = np.array([int(OCHRE[i : i + 2], 16) for i in (1, 3, 5)])
        plot = pixels[:, : int(0.65 * pixels.shape[1])]  # not the legend
        return float(np.argwhere(np.abs(plot - wanted).max(-1) <= 2)[:, 0].mean())

    assert mean_row(10.0) < mean_row(0.1) - 50
