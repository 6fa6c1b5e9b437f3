"""Fine-tune the goal planner's base on the co-paintings of all settings (thesis 6.4.2)."""

import argparse
import math
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import torch
from diffusers import AutoencoderKL

from pentimento.contracts.copaintings import CONTRACT
from pentimento.contracts.errors import ContractError
from pentimento.contracts.images import write_png
from pentimento.contracts.ranges import at_least
from pentimento.contracts.tables import stream_table
from pentimento.copainting.goal.completions import Sampling, guidance_grid, score_planner
from pentimento.copainting.goal.denoising import GoalTraining
from pentimento.copainting.goal.latents import encode_parts
from pentimento.copainting.goal.planner import GoalPlanner, load_goal_planner, save_goal_planner
from pentimento.copainting.goal.training import computed_precision, train_goal_planner
from pentimento.copainting.goal.vae import DecoderConfig, train_decoder
from pentimento.copainting.jobs import scratch_folder
from pentimento.copainting.scenes.edits import Pair, pairs_of
from pipelines._config import load_section
from pipelines._io import output_folder, single_threaded, stage_main, write_json
from pipelines._tracking import Run, input_digests, tracked_run

_ROWS = 256
"""Rows of a table in memory at a time: at 512 px, 0.4 GB of pictures."""
SCRATCH = Path(".pentimento/training")


@dataclass(frozen=True)
class FinetuneGoalPlanner:
    """Section `finetune_goal_planner` of params.yaml."""

    training: GoalTraining
    decoder: DecoderConfig | None
    """Of the autoencoder, fine-tuned on the paintings before the UNet; null keeps the base's decoder."""
    sampling: Sampling
    threads: int
    """PyTorch's threads for all devices together; last digits of results depend on the number."""

    def __post_init__(self) -> None:
        at_least(self, 1, "threads")


def main(arguments: argparse.Namespace) -> None:
    """Write `--out`: the pipeline in diffusers' layout, metrics.json, curve.json and the grid of guidances."""
    config = load_section(Path("params.yaml"), "finetune_goal_planner", FinetuneGoalPlanner)
    single_threaded()
    torch.set_num_threads(config.threads)
    folders = {setting: arguments.copaintings / setting for setting in arguments.settings}
    inputs = {**folders, "base": arguments.base}
    digests = input_digests(inputs)
    # Interrupted training can continue on other devices.
    anywhere = replace(config, training=replace(config.training, devices=1, strategy="auto"))
    scratch = scratch_folder(SCRATCH, "finetune_goal_planner", asdict(anywhere), digests)
    with (
        tracked_run("finetune_goal_planner", None, asdict(config), inputs) as run,
        output_folder(arguments.out) as out,
    ):
        run.tag("computed_precision", computed_precision(config.training))
        counts, held_out_tables = _surveyed(folders)
        planner = load_goal_planner(arguments.base)
        held_out = _interleaved(folders, held_out_tables, max(config.sampling.scored, config.sampling.shown))
        before = score_planner(planner, held_out, config.sampling)
        if config.decoder is not None:
            training = [pair for part in _training_parts(folders) for pair in part()]
            planner.register_modules(vae=_with_decoder(planner, training, config, scratch, run))
        latents = encode_parts(
            planner, _training_parts(folders), config.training.precision, scratch / f"latents-{_ROWS}"
        )
        losses = train_goal_planner(planner, latents, config.training, scratch=scratch / "steps", log=run.log)
        grid = guidance_grid(planner, held_out[: config.sampling.shown], config.sampling)
        metrics: dict[str, Any] = {
            "held_out": {
                "base": asdict(before),
                "fine_tuned": asdict(score_planner(planner, held_out, config.sampling)),
            },
            "pairs": counts,
        }
        save_goal_planner(planner, out)
        write_png(out / "guidance.png", grid)
        write_json(out / "curve.json", {"loss": losses})
        write_json(out / "metrics.json", metrics)
        run.log_metrics(metrics)
        run.log_picture(out / "guidance.png")
    shutil.rmtree(scratch, ignore_errors=True)


def _surveyed(folders: Mapping[str, Path]) -> tuple[dict[str, int], dict[str, pa.Table]]:
    """Numbers of pairs, and the held-out rows of each setting; the pictures of all others are left on disk.

    Of the held-out pairs, as many of each setting count as the setting with the fewest has.
    """
    training = quarantined = 0
    held_out = {}
    for setting, folder in folders.items():
        parts = []
        for part in stream_table(folder, CONTRACT, _ROWS):
            split = part.table["split"]
            training += pc.sum(pc.equal(split, "train")).as_py() or 0
            quarantined += len(part.quarantined)
            parts.append(part.table.filter(pc.equal(split, "val")))
        held_out[setting] = pa.concat_tables(parts, promote_options="permissive")
        if not held_out[setting].num_rows:
            raise ContractError(f"{folder} has no pair of the split val; synthesise more scenes.")
    of_each = min(table.num_rows for table in held_out.values())
    return {"training": training, "held_out": of_each * len(folders), "quarantined": quarantined}, held_out


def _training_parts(folders: Mapping[str, Path]) -> Iterator[Callable[[], list[Pair]]]:
    """The training pairs of all settings, part by part; their pictures are decoded when a part is called."""
    for folder in folders.values():
        for part in stream_table(folder, CONTRACT, _ROWS):
            yield partial(pairs_of, part.table, "train")


def _interleaved(folders: Mapping[str, Path], tables: Mapping[str, pa.Table], number: int) -> list[Pair]:
    """The first held-out pairs of all settings in turn, as many of each as the setting with the fewest has."""
    of_each = min(math.ceil(number / len(folders)), *(table.num_rows for table in tables.values()))
    pairs = [pairs_of(table.slice(0, of_each), "val") for table in tables.values()]
    return [pair for of_all in zip(*pairs, strict=True) for pair in of_all][:number]


def _with_decoder(
    planner: GoalPlanner, pairs: Sequence[Pair], config: FinetuneGoalPlanner, scratch: Path, run: Run
) -> AutoencoderKL:
    """Return the planner's autoencoder with a decoder fine-tuned on the pairs; a completed one is reused."""
    assert config.decoder is not None
    if not (scratch / "vae").is_dir():
        pictures = {picture.tobytes(): picture for pair in pairs for picture in (pair.input, pair.target)}
        with output_folder(scratch / "vae") as folder:
            train_decoder(
                planner.vae, np.stack([*pictures.values()]), config.decoder, seed=config.training.seed, log=run.log
            )
            planner.vae.save_pretrained(folder)
    return AutoencoderKL.from_pretrained(scratch / "vae", local_files_only=True).eval().requires_grad_(False)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="finetune_goal_planner", description=__doc__)
    parser.add_argument("--copaintings", required=True, type=Path, help="folder of the co-paintings of each setting")
    parser.add_argument("--settings", required=True, nargs="+")
    parser.add_argument("--base", required=True, type=Path)
    parser.add_argument("--out", required=True, type=Path)
    stage_main(main, parser)
