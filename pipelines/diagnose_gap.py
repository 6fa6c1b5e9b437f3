"""Diagnose the errors of one tool's base stroke model, and extend it by the established causes and a correction."""

import argparse
import json
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import NamedTuple

import pyarrow as pa
import torch

from pentimento.collection.follow import further_strokes
from pentimento.contracts.errors import ContractError
from pentimento.contracts.ranges import at_least
from pentimento.contracts.strokes import CONTRACT
from pentimento.contracts.tables import read_table
from pentimento.control.guard import GuardedRobot
from pentimento.control.safety import envelope_for
from pentimento.diagnosis.strokes.measured import covariates_of
from pentimento.diagnosis.strokes.problem import StrokeResult, established_mechanisms
from pentimento.diagnosis.strokes.write import diagnose_in_rounds, write_diagnosis
from pentimento.dynamics.strokes.evaluation import score, score_model
from pentimento.dynamics.strokes.extended import (
    MeasuredStrokes,
    StrokeModel,
    model_files,
    predict_strokes,
    timing_of,
)
from pentimento.dynamics.strokes.fit_correction import CorrectionFit, fit_correction
from pentimento.dynamics.strokes.joint import JointFit, fit_jointly
from pentimento.dynamics.strokes.paint_pickup import paint_pickup
from pentimento.dynamics.strokes.samples import load_samples
from pentimento.dynamics.strokes.simulation import Mechanism
from pentimento.dynamics.strokes.training import TrainingConfig, split_by_action
from pentimento.dynamics.strokes.traj2stroke import read_parameters
from pentimento.robots.tools import load_tool
from pentimento.robots.virtual import VirtualRobot
from pentimento.studio.strokes.studio import Studio
from pentimento.studio.strokes.world import load_world
from pipelines._config import load_section
from pipelines._io import output_folder, single_threaded, stage_main, verdict_metrics, write_json
from pipelines._tracking import Run, tracked_run


@dataclass(frozen=True)
class DiagnoseGap:
    """Section `diagnose_gap` of params.yaml."""

    seed: int
    """Of splits, bootstraps and the studio."""
    rounds: int
    """While a named cause has rivals, the robot makes the proposed strokes; at most so many times."""
    worlds: dict[str, str]
    """By tool, the studio's world of that robot; other tools get no further strokes."""
    joint_fit: TrainingConfig
    """Of the base with the established causes, and of the correction; `held_out` is the share used for validation."""

    def __post_init__(self) -> None:
        at_least(self, 0, "seed", "rounds")


def main(arguments: argparse.Namespace) -> None:
    """Write `--gap`: the verdict with its report; and `--out`: the extended model and metrics.json."""
    config = load_section(Path("params.yaml"), "diagnose_gap", DiagnoseGap)
    single_threaded()
    inputs = {"strokes": arguments.strokes, "base": arguments.base}
    with (
        tracked_run("diagnose_gap", arguments.tool, asdict(config), inputs) as run,
        output_folder(arguments.gap) as gap,
        output_folder(arguments.out) as out,
    ):
        table, fit = read_table(arguments.strokes, CONTRACT).table, config.joint_fit
        base = read_parameters(arguments.base / "parameters.json")
        samples = load_samples(table, fit.path_points, fit.pixels_per_m, fit.margin_m)
        known = covariates_of(table) | paint_pickup(table, samples)
        columns = {name: torch.tensor(v, dtype=torch.float32) for name, v in known.items()}
        strokes = MeasuredStrokes(samples, columns)
        training, validation, held_out = _parts(strokes, arguments.base / "held_out_actions.json", fit)
        found = _diagnosed(table, gap, arguments.tool, config)

        def fitted(causes: Sequence[Mechanism]) -> JointFit:
            timing = timing_of(columns)
            return fit_jointly(base, causes, training, validation=validation, timing=timing, config=fit, log=run.log)

        joint = _best_fit(found, fitted)
        seen = strokes.pick(torch.nonzero(~torch.isin(samples.action, held_out.samples.action)).flatten())
        corrected = fit_correction(joint.model, seen, config=fit, log=run.log)
        metrics = verdict_metrics(gap / "verdict.json") | {
            "held_out": {
                "base": asdict(score_model(base, held_out.samples)),
                "uncorrected": _scores(joint.model, held_out),
                "extended": _scores(corrected.model, held_out),
            },
            "joint_fit": {
                "kept": joint.kept,
                "causes": len(joint.model.mechanisms),
                "validation_l1": {"base": joint.validation_l1[0], "extended": joint.validation_l1[1]},
            },
            "correction": {
                "share": corrected.share,
                "cross_fitted_l1": {"without": corrected.held_out_l1[0], "with": corrected.held_out_l1[1]},
            },
        }
        for name, content in model_files(corrected.model).items():
            write_json(out / name, content)
        write_json(out / "metrics.json", metrics)
        run.log_metrics(metrics)
        print(_summary(found, joint), _said(corrected), file=sys.stderr)
        _log_candidates(run, found)


