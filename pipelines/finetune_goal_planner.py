"""Fine-tune the goal planner's base on the co-paintings of all settings (thesis 6.4.2)."""

import argparse
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from diffusers import AutoencoderKL

from pentimento.contracts.copaintings import CONTRACT
from pentimento.contracts.errors import ContractError
from pentimento.contracts.images import write_png
from pentimento.contracts.ranges import at_least
from pentimento.contracts.tables import CheckedTable, read_table
from pentimento.copainting.goal.completions import Sampling, guidance_grid, score_planner
from pentimento.copainting.goal.denoising import GoalTraining, encode_pairs
from pentimento.copainting.goal.planner import GoalPlanner, load_goal_planner, save_goal_planner
from pentimento.copainting.goal.training import train_goal_planner
from pentimento.copainting.goal.vae import DecoderConfig, train_decoder
from pentimento.copainting.jobs import scratch_folder
from pentimento.copainting.scenes.edits import Pair, pairs_of
from pipelines._config import load_section
from pipelines._io import output_folder, single_threaded, stage_main, write_json
from pipelines._tracking import Run, input_digest, tracked_run

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
    digests = {name: input_digest(path) for name, path in inputs.items()}
    # Interrupted training can continue on other devices.
    anywhere = replace(config, training=replace(config.training, devices=1, strategy="auto"))
    scratch = scratch_folder(SCRATCH, "finetune_goal_planner", asdict(anywhere), digests)
    with (
        tracked_run("finetune_goal_planner", None, asdict(config), inputs) as run,
        output_folder(arguments.out) as out,
    ):
        tables = {setting: read_table(folder, CONTRACT) for setting, folder in folders.items()}
        planner = load_goal_planner(arguments.base)
        training = [pair for checked in tables.values() for pair in pairs_of(checked.table, "train")]
        held_out = _interleaved(folders, tables)
        before = score_planner(planner, held_out, config.sampling)
        if config.decoder is not None:
            planner.register_modules(vae=_with_decoder(planner, training, config, scratch, run))
        latents = encode_pairs(planner, training, config.training.precision)
        losses = train_goal_planner(planner, latents, config.training, scratch=scratch / "steps", log=run.log)
        grid = guidance_grid(planner, held_out[: config.sampling.shown], config.sampling)
        metrics: dict[str, Any] = {
            "held_out": {
                "base": asdict(before),
                "fine_tuned": asdict(score_planner(planner, held_out, config.sampling)),
            },
            "pairs": {
                "training": len(training),
                "held_out": len(held_out),
                "quarantined": sum(len(checked.quarantined) for checked in tables.values()),
            },
        }
        save_goal_planner(planner, out)
        write_png(out / "guidance.png", grid)
        write_json(out / "curve.json", {"loss": losses})
        write_json(out / "metrics.json", metrics)
        run.log_metrics(metrics)
        run.log_picture(out / "guidance.png")
    shutil.rmtree(scratch, ignore_errors=True)


def _interleaved(folders: Mapping[str, Path], tables: Mapping[str, CheckedTable]) -> list[Pair]:
    """The held-out pairs of all settings in turn, as many of each as the setting with the fewest has."""
    of_each = {setting: pairs_of(checked.table, "val") for setting, checked in tables.items()}
    for setting, pairs in of_each.items():
        if not pairs:
            raise ContractError(f"{folders[setting]} has no pair of the split val; synthesise more scenes.")
    return [pair for of_all in zip(*of_each.values(), strict=False) for pair in of_all]


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
