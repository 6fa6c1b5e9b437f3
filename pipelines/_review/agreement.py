"""Whether MLflow's runs and dvc.lock tell of the same executions, and the tags by which one leads to the other."""

import json
from collections.abc import Sequence
from pathlib import Path

from pipelines._review.history import History, StageRun
from pipelines._review.lock import Locked, read_lock
from pipelines._tracking.store import open_store, store_errors

OUTPUT = "output:"
"""Prefix of the tags that hold the MD5 of what a run wrote, by path."""


def differences(locked: Locked, run: StageRun) -> list[str]:
    """What MLflow and DVC tell differently of one stage item, as phrases; a run without a record of it differs."""
    said = []
    for path, digest in run.inputs.items():
        if path in locked.inputs and locked.inputs[path] != digest:
            said.append(f"read another {path} ({digest[:8]}, dvc.lock: {locked.inputs[path][:8]})")
    if run.tags.get("params_md5") != locked.params_md5:
        said.append(f"ran with other parameters than dvc.lock has in section {locked.stage}")
    for path, digest in locked.outputs.items():
        recorded = run.tags.get(f"{OUTPUT}{path}", digest)
        if recorded != digest:
            said.append(f"wrote another {path} ({recorded[:8]}, dvc.lock: {digest[:8]})")
    return said


def made_by(locked: Locked, runs: Sequence[StageRun]) -> StageRun | None:
    """The newest finished run (`runs` are newest first) that agrees with dvc.lock."""
    return next((run for run in runs if _finished(locked, run) and not differences(locked, run)), None)


def check(folder: Path, profile: str) -> tuple[int, list[str]]:
    """Compare each item of dvc.lock in `folder` with MLflow's runs under `profile`.

    Returns:
        How many agree, and a sentence for each that does not.
    """
    with store_errors():
        runs = [run for run in History().runs if run.tags.get("profile") == profile]
    agreeing, said = 0, []
    for locked in read_lock(folder):
        latest = next((run for run in runs if _finished(locked, run)), None)
        if latest is None:
            said.append(
                f"{locked.name}: MLflow has no finished run of it; `dvc repro --force --single-item` makes one."
            )
        elif made_by(locked, runs) is None:
            said.append(f"{locked.name}: its last run {latest.id[:8]} {'; it '.join(differences(locked, latest))}.")
        else:
            agreeing += 1
    return agreeing, said


def link(folder: Path, execution: str, status: str) -> None:
    """Close an execution: tag its runs with what they wrote, and its parents with the earlier runs that stood."""
    with store_errors():
        history, client = History(), open_store()
        found = next((each for each in history.executions if each.name == execution), None)
        if found is None:
            return
        runs = [run for run in history.runs if run.tags.get("profile") == found.tags.get("profile")]
        reused = {}
        for locked in read_lock(folder):
            run = made_by(locked, runs)
            if run is None:
                continue
            if run.tags.get("execution") != execution:
                reused[locked.name] = run.id
            for path, digest in locked.outputs.items():
                client.set_tag(run.id, f"{OUTPUT}{path}", digest)
        for parent in found.ids:
            client.set_tag(parent, "reused", json.dumps(reused))
            client.set_terminated(parent, status)


def _finished(locked: Locked, run: StageRun) -> bool:
    return (run.stage, run.item, run.status) == (locked.stage, locked.item, "FINISHED")
