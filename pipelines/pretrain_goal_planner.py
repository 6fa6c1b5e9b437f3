"""Provide the base of the goal planner: a small Instruct-Pix2Pix trained on scene edits, or the published one."""

import argparse
import shutil
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import pyarrow as pa
import torch
from diffusers import AutoencoderKL

from pentimento.contracts.images import decode_png, write_png
from pentimento.contracts.ranges import at_least
from pentimento.contracts.scenes import CONTRACT
from pentimento.contracts.tables import read_table
from pentimento.copainting.drawings.pairs import drawn_pairs
from pentimento.copainting.drawings.sources import nouns_of
from pentimento.copainting.goal.completions import Sampling, guidance_grid, score_planner
from pentimento.copainting.goal.denoising import GoalTraining, encode_pairs
from pentimento.copainting.goal.planner import (
    GoalPlanner,
    GoalPlannerShape,
    build_goal_planner,
    load_goal_planner,
    save_goal_planner,
    text_encoder_of,
)
from pentimento.copainting.goal.training import train_goal_planner
from pentimento.copainting.goal.vae import VaeConfig, ink_after_round_trip, train_vae, vae_pictures
from pentimento.copainting.jobs import scratch_folder
from pentimento.copainting.scenes.collage import shows_named_things
from pentimento.copainting.scenes.edits import Pair, scene_edits, scenes_of
from pentimento.semantics.encoder import Encoder
from pipelines._config import load_section, shipped
from pipelines._io import output_folder, single_threaded, stage_main, write_json
from pipelines._tracking import Run, input_digests, tracked_run

SCRATCH = Path(".pentimento/training")
_BLANK_SHARE = 0.3  # of the windows with named things: the canvas is blank


@dataclass(frozen=True)
class PretrainGoalPlanner:
    """Section `pretrain_goal_planner` of params.yaml."""

    from_pretrained: str | None
    """`base` for the one that ships, a folder in diffusers' layout, or a downloaded model (timbrooks/instruct-pix2pix);
    null trains one.
    """
    scenes: int
    """Maximum number of training scenes."""
    edits: int
    """Edits of each scene."""
    shape: GoalPlannerShape
    vae: VaeConfig
    training: GoalTraining
    sampling: Sampling
    threads: int
    """PyTorch's threads for all devices together; last digits of results depend on the number."""

    def __post_init__(self) -> None:
        at_least(self, 1, "scenes", "edits", "threads")


def main(arguments: argparse.Namespace) -> None:
    """Write `--out`: the pipeline in diffusers' layout, metrics.json, curve.json and the grid of guidances."""
    config = load_section(Path("params.yaml"), "pretrain_goal_planner", PretrainGoalPlanner)
    published = shipped(config.from_pretrained, arguments.base, "goal")
    single_threaded()
    torch.set_num_threads(config.threads)
    inputs = {"scenes": arguments.scenes, "semantics": arguments.semantics}
    digests = input_digests(inputs)
    # Interrupted training can continue on other devices.
    anywhere = replace(config, training=replace(config.training, devices=1, strategy="auto"))
    scratch = scratch_folder(SCRATCH, "pretrain_goal_planner", asdict(anywhere), digests)
    with (
        tracked_run("pretrain_goal_planner", None, asdict(config), inputs) as run,
        output_folder(arguments.out) as out,
    ):
        checked = read_table(arguments.scenes, CONTRACT)
        training, held_out = scenes_of(checked.table, "train").slice(0, config.scenes), scenes_of(checked.table, "val")
        losses: list[float] = []
        if published is not None:
            planner = load_goal_planner(published)
        else:
            planner, losses = _trained(training, Encoder.load(arguments.semantics), config, scratch, run)
        edits = _edits(held_out, "test", 1, config.training.seed)
        grid = guidance_grid(planner, edits[: config.sampling.shown], config.sampling)
        pictures = [edit.target for edit in edits]
        metrics: dict[str, Any] = {
            "vae": ink_after_round_trip(planner.vae, pictures, config.training.seed),
            "held_out": asdict(score_planner(planner, edits, config.sampling)),
            "parameters": {
                "unet": planner.unet.num_parameters(),
                "vae": planner.vae.num_parameters(),
                "text_encoder": planner.text_encoder.num_parameters(),
            },
            "scenes": {
                "training": training.num_rows,
                "held_out": held_out.num_rows,
                "quarantined": len(checked.quarantined),
            },
        }
        save_goal_planner(planner, out)
        write_png(out / "guidance.png", grid)
        write_json(out / "curve.json", {"loss": losses})
        write_json(out / "metrics.json", metrics)
        run.log_metrics(metrics)
        run.log_picture(out / "guidance.png")
    shutil.rmtree(scratch, ignore_errors=True)


def _edits(scenes: pa.Table, split: str, variants: int, seed: int) -> list[Pair]:
    """`variants` edits of each scene; for named things, as many windows with one more thing."""
    if not shows_named_things(scenes):
        return scene_edits(scenes, variants, seed)
    side = decode_png(scenes["image"][0].as_py()["bytes"]).shape[0]
    count = variants * scenes.num_rows
    return drawn_pairs(count, split, nouns_of("openmoji"), blank_share=_BLANK_SHARE, side_px=side, seed=seed)


def _trained(
    scenes: pa.Table, encoder: Encoder, config: PretrainGoalPlanner, scratch: Path, run: Run
) -> tuple[GoalPlanner, list[float]]:
    """Train the autoencoder, then the UNet with the encoder's text tower; completed parts are reused."""
    seed = config.training.seed
    if not (scratch / "vae").is_dir():
        pictures = [decode_png(row["bytes"]) for row in scenes["image"].slice(0, config.vae.pictures).to_pylist()]
        with output_folder(scratch / "vae") as folder:
            train_vae(vae_pictures(pictures, seed), config.vae, seed, log=run.log).save_pretrained(folder)
    vae = AutoencoderKL.from_pretrained(scratch / "vae", local_files_only=True).eval().requires_grad_(False)
    planner = build_goal_planner(
        config.shape, vae, text_encoder_of(encoder.model), tokenizer=encoder.tokenizer, seed=seed
    )
    pairs = encode_pairs(planner, _edits(scenes, "train", config.edits, seed), config.training.precision)
    return planner, train_goal_planner(planner, pairs, config.training, scratch=scratch / "steps", log=run.log)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="pretrain_goal_planner", description=__doc__)
    parser.add_argument("--scenes", required=True, type=Path)
    parser.add_argument("--semantics", required=True, type=Path)
    parser.add_argument("--base", type=Path, help="folder of the base that ships, for `from_pretrained: base`")
    parser.add_argument("--out", required=True, type=Path)
    stage_main(main, parser)
