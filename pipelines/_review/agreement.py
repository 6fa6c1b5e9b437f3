"""Agreement of MLflow's runs with dvc.lock, and the tags that link one to the other."""

import json
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from graphlib import TopologicalSorter
from pathlib import Path
from typing import Any

from pentimento.contracts.errors import PentimentoError
from pipelines._dvc import ask_dvc
from pipelines._params import read_yaml
from pipelines._review.history import History, StageRun
from pipelines._review.models import log_models
from pipelines._review.view import share_view
from pipelines._tracking.dvc_files import locked_stages, matrix_items, value_digest
from pipelines._tracking.store import open_store, store_errors

OUTPUT = "output:"
"""Prefix of the tags with the MD5 of a run's outputs, by path."""
_MAX_FILES = 4
"""Named in a sentence."""


@dataclass(frozen=True)
class Locked:
    """A stage item in dvc.lock, as DVC last ran it or found it in its cache."""

    stage: str
    item: str
    """Empty where the stage has no matrix."""
    inputs: dict[str, str]
    """MD5 by path, code included."""
    params_md5: str
    outputs: dict[str, str]
    """MD5 by path."""

    @property
    def name(self) -> str:
        """As DVC writes it."""
        return f"{self.stage}@{self.item}" if self.item else self.stage


def read_lock(folder: Path) -> list[Locked]:
    """Return the items of dvc.lock in `folder` whose stages are in dvc.yaml; empty where no stage has run yet."""
    locked = locked_stages(folder)
    if not locked:
        return []
    stages = read_yaml(folder / "dvc.yaml").get("stages", {})
    items = {stage: {str(item) for axis in matrix_items(folder, stage).values() for item in axis} for stage in stages}
    found = []
    for name, entry in locked.items():
        stage, _, item = name.partition("@")
        if stage in stages and (item in items[stage] if items[stage] else not item):
            params = value_digest(entry.get("params", {}).get("params.yaml", {}))
            found.append(Locked(stage, item, _digests(entry, "deps"), params, _digests(entry, "outs")))
    return found


def _digests(entry: dict[str, list[dict[str, str]]], part: str) -> dict[str, str]:
    return {each["path"]: str(each["md5"]) for each in entry.get(part, []) if "md5" in each}


def differences(locked: Locked, run: StageRun) -> list[str]:
    """Return the differences between a run and dvc.lock as phrases; a run without `params_md5` differs."""
    found = []
    for path, digest in run.inputs.items():
        if path in locked.inputs and locked.inputs[path] != digest:
            found.append(f"read another {path} ({digest[:8]}, dvc.lock: {locked.inputs[path][:8]})")
    if run.tags.get("params_md5") != locked.params_md5:
        found.append(f"ran with other parameters than dvc.lock has in section {locked.stage}")
    for path, digest in locked.outputs.items():
        recorded = run.tags.get(f"{OUTPUT}{path}", digest)
        if recorded != digest:
            found.append(f"wrote another {path} ({recorded[:8]}, dvc.lock: {digest[:8]})")
    return found


def producer_of(locked: Locked, runs: Sequence[StageRun]) -> StageRun | None:
    """Return the newest finished run (`runs` are newest first) that agrees with dvc.lock."""
    return next((run for run in runs if _finished(locked, run) and not differences(locked, run)), None)


def check(folder: Path, profile: str, stage: str | None = None) -> tuple[dict[str, str], list[str]]:
    """Compare each item of dvc.lock in `folder`, or those of `stage`, with MLflow's runs under `profile`.

    Returns:
        The id of its run for each item that agrees, and a sentence for each other item.
    """
    with store_errors():
        runs = [run for run in History().runs if run.tags.get("profile") == profile]
    agreeing, sentences = dict[str, str](), []
    for locked in read_lock(folder):
        if stage not in (None, locked.stage, locked.name):
            continue
        latest = next((run for run in runs if _finished(locked, run)), None)
        if latest is None:
            sentences.append(
                f"{locked.name}: MLflow has no finished run of it; `dvc repro --force --single-item {locked.name}` "
                "makes one."
            )
        elif (producer := producer_of(locked, runs)) is None:
            sentences.append(
                f"{locked.name}: its last run {latest.id[:8]} {'; it '.join(differences(locked, latest))}."
            )
        else:
            agreeing[locked.name] = producer.id
    return agreeing, sentences


