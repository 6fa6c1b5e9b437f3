"""The pipeline's models in MLflow's registry: a version for each, and the alias `champion`.

DVC keeps the files. A version is a link to them (`dvc://<md5>/<path>`) with the run that produced them. A version
becomes the champion if its figure on the same held-out data is not worse than the champion's, and if the blind
benchmark of its kind of model falls short in no more rows. A bundle becomes the champion if all of its models are
champions. Otherwise the alias stays, and the version's tag `champion` gives the reason.
"""

import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from pipelines._review.agreement import Locked, producer_of, read_lock
from pipelines._review.figures import less_is_better
from pipelines._review.history import History, StageRun
from pipelines._review.models import MODEL, dvc_link
from pipelines._tracking.families import HEADLINES
from pipelines._tracking.store import open_store, store_errors

if TYPE_CHECKING:
    from mlflow import MlflowClient
    from mlflow.entities.model_registry import ModelVersion

ALIAS = "champion"
_REGISTERED = ("diagnose_gap", "train_semantics", "finetune_goal_planner", "diagnose_pushes", "deploy")
"""Stages whose outputs are registered: the models of a bundle, and the bundle."""
_JUDGE = "models/judge/weights"  # only scores other models; not registered
_HANDS = "models/trajvae/weights"  # has a figure for each writer and no main one; not registered
_BLIND_TESTS = {"stroke_": Path("docs/blind_tests.md")}
"""The page of the blind benchmark, by the prefix of a model's name."""


def register(folder: Path) -> list[str]:
    """Register what dvc.lock in `folder` names and is not registered yet; return a sentence for each."""
    sentences = []
    with store_errors():
        client, runs = open_store(), History().runs
        for locked in sorted(read_lock(folder), key=lambda each: each.stage == "deploy"):  # the bundle last
            run = producer_of(locked, runs) if locked.stage in _REGISTERED else None
            for path in sorted(locked.outputs):
                if run is not None and path.startswith("models/") and path != _JUDGE:
                    sentences += _register(client, folder, locked, path, run)
    return sentences


def _register(client: "MlflowClient", folder: Path, locked: Locked, path: str, run: StageRun) -> list[str]:
    """Register one model, unless its version exists already."""
    name, digest = Path(path).parts[1], locked.outputs[path]
    versions = _versions(client, name)
    if any(version.tags["md5"] == digest for version in versions):
        return []
    champion = next((version for version in versions if ALIAS in version.aliases), None)
    tags = {"md5": digest} | _figure_tags(locked.stage, run) | _blind_tests(folder, name)
    tags |= {"manifest": run.tags["manifest"]} if "manifest" in run.tags else {}
    against = _bundled(client, run) if locked.stage == "deploy" else _reasons(tags, champion)
    tags[ALIAS] = f"no: {'; '.join(against)}" if against else f"yes: {_ahead_of(champion)}"
    if not versions:
        client.create_registered_model(name, description=f"Produced by {locked.name}; DVC has the files, in {path}.")
    logged = run.tags.get(f"{MODEL}{path}")  # none after a bare `dvc repro`
    version = client.create_model_version(
        name, dvc_link(path, digest), run.id, tags=tags | ({"logged_model": logged} if logged else {})
    )
    if logged:  # the tag by which the model's page lists its versions
        registered = json.dumps([{"name": name, "version": version.version}])
        client.set_logged_model_tags(logged, {"mlflow.modelVersions": registered})
    if against:
        return [f"{name}: version {version.version} is not the champion: {'; '.join(against)}."]
    client.set_registered_model_alias(name, ALIAS, version.version)
    return [f"{name}: version {version.version} is the champion."]


def _versions(client: "MlflowClient", name: str) -> Sequence["ModelVersion"]:
    """Return the versions with their aliases, which MLflow's search leaves out."""
    found = client.search_model_versions(f"name = '{name}'")
    return [client.get_model_version(name, version.version) for version in found]


def _figure_tags(stage: str, run: StageRun) -> dict[str, str]:
    """Return the main figure, its baseline, and the digests of the data that they were measured on."""
    headline = HEADLINES[stage]
    known = {name: run.metrics[name] for name in (headline.metric, headline.baseline) if name in run.metrics}
    tags = {"metric": headline.metric}
    tags |= {"value": repr(known[headline.metric])} if headline.metric in known else {}
    if headline.baseline in known:
        tags |= {"baseline": headline.baseline, "baseline_value": repr(known[headline.baseline])}
    data = {path: digest for path, digest in run.inputs.items() if Path(path).parts[:1] == ("data",)}
    return tags | {"data": " ".join(f"{path}:{data[path]}" for path in sorted(data))}


def _blind_tests(folder: Path, name: str) -> dict[str, str]:
    page = next((folder / file for start, file in _BLIND_TESTS.items() if name.startswith(start)), None)
    if page is None or not page.is_file():
        return {}
    rows = re.findall(r"^\|.*\*\*falls short\*\*", page.read_text(encoding="utf-8"), re.MULTILINE)
    return {"blind_tests_falling_short": str(len(rows))}


def _reasons(tags: dict[str, str], champion: "ModelVersion | None") -> list[str]:
    """Return the reasons against a new champion; there are none against the first measured version."""
    if "value" not in tags:
        return [f"its run has no figure {tags['metric']}"]
    if champion is None:
        return []
    known, reasons = champion.tags, []
    if known["data"] != tags["data"]:
        reasons.append(
            f"version {champion.version} was measured on other data; compare them and move the alias by hand"
        )
    else:
        old, new = float(known["value"]), float(tags["value"])
        if new != old and (new > old) == less_is_better(tags["metric"]):
            reasons.append(f"its {tags['metric']} is {new:.4g}, worse than {old:.4g} of version {champion.version}")
    short = [int(of.get("blind_tests_falling_short", 0)) for of in (known, tags)]
    if short[1] > short[0]:
        reasons.append(f"the blind tests fall short in {short[1]} rows, and did in {short[0]}")
    return reasons


def _ahead_of(champion: "ModelVersion | None") -> str:
    """Why a version becomes the champion."""
    if champion is None:
        return "there was no champion"
    if "value" not in champion.tags:  # a bundle of champions
        return f"it follows version {champion.version}"
    return f"not worse than version {champion.version} with {float(champion.tags['value']):.4g} on the same data"


def _bundled(client: "MlflowClient", run: StageRun) -> list[str]:
    """Return the reasons against a bundle: its models that are not champions."""
    reasons = []
    for path, digest in run.inputs.items():
        if path == _HANDS:
            continue
        name = Path(path).parts[1]
        if not any(ALIAS in version.aliases and version.tags["md5"] == digest for version in _versions(client, name)):
            reasons.append(f"its {name} is not the champion")
    return reasons