def _diagnosed(table: pa.Table, gap: Path, tool_name: str, config: DiagnoseGap) -> StrokeResult:
    """The last of the diagnoses; with further strokes, ``gap`` has their table, too."""

    def diagnosed(grown: pa.Table, note: str | None) -> StrokeResult:
        return write_diagnosis(grown, gap, config.seed, log=_log, left_out=note)

    if tool_name not in config.worlds:
        return diagnosed(table, None)
    tool = load_tool(tool_name)
    robot = VirtualRobot(Studio(load_world(config.worlds[tool_name]), config.seed))
    made = further_strokes(
        GuardedRobot(robot, envelope_for(tool, robot.canvas_size_m)), tool, f"{tool_name}-{config.seed}"
    )
    return diagnose_in_rounds(table, gap, config.rounds, diagnosed=diagnosed, made=made, log=_log)


def _log(line: str) -> None:
    print(line, file=sys.stderr)


def _best_fit(found: StrokeResult, fitted: Callable[[Sequence[Mechanism]], JointFit]) -> JointFit:
    """Return the fit with the established causes; or with the suspected ones, too, if validation strokes gain by them.

    A name must be right; a plan needs the best prediction.
    """
    joint = fitted(established_mechanisms(found))
    if not found.suspected:
        return joint
    wider = fitted(established_mechanisms(found, suspected=True))
    least = joint.validation_l1[1] if joint.kept else joint.validation_l1[0]
    return wider if wider.kept and wider.validation_l1[1] < least else joint


class _Parts(NamedTuple):
    """Strokes by what they are used for; the base was trained on the first two."""

    training: MeasuredStrokes
    validation: MeasuredStrokes
    held_out: MeasuredStrokes


def _parts(strokes: MeasuredStrokes, held_out_actions: Path, config: TrainingConfig) -> _Parts:
    held_out = torch.tensor(json.loads(held_out_actions.read_text(encoding="utf-8")))
    action = strokes.samples.action
    known = torch.nonzero(~torch.isin(action, held_out)).flatten()
    if len(known) == len(action):
        raise ContractError(f"None of the actions in {held_out_actions} is among the strokes: train the base on them.")
    _, validating = split_by_action(strokes.samples.pick(known), config.held_out, config.seed)
    validates = torch.isin(action, validating.action)
    unseen = torch.isin(action, held_out)
    parts = (~unseen & ~validates, validates, unseen)
    return _Parts(*(strokes.pick(torch.nonzero(part).flatten()) for part in parts))


def _scores(model: StrokeModel, strokes: MeasuredStrokes) -> dict[str, float]:
    return asdict(score(predict_strokes(model, strokes), strokes.samples))


def _said(corrected: CorrectionFit) -> str:
    before, after = corrected.held_out_l1
    if corrected.share == 0:
        return "A learned correction does not lower the weighted L1 of held-out actions, so the model has none."
    return (
        f"The learned correction, scaled by {corrected.share:.0%}, lowers the weighted L1 of held-out actions from "
        f"{before:.4g} to {after:.4g}."
    )


def _summary(found: StrokeResult, joint: JointFit) -> str:
    causes = ", ".join(mechanism.cause for mechanism in established_mechanisms(found)) or "none"
    base, extended = joint.validation_l1
    if joint.kept:
        used = ", ".join(mechanism.cause for mechanism in joint.model.mechanisms)
        result = f"Fitted with {used}, the weighted L1 of validation strokes falls from {base:.4g} to {extended:.4g}."
    elif causes == "none":
        result = "The base model is unchanged."
    elif extended == base:
        result = "The base model already contains them and is unchanged."
    else:
        result = f"Fitted with them, the weighted L1 of validation rises from {base:.4g} to {extended:.4g}: not used."
    return f"Established causes: {causes}. {result}"


def _log_candidates(run: Run, found: StrokeResult) -> None:
    """Log a child run for each candidate cause, with its evidence."""
    for status, findings in (("established", found.established), ("suspected", found.suspected)):
        for finding in findings:
            low, high = finding.gain_interval
            values = {"probability": finding.probability, "gain": finding.gain, "gain_low": low, "gain_high": high}
            _log_candidate(run, finding.cause, values | finding.evidence._asdict(), verdict=status)
    error = float(found.known.losses(found.decided.model).mean())
    for cause, test in found.others.items():
        _log_candidate(run, cause, {"p": test.p, "gain": test.gain / error}, verdict="not established")
    for cause, reason in found.known.unobservable.items():
        run.log_child(cause, {}, {"cause": cause, "verdict": "not observable", "reason": reason})


def _log_candidate(run: Run, cause: str, values: Mapping[str, float], *, verdict: str) -> None:
    run.log_child(cause, {name: {0: value} for name, value in values.items()}, {"cause": cause, "verdict": verdict})


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="diagnose_gap", description=__doc__)
    parser.add_argument("--tool", required=True)
    parser.add_argument("--strokes", required=True, type=Path)
    parser.add_argument("--base", required=True, type=Path, help="the stroke model of train_stroke_dynamics")
    parser.add_argument("--gap", required=True, type=Path, help="folder for the verdict")
    parser.add_argument("--out", required=True, type=Path, help="folder for the extended model")
    stage_main(main, parser)
