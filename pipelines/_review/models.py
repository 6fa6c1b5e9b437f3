"""Models that DVC keeps, as logged models of MLflow 3: without bytes, with DVC's hash, figures and where they lead to.

A logged model belongs to the run that made it. Its tag `dvc` is a link `dvc://<md5>/<path>` to what DVC keeps. It has
the final figures of its run, with the digest of the data that they were measured on. The run's tag `model:<path>` is
its id.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from pipelines._review.history import StageRun
from pipelines._tracking.families import experiments, note
from pipelines._tracking.run import SYSTEM

if TYPE_CHECKING:
    from mlflow import MlflowClient
    from mlflow.entities import Dataset, LoggedModel
    from mlflow.entities import Run as StoredRun

MODEL = "model:"
"""Prefix of a run's tags with the ids of its logged models, by path."""
_NOTE = "mlflow.note.content"
_TAGS = ("stage", "item", "profile", "commit", "execution", "group", "seed", "manifest")
"""Of a run, repeated on its models."""
_METRICS_A_BATCH = 900  # MLflow's limit is 1000 with parameters and tags
_FOLDER = "models"


def dvc_link(path: str, digest: str) -> str:
    """Return the address of what DVC keeps."""
    return f"dvc://{digest}/{path}"


def log_models(client: "MlflowClient", run: StageRun, outputs: Mapping[str, str]) -> None:
    """Create the logged models of a run that are not there yet; `outputs` are DVC's MD5 by path."""
    new = [path for path in sorted(outputs) if Path(path).parts[0] == _FOLDER and f"{MODEL}{path}" not in run.tags]
    if not new:
        return
    from mlflow.entities import LoggedModelInput, LoggedModelOutput

    stored = client.get_run(run.id)
    sources = _sources(client, run)
    models = [_log_model(client, run, stored, path=path, digest=outputs[path], sources=sources) for path in new]
    if sources:
        client.log_inputs(run.id, models=[LoggedModelInput(model.model_id) for model in sources.values()])
    client.log_outputs(run.id, [LoggedModelOutput(model.model_id, 0) for model in models])
    for path, model in zip(new, models, strict=True):
        client.set_tag(run.id, f"{MODEL}{path}", model.model_id)
        for source in sources.values():  # the bundle, or the model that was trained further
            text = f"{source.tags[_NOTE]}\n\nPart of {_linked(path, model)}."
            client.set_logged_model_tags(source.model_id, {_NOTE: text})


def _log_model(
    client: "MlflowClient",
    run: StageRun,
    stored: "StoredRun",
    *,
    path: str,
    digest: str,
    sources: Mapping[str, "LoggedModel"],
) -> "LoggedModel":
    from mlflow.entities import Metric

    experiment, dvc = stored.info.experiment_id, dvc_link(path, digest)
    tags = {name: run.tags[name] for name in _TAGS if name in run.tags}
    tags |= {"md5": digest, "path": path, "dvc": dvc, "mlflow.model.isExternal": "true"}
    tags[_NOTE] = _card(run, experiment, dvc, sources)
    model = client.create_logged_model(
        experiment, Path(path).parts[1], run.id, tags=tags, params=run.params, model_type=run.stage
    )
    data = _measured_on(stored)
    figures = [
        Metric(
            each.key, each.value, each.timestamp, each.step, model.model_id,
            data.name if data else None, data.digest if data else None, run.id,
        )
        for each in stored.data._metric_objs  # with their times, which the store needs to know them again
        if each.key != "wall_s" and not each.key.startswith(("items.", SYSTEM))
    ]  # fmt: skip
    for first in range(0, len(figures), _METRICS_A_BATCH):
        client.log_batch(run.id, metrics=figures[first : first + _METRICS_A_BATCH])
    return client.finalize_logged_model(model.model_id, "READY")


def _measured_on(stored: "StoredRun") -> "Dataset | None":
    """Return the data of a run; MLflow takes one data set for a figure, so that it is the first by name of several."""
    used = [each.dataset for each in stored.inputs.dataset_inputs] if stored.inputs is not None else []
    data = [each for each in used if f"{_FOLDER}/" not in each.source]
    return min(data, key=lambda each: each.name, default=None)


def _sources(client: "MlflowClient", run: StageRun) -> dict[str, "LoggedModel"]:
    """Return the logged models that a run read, as far as known, by path."""
    found = {}
    for path, digest in run.inputs.items():
        if Path(path).parts[0] == _FOLDER and len(Path(path).parts) > 1:
            same = [
                each for each in _named(client, Path(path).parts[1]) if each.tags.get("dvc") == dvc_link(path, digest)
            ]
            if same:
                found[path] = same[0]
    return found


def _named(client: "MlflowClient", name: str) -> Sequence["LoggedModel"]:
    """Return the logged models of a name, newest first."""
    known = (client.get_experiment_by_name(experiment) for experiment in experiments())
    ids = [experiment.experiment_id for experiment in known if experiment is not None]
    newest = [{"field_name": "creation_timestamp", "ascending": False}]
    found: Sequence[LoggedModel] = client.search_logged_models(ids, f"name = '{name}'", order_by=newest)
    return found


def _card(run: StageRun, experiment: str, dvc: str, sources: Mapping[str, "LoggedModel"]) -> str:
    """Return the description of a model: what it is, its files, its data, its run, the models that it was made from."""
    commit = run.tags.get("commit", "")
    code = f", code of commit `{commit[:12]}`" if commit else ""
    lines = [
        f"Made by [{run.name}](#/experiments/{experiment}/runs/{run.id}){code}.",
        f"Files: `{dvc}` in DVC's cache.",
    ]
    for path, digest in run.inputs.items():
        origin = f": {run.origins[path]}" if path in run.origins else ""
        lines.append(
            f"From {_linked(path, sources[path]) if path in sources else f'`{path}`'} (`{digest[:12]}`){origin}"
        )
    listed = "\n".join(f"- {line}" for line in lines)
    return f"{run.tags.get(_NOTE) or note(run.stage, {})}\n\n{listed}".lstrip()


def _linked(path: str, model: "LoggedModel") -> str:
    return f"[{path}](#/experiments/{model.experiment_id}/models/{model.model_id})"
