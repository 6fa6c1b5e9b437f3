"""Memory and waiting time of fine-tuning on more pairs than memory holds: `python -m studies.streaming --out DIR`.

Writes a table of co-paintings of 512 px, reads and checks it as `finetune_goal_planner` does, encodes it part by part
into latents on disk, and times how long a step waits for its pairs, with the file not in memory. The autoencoder is a
mean over 8 x 8 pixels, and there is no UNet: what is measured is reading, checking, decoding and writing. Prints JSON.
"""

from __future__ import annotations

import argparse
import json
import os
import time
import zlib
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pyarrow as pa
import torch
from torch import Tensor, nn
from torch.nn.functional import avg_pool2d

from benchmarks.memory import forget_peak, peak
from pentimento.contracts.atomic import atomic_folder
from pentimento.contracts.copaintings import CONTRACT, example_table
from pentimento.contracts.images import encode_png
from pentimento.contracts.schema import arrow_schema
from pentimento.contracts.tables import write_shards
from pentimento.copainting.goal.latents import encode_parts
from pentimento.copainting.goal.planner import GoalPlanner, GoalPlannerShape, build_goal_planner, text_encoder_of
from pentimento.copainting.goal.vae import VaeConfig, build_vae
from pentimento.semantics.encoder import EncoderShape, new_model
from pentimento.semantics.tokenizer import learn_tokenizer
from pipelines.finetune_goal_planner import _surveyed, _training_parts

SIDE_PX, ROWS_A_FILE = 512, 500
BATCH, STEPS, STEP_S = 16, 400, 0.27
"""Pairs of a step, steps that are timed, and the step beside which waiting is counted: that of docs/on_a_gpu.md."""
_LINES = 60
_CAPTIONS = ("a red disc", "a blue square", "a green disc on grey", "a yellow square")
_DOWN = 8  # pixels of a picture for one of its latents


class MeanEncoder(nn.Module):
    """Stands for the autoencoder: means over squares, with a fourth channel of zeros."""

    config = SimpleNamespace(block_out_channels=(1, 1, 1, 1), scaling_factor=1.0)
    device = torch.device("cpu")

    def encode(self, pictures: Tensor) -> SimpleNamespace:
        """Latents [B, 4, H / 8, W / 8] of pictures [B, 3, H, W]."""
        means = avg_pool2d(pictures, _DOWN)
        latents = torch.cat([means, torch.zeros_like(means[:, :1])], 1)
        return SimpleNamespace(latent_dist=SimpleNamespace(mode=lambda: latents))


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(prog="python -m studies.streaming", description=__doc__)
    parser.add_argument("--out", required=True, type=Path, help="a folder on a disk with 15 GB")
    parser.add_argument("--pairs", type=int, default=20_000)
    args = parser.parse_args()
    torch.set_num_threads(1)
    table = args.out / f"copaintings-{args.pairs}"
    if not table.is_dir():
        write_table_of(args.pairs, table)
    folders = {"marker": table}
    forget_peak()
    started = time.perf_counter()
    counts, _ = _surveyed(folders)
    surveyed = time.perf_counter()
    pairs = encode_parts(planner(), _training_parts(folders), "32-true", args.out / f"latents-{args.pairs}")
    encoded = time.perf_counter()
    waits = waits_for_pairs(pairs.latents, pairs.input, pairs.target, args.out / f"latents-{args.pairs}/latents.bin")
    figures = {
        "pairs": counts,
        "table_gb": sum(file.stat().st_size for file in table.iterdir()) / 1e9,
        "latents_gb": pairs.latents.numel() * 4 / 1e9,
        "survey_s": surveyed - started,
        "encode_s": encoded - surveyed,
        "wait_ms": {"mean": 1e3 * float(np.mean(waits)), "longest": 1e3 * float(np.max(waits))},
        "share_of_waiting": float(np.mean(waits) / (np.mean(waits) + STEP_S)),
        "peak_gb": peak() / 1e9,
    }
    print(json.dumps(figures, indent=1))


def write_table_of(pairs: int, folder: Path) -> None:
    """Write pairs of line drawings, all different within a file; one of ten is held out."""
    example = example_table(1).to_pylist()[0]
    drawings = [drawing(seed) for seed in range(2 * ROWS_A_FILE)]
    with atomic_folder(folder) as out:
        for first in range(0, pairs, ROWS_A_FILE):
            rows = [
                example | {
                    "scene_id": f"scene_{first + row}",
                    "caption": _CAPTIONS[row % len(_CAPTIONS)],
                    "partial": {"bytes": _own(drawings[2 * row], first), "path": None},
                    "full": {"bytes": _own(drawings[2 * row + 1], first), "path": None},
                    "split": "val" if row % 10 == 0 else "train",
                }
                for row in range(min(ROWS_A_FILE, pairs - first))
            ]  # fmt: skip
            part = out / f"{first:06d}"
            part.mkdir()
            write_shards(part, pa.Table.from_pylist(rows, schema=arrow_schema(CONTRACT)), CONTRACT)
            for number, file in enumerate(sorted(part.iterdir())):
                file.replace(out / f"{first:06d}-{number}.parquet")
            part.rmdir()


def drawing(seed: int) -> bytes:
    """PNG of lines of random colours on paper."""
    rng = np.random.default_rng(seed)
    picture = np.full((SIDE_PX, SIDE_PX, 3), 240, np.uint8)
    for _ in range(_LINES):
        start, end = (tuple(int(x) for x in rng.integers(0, SIDE_PX, 2)) for _ in range(2))
        cv2.line(picture, start, end, tuple(int(c) for c in rng.integers(0, 200, 3)), 6, cv2.LINE_AA)
    return encode_png(picture)


def _own(png: bytes, number: int) -> bytes:
    """The same picture in other bytes, so that a column of them is not compressed to one."""
    note = b"n\0" + np.random.default_rng(number).bytes(1024)
    chunk = b"tEXt" + note
    whole = len(note).to_bytes(4, "big") + chunk + zlib.crc32(chunk).to_bytes(4, "big")
    return png[:33] + whole + png[33:]  # behind the header


def planner() -> GoalPlanner:
    """A planner of any weights with `MeanEncoder`: its tokenizer and the size of its latents count."""
    tokenizer = learn_tokenizer(_CAPTIONS, 40, 12)
    shape = EncoderShape(16, 8, 16, 1, 16, 1, 2, 8)
    vae = build_vae(VaeConfig((8, 8, 8, 8), 4, 1, 1, 1, 1e-3), SIDE_PX)
    made = build_goal_planner(
        GoalPlannerShape(unet_channels=(8, 16), unet_layers=1, heads=2, prediction="sample"), vae,
        text_encoder_of(new_model(shape, tokenizer, 0)), tokenizer=tokenizer, seed=0,
    )  # fmt: skip
    made.vae = MeanEncoder()
    return made


def waits_for_pairs(latents: Tensor, inputs: Tensor, targets: Tensor, file: Path) -> list[float]:
    """Seconds that each step's reading of its pairs takes, of a file that is not in memory at first."""
    with file.open("rb") as opened:
        os.posix_fadvise(opened.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)
    waits = []
    for step in range(STEPS):
        chosen = torch.randint(len(inputs), (BATCH,), generator=torch.Generator().manual_seed(step))
        started = time.perf_counter()
        _ = latents[targets[chosen]] + latents[inputs[chosen]]
        waits.append(time.perf_counter() - started)
    return waits


if __name__ == "__main__":
    main()
