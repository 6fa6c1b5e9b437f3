"""Train the base of the goal planner on scenes of named things: its autoencoder, then its UNet in phases."""

import argparse
import shutil
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from diffusers import AutoencoderKL
from numpy.typing import NDArray

from pentimento.contracts.images import write_png
from pentimento.contracts.ranges import at_least
from pentimento.copainting.drawings.pairs import MEDIUM_WORDS, drawn_pairs
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
from pentimento.copainting.goal.vae import VaeConfig, ink_after_round_trip, stroke_picture, train_vae
from pentimento.copainting.jobs import scratch_folder
from pentimento.copainting.scenes.edits import Pair
from pentimento.semantics.encoder import Encoder
from pipelines._config import load_section
from pipelines._io import output_folder, single_threaded, stage_main, write_json
from pipelines._tracking import Run, input_digests, tracked_run
from pipelines.pretrain_goal_planner import SCRATCH

_HELD_OUT_SEED = 1_000_003  # of the pairs that are scored: not the seed of any phase
_STROKES_KEY = 7  # of the generators of random strokes, beside the seed


@dataclass(frozen=True)
class Phase:
    """A part of the training, with pairs of its own."""

    pairs: int
    blank_share: float
    """Of the pairs: those on a blank canvas."""
    training: GoalTraining

    def __post_init__(self) -> None:
        at_least(self, 1, "pairs")
        at_least(self, 0, "blank_share")
        if self.blank_share > 1:
            raise ValueError(f"blank_share is {self.blank_share}; give a fraction.")


@dataclass(frozen=True)
class TrainGoalBase:
    """Section `train_goal_base` of base/params.yaml."""

    side_px: int
    """Of the pictures."""
    start: str | None
    """Folder of a goal planner whose training goes on; null starts with new weights."""
    shape: GoalPlannerShape
    vae: VaeConfig
    vae_crop_px: int | None
    """Side of the squares that the autoencoder learns from: small ones allow more steps. Null: whole pictures."""
    phases: tuple[Phase, ...]
    """In order; each starts with the averaged weights of the one before."""
    sampling: Sampling
    threads: int
    """PyTorch's threads; last digits of results depend on the number."""

    def __post_init__(self) -> None:
        at_least(self, 32, "side_px")
        at_least(self, 1, "threads")


def main(arguments: argparse.Namespace) -> None:
    """Write `--out`: the pipeline in diffusers' layout, metrics.json, curve.json and the grid of guidances."""
    config = load_section(arguments.params, "train_goal_base", TrainGoalBase)
    single_threaded()
    torch.set_num_threads(config.threads)
    inputs = {"semantics": arguments.semantics}
    digests = input_digests(inputs)
    scratch = scratch_folder(SCRATCH, "train_goal_base", asdict(config), digests)
    with tracked_run("train_goal_base", None, asdict(config), inputs) as run, output_folder(arguments.out) as out:
        planner = _begun(Encoder.load(arguments.semantics), config, scratch, run)
        losses = [_trained(planner, config, number, scratch, run) for number in range(len(config.phases))]
        held_out = {
            split: drawn_pairs(
                config.sampling.scored,
                split,
                nouns_of("openmoji"),
                blank_share=0.3,
                side_px=config.side_px,
                seed=_HELD_OUT_SEED,
            )
            for split in ("train", "test")
        }
        metrics: dict[str, Any] = {
            "vae": ink_after_round_trip(planner.vae, [pair.target for pair in held_out["train"]], config.sampling.seed),
            "compositions": {
                name: asdict(score_planner(planner, held_out[split], config.sampling))
                for name, split in (("seen", "train"), ("held_out", "test"))
            },
            "parameters": {
                "unet": planner.unet.num_parameters(),
                "vae": planner.vae.num_parameters(),
                "text_encoder": planner.text_encoder.num_parameters(),
            },
        }
        save_goal_planner(planner, out)
        grid = guidance_grid(planner, held_out["test"][: config.sampling.shown], config.sampling)
        write_png(out / "guidance.png", grid)
        write_json(out / "curve.json", {"loss": losses})
        write_json(out / "metrics.json", metrics)
        run.log_metrics(metrics)
        run.log_picture(out / "guidance.png")
    shutil.rmtree(scratch, ignore_errors=True)


