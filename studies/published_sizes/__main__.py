"""From published folders to the lean runner, at full size: `python -m studies.published_sizes --out DIR`.

The folders have the shapes of Instruct-Pix2Pix and CLIP and random weights. Each part runs in a process of its own, so
that its peak memory is known; its figures are kept in DIR and not measured again. A file PART.json in DIR with the key
`not_measured`, a reason, leaves a part out. Writes docs/published_sizes.md. Needs 20 GB of disk and up to 24 GB of
memory.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from benchmarks import machine
from benchmarks.tables import machine_line, markdown
from pentimento.contracts.atomic import atomic_write
from studies.published_sizes.parts import PARTS, SAMPLED_STEPS, SIDE_PX, profile_training

ROOT = Path(__file__).resolve().parents[2]
_PAGE = """\
# The published sizes

Written by `python -m studies.published_sizes`; do not edit.

{machine}

Folders in the layout of diffusers and transformers, with random weights in half precision: Instruct-Pix2Pix
({weights:.0f} million weights in the UNet, pictures of {side} px), CLIP ViT-B/32 and ViT-L/14. The stages' own code
loads them, trains (profile `full`, batch 1), samples, exports and runs them. Each part is one process; *peak* is its
maximum resident memory. Times include imports and loading. {threads}. Other programs that share the processor lengthen
wall times, and CPU times less, through caches and memory.

{table}

{findings}

Random weights show memory, time and equality, not the quality of pictures.
"""
_COMPUTED = {"32-true": "float32", "bf16-mixed": "bfloat16"}
_WHAT = {
    "write": "write the folders",
    "load": "load the goal planner",
    "encoder_b32": "ViT-B/32: cosine of a picture and words, with gradient",
    "encoder_l14": "ViT-L/14: the same",
    "bfloat16": "a convolution in float32 and in bfloat16",
    "lora": "two training steps, low-rank updates (rank 16)",
    "whole": "two training steps, all weights, gradient checkpointing, no average",
    "sample": f"a goal of {SAMPLED_STEPS} steps, PyTorch",
    "export": "export a bundle, every graph compared with PyTorch's result",
    "run": f"open the bundle, and a goal of {SAMPLED_STEPS} steps without PyTorch",
}


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(prog="python -m studies.published_sizes", description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("data/studies/published_sizes"))
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    figures = {part: measured(part, args.out) for part in PARTS}
    atomic_write(ROOT / "docs/published_sizes.md", page(figures).encode())


def measured(part: str, out: Path) -> dict[str, Any]:
    """Wall and CPU seconds and peak memory of a part, and what it printed."""
    file = out / f"{part}.json"
    if not file.exists():
        print(f"{part} …", flush=True)
        started = time.perf_counter()
        process = subprocess.Popen(
            [sys.executable, "-m", "studies.published_sizes.parts", part, "--out", str(out)],
            stdout=subprocess.PIPE, text=True, encoding="utf-8",
        )  # fmt: skip
        assert process.stdout is not None
        said = process.stdout.read()
        _, status, used = os.wait4(process.pid, 0)
        if status:
            raise SystemExit(f"{part} ended with {os.waitstatus_to_exitcode(status)}; its message is above.")
        figures = {
            "wall_s": time.perf_counter() - started,
            "cpu_s": used.ru_utime + used.ru_stime,
            "peak_gb": used.ru_maxrss * 1024 / 1e9,  # Linux counts KiB
            **json.loads(said.splitlines()[-1]),
        }
        atomic_write(file, json.dumps(figures).encode())
    known: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
    return known


def page(figures: dict[str, dict[str, Any]]) -> str:
    """The page."""
    rows = [[what, *_shown(figures[part])] for part, what in _WHAT.items()]
    threads = os.environ.get("OMP_NUM_THREADS", "all")
    return _PAGE.format(
        machine=machine_line(machine.describe()),
        weights=figures["write"]["million_weights"],
        side=SIDE_PX,
        threads="One thread" if threads == "1" else f"{threads} threads",
        table=markdown(["part", "wall s", "CPU s", "peak GB"], rows),
        findings="\n\n".join(_findings(figures)),
    )


def _shown(figures: dict[str, Any]) -> list[str]:
    if "not_measured" in figures:
        return ["not measured", "", ""]
    return [f"{figures['wall_s']:.0f}", f"{figures['cpu_s']:.0f}", f"{figures['peak_gb']:.1f}"]


def _findings(figures: dict[str, dict[str, Any]]) -> list[str]:
    """What the parts say beside time and memory, and what follows for the profile."""
    training = profile_training()
    pairs = training["steps"] * training["batch"]
    found = []
    for part, what in (("whole", "all weights"), ("lora", "low-rank updates")):
        if (step_s := figures[part].get("step_cpu_s")) is not None:
            found.append(
                f"A training step of one pair with {what} takes {step_s:.0f} CPU seconds in "
                f"{_COMPUTED[figures[part]['precision']]}. Extrapolated in proportion, the profile's "
                f"{training['steps']} steps of {training['batch']} pairs take {pairs * step_s / 3600:.0f} CPU hours. "
                "Larger batches were not measured."
            )
    if figures["whole"].get("precision") == "32-true" != training["precision"]:
        found.append(
            f"The profile says `{training['precision']}`. This processor has no instructions for bfloat16, so training "
            "computes in float32 here, and says so. In emulated bfloat16, a convolution of the UNet (320 channels, 8 x "
            f"8 latents) takes {figures['bfloat16']['ratio']:.0f} times as long as in float32."
        )
    if "bundle_gb" in figures["export"]:
        found.append(f"The bundle has {figures['export']['bundle_gb']:.2f} GB.")
    if "opened_s" in figures["run"]:
        found.append(
            f"It opens, checked, in {figures['run']['opened_s']:.1f} s. The runner's goal differs from PyTorch's by "
            f"{figures['run']['difference_of_255']:.2f} of 255 on average, after {SAMPLED_STEPS} steps in half "
            "precision. The profile's 20 steps were not sampled; time grows in proportion to the steps."
        )
    missing: dict[str, list[str]] = {}
    for part, what in _WHAT.items():
        if (reason := figures[part].get("not_measured")) is not None:
            missing.setdefault(reason, []).append(what)
    found += [f"Not measured, because {reason}: {'; '.join(parts)}." for reason, parts in missing.items()]
    return found


if __name__ == "__main__":
    main()
