"""Train param2deform on one material's pushes, and score it beside baselines and the noise floor of repeats."""

import argparse
import json
import sys
from dataclasses import asdict, replace
from pathlib import Path
from typing import Literal

import numpy as np
import torch

from pentimento.contracts.images import write_png
from pentimento.contracts.pushes import CONTRACT
from pentimento.contracts.tables import read_table
from pentimento.dynamics.pushes.evaluation import comparison, predict, scores
from pentimento.dynamics.pushes.measured import PushSamples, load_pushes
from pentimento.dynamics.pushes.pose import height_errors, in_pose
from pentimento.dynamics.pushes.push_model import PushModel, write_push_model
from pentimento.dynamics.pushes.training import TrainingConfig, crop_for, split_by_action, train
from pentimento.dynamics.pushes.uncertainty import fit_intervals, fit_unexplained, pixels_of
from pentimento.planning.pushes.place_fit import fit_places, rows_of_places
from pentimento.planning.pushes.places import FILE as PLACES
from pentimento.planning.pushes.places import place_model_bytes
from pipelines._config import load_section
from pipelines._io import output_folder, single_threaded, stage_main, write_json
from pipelines._tracking import tracked_run

_SHOWN = 8


def main(arguments: argparse.Namespace) -> None:
    """Write `--out`: the model, metrics.json, curve.json, held_out_actions.json, held_out.png.

    With placed pellets in the table also places.json, the place model.
    """
    config = load_section(Path("params.yaml"), "train_push_dynamics", TrainingConfig)
    single_threaded()
    with (
        tracked_run("train_push_dynamics", arguments.material, asdict(config), {"pushes": arguments.pushes}) as run,
        output_folder(arguments.out) as out,
    ):
        checked = read_table(arguments.pushes, CONTRACT)
        samples, repairs = load_pushes(checked.table, config.pixels_per_m)
        for sentence in repairs.sentences():
            print(sentence, file=sys.stderr)
        training, held_out = split_by_action(samples, config.held_out, config.seed)
        crop = crop_for(samples, config)
        curve: list[float] = []

        def log(name: str, value: float, step: int) -> None:
            run.log(name, value, step)
            curve.append(value)

        context = (str(samples.material[0]), str(samples.tool[0]))
        kind: Literal["push", "pinch"] = "push" if samples.kind[0] == "push" else "pinch"
        model = train(in_pose(training, crop), kind, [context], crop=crop, config=config, log=log)
        unseen = in_pose(held_out, crop)
        left, pixels = fit_unexplained(model, unseen), pixels_of(model, unseen)
        model.facts = replace(model.facts, unexplained=left)
        metrics = scores(model, training, held_out, all_samples=samples) | {
            "unexplained": asdict(left),
            "pushes": {
                "training": len(training.before),
                "held_out": len(held_out.before),
                "quarantined": len(checked.quarantined) + len(repairs.bad),
                "copies": len(repairs.copies),
                "tilted": repairs.tilted,
                "holes": repairs.holes,
            },
        }
        if pixels.moved.any():
            metrics["intervals"] = asdict(fit_intervals(pixels))
        if rows_of_places(checked.table).num_rows:
            places = fit_places(checked.table)
            (out / PLACES).write_bytes(place_model_bytes(places))
            metrics["places"] = {name: getattr(places, name) for name in ("places", "kept", "unexplained")}
        write_push_model(model, out)
        write_json(out / "metrics.json", metrics)
        write_json(out / "curve.json", {"epoch": list(range(len(curve))), "loss": curve})
        write_json(out / "held_out_actions.json", sorted(set(held_out.action_id.tolist())))
        write_png(out / "held_out.png", _picture(model, held_out))
        run.log_metrics(json.loads((out / "metrics.json").read_text(encoding="utf-8")))
        run.log_items("held_out.model.window_l_3d_mm2", *_error_by_action(model, held_out))
        run.log_picture(out / "held_out.png")


def _error_by_action(model: PushModel, samples: PushSamples) -> tuple[list[int], list[float]]:
    """Return actions and the L_3D [mm²] of each over the window and its repeats, to compare runs by."""
    error = height_errors(predict(model, samples) - torch.from_numpy(samples.after), torch.from_numpy(samples.known))
    actions = sorted(set(samples.action_id.tolist()))
    return actions, [float(error[torch.from_numpy(samples.action_id == action)].mean()) for action in actions]


def _picture(model: PushModel, held_out: PushSamples) -> np.ndarray:
    """Return a picture of held-out pushes, spread over the recording."""
    some = held_out.pick(np.unique(np.linspace(0, len(held_out.before) - 1, _SHOWN).round().astype(int)))
    return comparison(
        some.before, some.after, predict(model, some).numpy(), known=some.known, pixels_per_m=some.pixels_per_m
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="train_push_dynamics", description=__doc__)
    parser.add_argument("--material", required=True)
    parser.add_argument("--pushes", required=True, type=Path)
    parser.add_argument("--out", required=True, type=Path)
    stage_main(main, parser)
