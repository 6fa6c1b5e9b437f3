"""Train Traj2Stroke on one tool's strokes, and fit its baseline, a polyline of constant width."""

import argparse
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from pentimento.contracts.strokes import CONTRACT
from pentimento.contracts.tables import read_table
from pentimento.dynamics.strokes.evaluation import (
    StrokeScores,
    blank,
    fit_polyline,
    mean_iou,
    mean_squared_error,
    predict_with,
    score,
    score_model,
)
from pentimento.dynamics.strokes.resolution import Sampling
from pentimento.dynamics.strokes.samples import StrokeSamples, load_samples, sampling_of
from pentimento.dynamics.strokes.training import TrainingConfig, split_by_action, train
from pentimento.dynamics.strokes.traj2stroke import Traj2StrokeParameters
from pipelines._config import load_section
from pipelines._io import output_folder, single_threaded, stage_main, write_json
from pipelines._tracking import tracked_run


def main(arguments: argparse.Namespace) -> None:
    """Write `--out`: the model, both polylines, metrics.json, curve.json, held_out_actions.json, card.md."""
    config = load_section(Path("params.yaml"), "train_stroke_dynamics", TrainingConfig)
    single_threaded()
    with (
        tracked_run("train_stroke_dynamics", arguments.tool, asdict(config), {"strokes": arguments.strokes}) as run,
        output_folder(arguments.out) as out,
    ):
        checked = read_table(arguments.strokes, CONTRACT)
        sampling = sampling_of(checked.table, config.pixels_per_m, config.margin_m)
        samples = load_samples(checked.table, config.path_points, sampling.pixels_per_m, sampling.margin_m)
        training, held_out = split_by_action(samples, config.held_out, config.seed)
        curve = Curve(run.log)
        parameters = train(training, config, curve.log).parameters_si()
        half_width_m = sampling.line_width_m / 2
        polyline = fit_polyline(lambda pen: mean_squared_error(predict_with(pen, training), training), half_width_m)
        # The polyline of minimum MSE may be too faint to count as ink, so the IoU has a baseline of its own.
        crisp = fit_polyline(lambda pen: -mean_iou(predict_with(pen, training), training), half_width_m)
        metrics: dict[str, Any] = {
            "training": _scores(parameters, polyline, crisp, training),
            "held_out": _scores(parameters, polyline, crisp, held_out),
            "strokes": {
                "training": len(training.path),
                "held_out": len(held_out.path),
                "quarantined": len(checked.quarantined),
            },
            "sampling": asdict(sampling),
        }
        write_json(out / "parameters.json", asdict(parameters))
        write_json(out / "polyline.json", asdict(polyline))
        write_json(out / "polyline_for_iou.json", asdict(crisp))
        write_json(out / "metrics.json", metrics)
        write_json(out / "curve.json", {"epoch": curve.steps, "weighted_l1": curve.values})
        write_json(out / "held_out_actions.json", sorted(set(held_out.action.tolist())))
        (out / "card.md").write_text(_card(arguments.tool, sampling, metrics["held_out"]), encoding="utf-8")
        run.log_metrics(metrics)
        run.log_items("held_out.model.mse", *_mse_by_action(parameters, held_out))


class Curve:
    """A curve that is logged to MLflow and kept for the report."""

    def __init__(self, log: Callable[[str, float, int], None]) -> None:
        self._log = log
        self.steps: list[int] = []
        self.values: list[float] = []

    def log(self, name: str, value: float, step: int) -> None:
        self._log(name, value, step)
        self.steps.append(step)
        self.values.append(value)


def _scores(
    model: Traj2StrokeParameters,
    polyline: Traj2StrokeParameters,
    crisp: Traj2StrokeParameters,
    samples: StrokeSamples,
) -> dict[str, dict[str, float]]:
    """Return scores of the model and its baselines; each score of the polyline is that of the pen fitted for it."""
    scores: dict[str, StrokeScores] = {
        "model": score_model(model, samples),
        "polyline": replace(score_model(polyline, samples), iou=score_model(crisp, samples).iou),
        "blank": score(blank(samples), samples),
    }
    return {name: asdict(value) for name, value in scores.items()}


def _card(tool: str, sampling: Sampling, held_out: dict[str, dict[str, float]]) -> str:
    """Return the sampling and the scores on held-out strokes, both taken at it, as Markdown."""
    rows = [
        f"| {name} | {each['iou']:.3f} | {each['l1']:.4f} | {each['mse']:.5f} |\n" for name, each in held_out.items()
    ]
    table = "".join(["| | IoU | L1 | MSE |\n|---|---|---|---|\n", *rows])
    return f"# Stroke model of the {tool}\n\n{sampling.sentence}\n\nOn held-out strokes, at this resolution:\n\n{table}"


def _mse_by_action(model: Traj2StrokeParameters, samples: StrokeSamples) -> tuple[list[int], list[float]]:
    """Return actions and the mean squared error of each over its window and repeats, to compare runs by."""
    error = (predict_with(model, samples) - samples.after).square().mean(-1)
    of_stroke = (error * samples.valid).flatten(1).sum(1) / samples.valid.flatten(1).sum(1)
    actions = sorted(set(samples.action.tolist()))
    return actions, [float(of_stroke[samples.action == action].mean()) for action in actions]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="train_stroke_dynamics", description=__doc__)
    parser.add_argument("--tool", required=True)
    parser.add_argument("--strokes", required=True, type=Path)
    parser.add_argument("--out", required=True, type=Path)
    stage_main(main, parser)
