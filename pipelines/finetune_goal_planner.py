"""Fine-tune the goal planner's base on one setting's co-paintings (thesis 6.4.2)."""

import argparse
import shutil
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import torch

from pentimento.contracts.copaintings import CONTRACT
from pentimento.contracts.errors import ContractError
from pentimento.contracts.images import write_png
from pentimento.contracts.ranges import at_least
from pentimento.contracts.tables import read_table
from pentimento.copainting.goal.completion_scores import score_planner
from pentimento.copainting.goal.guidance_grid import Sampling, guidance_grid
from pentimento.copainting.goal.latent_pairs import encode_pairs
from pentimento.copainting.goal.planner import load_goal_planner, save_goal_planner
from pentimento.copainting.goal.training import GoalTraining, train_goal_planner
from pentimento.copainting.scenes.edits import pairs_of
from pentimento.copainting.scratch import scratch_folder
from pipelines._config import load_section
from pipelines._io import output_folder, single_threaded, stage_main, write_json
from pipelines._tracking import input_digest, tracked_run

SCRATCH = Path(".pentimento/training")


@dataclass(frozen=True)
class FinetuneGoalPlanner:
    """Section `finetune_goal_planner` of params.yaml."""

    training: GoalTraining
    sampling: Sampling
    threads: int
    """PyTorch's; another number may give other last digits."""

    def __post_init__(self) -> None:
        at_least(self, 1, "threads")


def main(arguments: argparse.Namespace) -> None:
    """Write `--out`: the pipeline in diffusers' layout, metrics.json, curve.json and the grid of guidances."""
    config = load_section(Path("params.yaml"), "finetune_goal_planner", FinetuneGoalPlanner)
    single_threaded()
    torch.set_num_threads(config.threads)
    inputs = {"copaintings": arguments.copaintings, "base": arguments.base}
    digests = {name: input_digest(path) for name, path in inputs.items()}
    name = f"finetune_goal_planner@{arguments.setting}"
    scratch = scratch_folder(SCRATCH, name, asdict(config), digests)
    with (
        tracked_run("finetune_goal_planner", arguments.setting, asdict(config), inputs) as run,
        output_folder(arguments.out) as out,
    ):
        checked = read_table(arguments.copaintings, CONTRACT)
        planner = load_goal_planner(arguments.base)
        training, held_out = pairs_of(checked.table, "train"), pairs_of(checked.table, "val")
        if not held_out:
            raise ContractError(f"{arguments.copaintings} has no pair of the split val; synthesise more scenes.")
        before = score_planner(planner, held_out, config.sampling)
        losses = train_goal_planner(planner, encode_pairs(planner, training), config.training, scratch, run.log)
        grid = guidance_grid(planner, held_out[: config.sampling.shown], config.sampling)
        metrics: dict[str, Any] = {
            "held_out": {
                "base": asdict(before),
                "fine_tuned": asdict(score_planner(planner, held_out, config.sampling)),
            },
            "pairs": {
                "training": len(training),
                "held_out": len(held_out),
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


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="finetune_goal_planner", description=__doc__)
    parser.add_argument("--setting", required=True)
    parser.add_argument("--copaintings", required=True, type=Path)
    parser.add_argument("--base", required=True, type=Path)
    parser.add_argument("--out", required=True, type=Path)
    stage_main(main, parser)