def altered(folder: Path) -> dict[str, str]:
    """Return a sentence for each stage item whose outputs in `folder` are not those of dvc.lock, by its name.

    DVC compares them, by the MD5 of each file whose time or size has changed.
    """
    locked, found = locked_stages(folder), dict[str, list[str]]()
    for stage, changes in _asked(["status", "--json"], folder).items():
        outs = [change.get("changed outs", {}) for change in changes if isinstance(change, dict)]
        paths = [path for each in outs for path, state in each.items() if state in ("modified", "deleted")]
        if paths and stage in locked:
            found[stage] = paths
    if not found:
        return {}
    states = _asked(["data", "status", "--granular", "--json"], folder).get("uncommitted", {})
    files = [(path, state) for state, listed in states.items() for path in listed if not path.endswith("/")]
    return {
        stage: f"{stage}: {'; '.join(_differing(path, files) for path in paths)}." for stage, paths in found.items()
    }


def _asked(arguments: list[str], folder: Path) -> dict[str, Any]:
    answer = ask_dvc(arguments, folder)
    if not answer:
        raise PentimentoError(
            f"DVC cannot compare the files of {folder} with its dvc.lock; `dvc {' '.join(arguments)}` there says why."
        )
    asked: dict[str, Any] = json.loads(answer)
    return asked


def _differing(path: str, files: Sequence[tuple[str, str]]) -> str:
    """Return a phrase with the files below an output that differ, as (path, state), as far as DVC lists them."""
    below = [f"{file} {state}" for file, state in files if file.startswith(f"{path}/")]
    more = f" and {len(below) - _MAX_FILES} more" if len(below) > _MAX_FILES else ""
    listed = f" ({', '.join(below[:_MAX_FILES])}{more})" if below else ""
    return f"{path} is not what dvc.lock has{listed}"


def link(folder: Path, execution: str, status: str, unfinished: Collection[str] = ()) -> dict[str, str]:
    """Close an execution: log its models, tag its runs with their outputs, parents with earlier runs that stand.

    An earlier run stands where DVC found nothing to do, which is so of no stage item in `unfinished`.

    Returns:
        The ids of the execution's experiments by their names, each with its main figures as a shared view.
    """
    with store_errors():
        history, client = History(), open_store()
        found = next((each for each in history.executions if each.name == execution), None)
        if found is None:
            return {}
        runs = [run for run in history.runs if run.tags.get("profile") == found.tags.get("profile")]
        reused = {}
        for locked in _in_order(read_lock(folder)):
            run = producer_of(locked, runs)
            if run is None:
                continue
            log_models(client, run, locked.outputs)
            if run.tags.get("execution") != execution and locked.name not in unfinished:
                reused[locked.name] = run.id
            for path, digest in locked.outputs.items():
                client.set_tag(run.id, f"{OUTPUT}{path}", digest)
        shown = {}
        for parent in found.ids:
            client.set_tag(parent, "reused", json.dumps(reused))
            client.set_terminated(parent, status)
            closed = client.get_run(parent)
            share_view(client, closed.info.experiment_id, closed.data.metrics)
            shown[client.get_experiment(closed.info.experiment_id).name] = closed.info.experiment_id
        return shown


def _in_order(items: Sequence[Locked]) -> list[Locked]:
    """Return the items in the order of execution: each after those whose outputs it reads."""
    makers = {path: item.name for item in items for path in item.outputs}
    by_name = {item.name: item for item in items}
    reads = {item.name: {makers[path] for path in item.inputs if path in makers} - {item.name} for item in items}
    return [by_name[name] for name in TopologicalSorter(reads).static_order()]


def _finished(locked: Locked, run: StageRun) -> bool:
    return (run.stage, run.item, run.status) == (locked.stage, locked.item, "FINISHED")
