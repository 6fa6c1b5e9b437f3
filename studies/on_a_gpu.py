"""The renderer and a goal planner of the published size on a GPU: `python -m studies.on_a_gpu`.

The renderer's strokes are those of `make bench`. The goal planner has the shapes of the published one (Brooks et al.
2023; Stable Diffusion 1's UNet of 860 million weights) and random weights: time, memory and the fall of the loss are
measured. Writes the figures to `--out` and the page docs/on_a_gpu.md. Exits with a message if there is no GPU.
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch

from benchmarks import gpu, machine
from benchmarks.__main__ import rounded
from benchmarks.tables import gpu_table, machine_line, markdown
from pentimento.copainting.goal.denoising import GoalTraining, LatentPairs, Lora, tokens_of
from pentimento.copainting.goal.training import train_goal_planner
from studies.published_sizes.models import CAPTIONS, published_planner

ROOT = Path(__file__).resolve().parents[1]
PAIRS = 64
WARM = 5  # steps before timing, in which PyTorch selects its kernels


@dataclass(frozen=True)
class Training:
    """One row of the goal planner's table."""

    side_px: int
    batch: int
    precision: Literal["32-true", "bf16-mixed"]
    lora: int | None
    """Rank."""


TRAININGS = (
    Training(256, 16, "32-true", None),
    Training(256, 16, "bf16-mixed", None),
    Training(256, 64, "32-true", None),
    Training(256, 64, "bf16-mixed", None),
    Training(256, 64, "bf16-mixed", 8),
    Training(512, 16, "bf16-mixed", None),
)


def measure_training(row: Training, steps: int) -> dict[str, Any]:
    """Seconds a step (median), peak memory of the device, and the loss over the first and the last fifth of steps."""
    planner = published_planner()
    latent = row.side_px // 8
    generator = torch.Generator().manual_seed(1)
    pairs = LatentPairs(
        latents=torch.randn(2 * PAIRS, 4, latent, latent, generator=generator),
        input=torch.arange(PAIRS),
        target=torch.arange(PAIRS, 2 * PAIRS),
        tokens=tokens_of(planner, [CAPTIONS[index % len(CAPTIONS)] for index in range(PAIRS)]),
    )
    config = GoalTraining(
        steps=steps, batch=row.batch, learning_rate=1e-4, warm_up=WARM, weight_decay=0.01, drop_text=0.05,
        drop_image=0.05, drop_both=0.05, min_snr_gamma=5.0, time_bias=1.0, ema_decay=0.99,
        lora=None if row.lora is None else Lora(row.lora, row.lora), train_text=False, checkpoint_every=steps,
        gradient_checkpointing=False,
        precision=row.precision, accelerator="auto", devices=1, strategy="auto", seed=0,
    )  # fmt: skip
    ends: list[float] = []  # the loss is read off the device at each step, which waits for it

    def log(_name: str, _value: float, _step: int) -> None:
        ends.append(time.perf_counter())

    torch.cuda.reset_peak_memory_stats()
    losses = train_goal_planner(planner, pairs, config, scratch=None, log=log)
    fifth = max(1, steps // 5)
    return asdict(row) | {
        "step_s": statistics.median(np.diff(ends[WARM:])),
        "peak_gb": torch.cuda.max_memory_allocated() / 1e9,
        "weights_million": sum(weight.numel() for weight in planner.unet.parameters()) / 1e6,
        "first": statistics.mean(losses[:fifth]),
        "last": statistics.mean(losses[-fifth:]),
    }


_PAGE = """\
# On a GPU

Written by `python -m studies.on_a_gpu`; do not edit. All other figures of the project were measured on two cores
without a GPU.

{machine}

## The renderer

The inputs are 400 and 4000 strokes of 32 points, as in [the benchmarks](benchmarks.md). Times are medians; the
fastest run is in brackets. On a machine with a GPU, `tests/dynamics/strokes/test_triton_kernel.py` compares images
and gradients with the dense reference and with the CPU's kernel.

{renderer}

## A goal planner of the published size

The model has the shapes of the published Instruct-Pix2Pix ({weights:.0f} million weights in the UNet) and random
weights. The training loop of the stage (`copainting.goal.training`) trains it on {pairs} random pairs. The table
gives speed and memory, and shows that the loss falls; it says nothing about the quality of pictures. Each row has
{steps} steps. *Loss* is the mean over the first and over the last fifth of them.

{planner}

If a step takes the same time with four times the batch, the launch of kernels limits the speed, not the computation.
"""


def page(results: dict[str, Any]) -> str:
    """The whole file."""
    head = ("pictures", "batch", "precision", "trained", "s a step", "pairs a second", "peak GB", "loss")
    rows = [
        (
            f"{row['side_px']}²", str(row["batch"]), row["precision"],
            "all weights" if row["lora"] is None else f"LoRA, rank {row['lora']}", f"{row['step_s']:.3f}",
            f"{row['batch'] / row['step_s']:.0f}", f"{row['peak_gb']:.1f}", f"{row['first']:.3f} → {row['last']:.3f}",
        )
        for row in results["trainings"]
    ]  # fmt: skip
    return _PAGE.format(
        machine=machine_line(results["machine"]),
        renderer=gpu_table(results["renderer"]),
        weights=results["trainings"][0]["weights_million"],
        pairs=PAIRS,
        steps=results["steps"],
        planner=markdown(head, rows),
    )


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(prog="python -m studies.on_a_gpu", description=__doc__)
    parser.add_argument("--out", type=Path, default=ROOT / "data" / "studies" / "on_a_gpu.json")
    parser.add_argument("--page", type=Path, default=ROOT / "docs" / "on_a_gpu.md")
    parser.add_argument("--steps", type=int, default=40, help="of each training")
    args = parser.parse_args()
    if (missing := gpu.missing()) is not None:
        sys.exit(f"{missing} Run this on a machine that has one.")
    renderer = [gpu.measure_gpu(case) for case in gpu.CASES]
    trainings = [measure_training(row, args.steps) for row in TRAININGS]
    results = rounded(
        {"machine": machine.describe(), "renderer": renderer, "trainings": trainings, "steps": args.steps}
    )
    args.out.parent.mkdir(parents=True, exist_ok=True)
    args.out.write_text(json.dumps(results, indent=1) + "\n")
    args.page.write_text(page(results))
    print(page(results))


if __name__ == "__main__":
    main()