def _begun(encoder: Encoder, config: TrainGoalBase, scratch: Path, run: Run) -> GoalPlanner:
    """Return the planner before its first phase; a completed autoencoder is reused."""
    if config.start is not None:
        return load_goal_planner(config.start)
    seed = config.phases[0].training.seed
    if not (scratch / "vae").is_dir():
        with output_folder(scratch / "vae") as folder:
            pairs = drawn_pairs(
                config.vae.pictures,
                "train",
                nouns_of("openmoji"),
                blank_share=0.4,
                side_px=config.side_px,
                seed=seed,
            )
            pictures = _with_strokes(_mostly_in_colours(pairs), seed)
            half = config.phases[0].training.precision != "32-true"
            vae = train_vae(
                pictures, config.vae, seed, crop_px=config.vae_crop_px, teach_colours=True, half_precision=half,
                log=run.log,
            )  # fmt: skip
            vae.save_pretrained(folder)
    vae = AutoencoderKL.from_pretrained(scratch / "vae", local_files_only=True).eval().requires_grad_(False)
    return build_goal_planner(config.shape, vae, text_encoder_of(encoder.model), tokenizer=encoder.tokenizer, seed=seed)


def _mostly_in_colours(pairs: Sequence[Pair]) -> NDArray[np.uint8]:
    """Return the targets of all pairs in colours and of one in three others: lines are learned in fewer steps."""
    colours = MEDIUM_WORDS["colour"]
    return np.stack([p.target for n, p in enumerate(pairs) if p.caption.endswith(colours) or n % 3 == 0])


def _with_strokes(pictures: NDArray[np.uint8], seed: int) -> NDArray[np.uint8]:
    """Return pictures [N, H, W, 3] and a quarter as many of random strokes: what else a canvas may show."""
    generators = (np.random.default_rng([seed, _STROKES_KEY, index]) for index in range(len(pictures) // 4))
    strokes = [stroke_picture(pictures.shape[1], generator) for generator in generators]
    return np.concatenate([pictures, np.stack(strokes)]) if strokes else pictures


def _trained(planner: GoalPlanner, config: TrainGoalBase, number: int, scratch: Path, run: Run) -> list[float]:
    """Train the planner in place for phase `number`, or take its completed weights; return the losses."""
    phase, folder = config.phases[number], scratch / f"phase_{number}"
    if not folder.is_dir():
        pairs = encode_pairs(
            planner,
            drawn_pairs(
                phase.pairs,
                "train",
                nouns_of("openmoji"),
                blank_share=phase.blank_share,
                side_px=config.side_px,
                seed=phase.training.seed,
            ),
            phase.training.precision,
        )
        steps = scratch / f"phase_{number}_steps"

        def log(what: str, value: float, step: int) -> None:
            run.log(f"phase_{number}.{what}", value, step)

        done = train_goal_planner(planner, pairs, phase.training, scratch=steps, log=log)
        with output_folder(folder) as completed:
            states = {name: getattr(planner, name).state_dict() for name in ("unet", "text_encoder")}
            torch.save(states | {"losses": done}, completed / "trained.pt")
        shutil.rmtree(steps, ignore_errors=True)
    trained = torch.load(folder / "trained.pt", weights_only=True)
    for name in ("unet", "text_encoder"):
        getattr(planner, name).load_state_dict(trained[name])
    losses: list[float] = trained["losses"]
    return losses


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="train_goal_base", description=__doc__)
    parser.add_argument("--params", required=True, type=Path)
    parser.add_argument("--semantics", required=True, type=Path)
    parser.add_argument("--out", required=True, type=Path)
    stage_main(main, parser)
