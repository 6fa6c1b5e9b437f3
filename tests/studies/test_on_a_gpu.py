"""The study of a GPU: the published shapes, a training's row and the page; figures themselves need a GPU."""

import math

import pytest
import torch

from benchmarks import machine
from studies import on_a_gpu
from studies.on_a_gpu import Training, measure_training, page, published_planner
from tests.copainting.goal_planners import small_planner

SECONDS = {"median_s": 0.004, "minimum_s": 0.003, "runs": 5}
RENDERED = {
    "strokes": 400, "size_px": 512, "forward": SECONDS, "forward_backward": SECONDS, "peak_mb": 17.7,
    "bandwidth_share": 0.0008,
}  # fmt: skip


def test_the_unet_is_of_the_published_size() -> None:
    with torch.device("meta"):
        unet = published_planner().unet
    assert unet.config.in_channels == 8
    assert sum(weight.numel() for weight in unet.parameters()) == 859_532_484  # 859,520,964 of SD 1 and four channels


def test_a_training_makes_a_row_of_the_page(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(on_a_gpu, "published_planner", small_planner)
    monkeypatch.setattr(torch.cuda, "reset_peak_memory_stats", lambda: None)
    monkeypatch.setattr(torch.cuda, "max_memory_allocated", lambda: 24_800_000_000)
    rows = [measure_training(Training(64, 4, "32-true", lora), steps=10) for lora in (None, 2)]
    assert all(row["step_s"] > 0 and math.isfinite(row["last"]) for row in rows)
    text = page({"machine": machine.describe(), "renderer": [RENDERED], "trainings": rows, "steps": 10})
    assert "LoRA, rank 2" in text and "all weights" in text and "24.8" in text and "400 | 512² | 0.00400" in text


@pytest.mark.skipif(torch.cuda.is_available(), reason="a GPU is at hand: it would be measured, for minutes")
def test_without_a_gpu_it_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.argv", ["on_a_gpu"])
    with pytest.raises(SystemExit, match=r"No GPU was at hand.* Run this on a machine that has one"):
        on_a_gpu.main()
