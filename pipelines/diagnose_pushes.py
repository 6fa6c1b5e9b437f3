"""Diagnose the errors of an analytic push model of one material, and correct the network by the causes."""

import argparse
import json
import shutil
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from pentimento.contracts.errors import ContractError
from pentimento.contracts.pushes import CONTRACT
from pentimento.contracts.ranges import at_least
from pentimento.contracts.tables import read_table
from pentimento.diagnosis.pushes.measured import PIXELS_PER_M
from pentimento.diagnosis.pushes.write import (
    ValidatedCorrection,
    averaged,
    validate_correction,
    write_push_diagnosis,
)
from pentimento.dynamics.pushes.evaluation import predict
from pentimento.dynamics.pushes.measured import load_pushes
from pentimento.dynamics.pushes.push_model import read_push_model, write_push_model
from pentimento.planning.pushes.analytic.correction import FILE, correction_as_json
from pentimento.planning.pushes.places import FILE as PLACES
from pipelines._config import load_section
from pipelines._io import output_folder, single_threaded, stage_main, verdict_metrics, write_json
from pipelines._tracking import tracked_run

_UNDIAGNOSED = (
    "Pinches are not diagnosed: the analytic model knows the geometry of pushes alone. The network stays as it is."
)


@dataclass(frozen=True)
class DiagnosePushes:
    """Section `diagnose_pushes` of params.yaml."""

    seed: int
    """Of splits and bootstraps."""

    def __post_init__(self) -> None:
        at_least(self, 0, "seed")


def main(arguments: argparse.Namespace) -> None:
    """Write `--gap`: the verdict with its report; and `--out`: the push model to plan with, metrics.json."""
    config = load_section(Path("params.yaml"), "diagnose_pushes", DiagnosePushes)
    single_threaded()
    inputs = {"pushes": arguments.pushes, "base": arguments.base}
    inputs |= {f"run_{number}": folder for number, folder in enumerate(arguments.runs)}
    with (
        tracked_run("diagnose_pushes", arguments.material, asdict(config), inputs) as run,
        output_folder(arguments.gap) as gap,
        output_folder(arguments.out) as out,
    ):
        table = with_runs(read_table(arguments.pushes, CONTRACT).table, arguments.runs)
        network = read_push_model(arguments.base)
        write_push_model(network, out)
        unseen = arguments.base / "held_out_actions.json"
        for file in (unseen, arguments.base / PLACES):
            if file.is_file():
                shutil.copyfile(file, out / file.name)
        if network.facts.kind == "pinch":
            write_json(gap / "verdict.json", {"text": _UNDIAGNOSED})
            write_json(out / "metrics.json", {"correction_kept": False})
            print(_UNDIAGNOSED, file=sys.stderr)
            return
        found = write_push_diagnosis(table, gap, config.seed, log=lambda line: print(line, file=sys.stderr))
        samples, _ = load_pushes(table, network.facts.crop.pixels_per_m)
        held_out = np.array(json.loads(unseen.read_text(encoding="utf-8")))
        if not np.isin(held_out, samples.action_id).any():
            raise ContractError(f"None of the actions in {unseen} is among the pushes: train the base on them.")
        predicted = averaged(predict(network, samples).numpy(), samples.pixels_per_m)
        fine = load_pushes(table, PIXELS_PER_M)[0]
        fitted = validate_correction(found, fine, predicted, held_out=held_out, seed=config.seed)
        if fitted.correction is not None:
            write_json(out / FILE, correction_as_json(fitted.correction))
        metrics = verdict_metrics(gap / "verdict.json", "_mm2") | _cross_fit_metrics(fitted)
        write_json(out / "metrics.json", metrics)
        run.log_metrics(metrics)
        print(_summary(fitted), file=sys.stderr)


def with_runs(table: pa.Table, runs: Sequence[Path]) -> pa.Table:
    """The pushes of a collection, followed by those that the runner recorded in these folders.

    Each run is a session of its own, and none of its actions repeats one of the collection.

    Raises:
        ContractError: a run is of another material or end-effector.
    """
    parts = [table]
    for number, folder in enumerate(runs):
        rows = read_table(folder, CONTRACT).table
        for name in ("material", "tool"):
            known, found = (set(part[name].to_pylist()) for part in (table, rows))
            if found - known:
                raise ContractError(
                    f"{folder} holds pushes of the {name} {', '.join(sorted(found - known))} and the collection of "
                    f"{', '.join(sorted(known))}: diagnose them apart, or leave it out of --runs."
                )
        first = 1 + max(pc.max(part["action_id"]).as_py() for part in parts)
        for name, values in (
            ("action_id", pc.add(rows["action_id"], pa.scalar(first, pa.int32()))),
            ("session", pc.binary_join_element_wise(f"run_{number}", rows["session"], "_")),
        ):
            at = rows.schema.get_field_index(name)
            rows = rows.set_column(at, rows.schema.field(at), values)
        parts.append(rows)
    return pa.concat_tables(parts, promote_options="permissive")


def _cross_fit_metrics(fitted: ValidatedCorrection) -> dict[str, Any]:
    alone, planned = fitted.held_out
    metrics: dict[str, Any] = {
        "correction_kept": fitted.correction is not None,
        "held_out": {"network_mm2": alone, "planned_mm2": planned},
    }
    if fitted.deciding is not None:
        metrics["deciding"] = {"network_mm2": fitted.deciding[0], "corrected_mm2": fitted.deciding[1]}
    return metrics


def _summary(fitted: ValidatedCorrection) -> str:
    if fitted.deciding is None:
        return "No established cause is hidden from the network: it stays as it is."
    alone, with_it = fitted.deciding
    causes = ", ".join(fitted.causes)
    if fitted.correction is None:
        return f"Corrected by {causes} the network fares no better ({alone:.4g}, then {with_it:.4g} mm²): it stays."
    return f"Corrected by {causes} the network's error on held-out pushes falls from {alone:.4g} to {with_it:.4g} mm²."


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="diagnose_pushes", description=__doc__)
    parser.add_argument("--material", required=True)
    parser.add_argument("--pushes", required=True, type=Path)
    parser.add_argument(
        "--runs",
        nargs="*",
        default=[],
        type=Path,
        help="folders `pushes` of sculptures by `pentimento run`",
    )
    parser.add_argument("--base", required=True, type=Path, help="the push model of train_push_dynamics")
    parser.add_argument("--gap", required=True, type=Path, help="folder for the verdict")
    parser.add_argument("--out", required=True, type=Path, help="folder for the push model that is planned with")
    stage_main(main, parser)
