"""Each execution of a stage is one run in MLflow; this module alone knows MLflow (imported lazily: 3 s).

Tracked outputs hold no wall times and no run ids, because they would change every hash. Those are kept in
MLflow and in `data/timings/` (untracked). The id of an interrupted run is kept in `.pentimento/`
(git-ignored); the next execution of the same stage item with equal parameters and inputs continues that run.
"""

import hashlib
import json
import os
import subprocess
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pentimento.contracts.atomic import atomic_write
from pentimento.contracts.errors import PentimentoError
from pipelines._config import read_yaml
from pipelines._io import failure_sentence

if TYPE_CHECKING:
    from lightning.pytorch.loggers import MLFlowLogger
    from mlflow import MlflowClient
    from mlflow.entities import Metric

EXPERIMENT = "pentimento"
TIMINGS = Path("data/timings")
UNFINISHED = Path(".pentimento/runs")
_FLUSH_AT = 200  # metrics; one transaction each would cost 10 ms
_PARAMS_A_BATCH = 100  # MLflow's limit
_PARAM_LENGTH = 6000  # MLflow's limit


@dataclass
class Run:
    """What a stage may say about its execution."""

    id: str
    _client: "MlflowClient"
    _pending: list["Metric"] = field(default_factory=list)

    def log(self, name: str, value: float, step: int | None = None) -> None:
        """Add one point to the curve `name` (`step` defaults to 0, a single value)."""
        from mlflow.entities import Metric

        self._pending.append(Metric(name, float(value), int(time.time() * 1000), step or 0))
        if len(self._pending) >= _FLUSH_AT:
            self.flush()

    def log_metrics(self, metrics: Mapping[str, Any]) -> None:
        """Log the numbers of a metrics.json, nested names joined by dots; other values stay there."""
        for name, value in _flatten(metrics).items():
            if isinstance(value, int | float):
                self.log(name, value)

    def tag(self, name: str, value: str) -> None:
        """Say something of the run by which it can be found."""
        self._client.set_tag(self.id, name, value)

    def log_picture(self, path: Path) -> None:
        """Keep a copy of a picture with the run."""
        self._client.log_artifact(self.id, str(path), "pictures")

    def log_child(self, name: str, curves: Mapping[str, Mapping[int, float]], tags: Mapping[str, str]) -> None:
        """Add a finished run below this one, with curves {name: {step: value}}."""
        from mlflow.entities import Metric

        parent = self._client.get_run(self.id)
        own = {"mlflow.parentRunId": self.id, "stage": parent.data.tags["stage"], "item": parent.data.tags["item"]}
        child = self._client.create_run(parent.info.experiment_id, run_name=name, tags=own | dict(tags))
        now = int(time.time() * 1000)
        points = [
            Metric(metric, float(value), now, step) for metric, curve in curves.items() for step, value in curve.items()
        ]
        self._client.log_batch(child.info.run_id, metrics=points)
        self._client.set_terminated(child.info.run_id, "FINISHED")

    def mlflow_logger(self) -> "MLFlowLogger":
        """Return the logger by which Lightning's trainer writes its curves into this run."""
        from lightning.pytorch.loggers import MLFlowLogger

        return MLFlowLogger(EXPERIMENT, tracking_uri=os.environ["MLFLOW_TRACKING_URI"], run_id=self.id)

    def flush(self) -> None:
        """Write what was logged so far into the store."""
        self._client.log_batch(self.id, metrics=self._pending)
        self._pending.clear()

    def end(self, status: str, **tags: str) -> None:
        """Close the run as FINISHED, FAILED or KILLED (which may be continued)."""
        self.flush()
        for name, value in tags.items():
            self._client.set_tag(self.id, name, value)
        self._client.set_terminated(self.id, status)


@contextmanager
def tracked_run(stage: str, item: str | None, params: Mapping[str, Any], inputs: Mapping[str, Path]) -> Iterator[Run]:
    """Track the block as one execution of `stage` for the matrix `item` (None where there is no matrix).

    `params` is the stage's section, `inputs` names the data and models that it reads. When the block ends
    well, the run is FINISHED and timed. When it raises, the run is FAILED with the sentence as tag `error`.
    When it is interrupted, the run is KILLED, to be continued by the next execution.
    """
    name = stage if item is None else f"{stage}@{item}"
    digests = {label: input_digest(path) for label, path in inputs.items()}
    started = time.perf_counter()
    with _store_errors():
        client, experiment_id = _open_store()
        run = _continue_or_create(client, experiment_id, name, _tags(stage, item), _key(params, digests))
        _describe(client, run.id, params, inputs, digests)
        try:
            yield run
        except (KeyboardInterrupt, SystemExit):
            run.end("KILLED")
            raise
        except Exception as error:  # whatever it was, the run must say so; it goes on to the caller
            _end_failed(run, failure_sentence(error))
            _state_file(name).unlink()
            raise
        seconds = time.perf_counter() - started
        run.log("wall_s", seconds)
        run.end("FINISHED")
    _state_file(name).unlink()
    _write_timing(name, run.id, seconds)


def input_digest(path: Path) -> str:
    """Return the MD5 by which DVC knows `path`, or an MD5 of its files where DVC does not track it."""
    lock = Path("dvc.lock")
    if lock.is_file():
        for stage in read_yaml(lock).get("stages", {}).values():
            for out in stage.get("outs", []):
                if Path(out["path"]) == path:
                    return str(out["md5"])
    if path.is_file():
        return _md5(path.read_bytes())
    if not path.is_dir():
        raise FileNotFoundError(2, os.strerror(2), str(path))
    files = sorted(file for file in path.rglob("*") if file.is_file())
    return _md5("\n".join(f"{file.relative_to(path)} {_md5(file.read_bytes())}" for file in files).encode())


@contextmanager
def _store_errors() -> Iterator[None]:
    """Turn what MLflow raises (a store that does not open, a full disk) into our sentence."""
    _settings()
    from alembic.util import CommandError
    from mlflow.exceptions import MlflowException
    from sqlalchemy.exc import SQLAlchemyError

    try:
        yield
    except (MlflowException, SQLAlchemyError, CommandError) as error:
        root: BaseException = error
        while root.__cause__ is not None:
            root = root.__cause__
        store, reason = os.environ["MLFLOW_TRACKING_URI"], str(root).splitlines()[0]
        raise PentimentoError(f"MLflow's store {store} fails ({reason}); see its disk or address.") from None


def _end_failed(run: Run, sentence: str) -> None:
    """Mark a failed run, as far as the store still works: the stage's own error is the one to report."""
    from mlflow.exceptions import MlflowException

    with suppress(MlflowException):
        run.end("FAILED", error=sentence)


def _settings() -> None:
    os.environ.setdefault("MLFLOW_TRACKING_URI", f"sqlite:///{Path.cwd() / 'mlflow.db'}")
    os.environ.setdefault("MLFLOW_DISABLE_TELEMETRY", "true")
    os.environ.setdefault("DO_NOT_TRACK", "true")
    os.environ.setdefault("MLFLOW_LOGGING_LEVEL", "CRITICAL")  # what it raises is said in a sentence


def _open_store() -> tuple["MlflowClient", str]:
    """Return a client and the experiment's id; by default the store is SQLite in the repository's root."""
    from mlflow import MlflowClient

    uri = os.environ["MLFLOW_TRACKING_URI"]
    client = MlflowClient(uri)
    known = client.get_experiment_by_name(EXPERIMENT)
    if known is not None:
        return client, known.experiment_id
    beside = Path(uri.removeprefix("sqlite:///")).parent / "mlartifacts"
    location = beside.as_uri() if uri.startswith("sqlite:////") else None  # a server has its own place
    return client, client.create_experiment(EXPERIMENT, artifact_location=location)


def _continue_or_create(
    client: "MlflowClient", experiment_id: str, name: str, tags: Mapping[str, str], key: str
) -> Run:
    """Continue the item's interrupted run if it had the same parameters and inputs, or create a run."""
    from mlflow.exceptions import MlflowException

    state = _state_file(name)
    if state.is_file():
        try:
            left = json.loads(state.read_text())
            if left["key"] == key:
                client.update_run(left["run_id"], status="RUNNING")
                for tag, value in tags.items():  # the commit may be another one by now
                    client.set_tag(left["run_id"], tag, value)
                return Run(left["run_id"], client)
            client.set_terminated(left["run_id"], "KILLED")  # it was killed without a chance to say so
        except (MlflowException, ValueError, KeyError, TypeError):
            pass  # that run was deleted from the store, or the file was damaged: there is nothing to continue
    run = client.create_run(experiment_id, run_name=name.replace("@", " · "), tags=dict(tags))
    state.parent.mkdir(parents=True, exist_ok=True)
    atomic_write(state, json.dumps({"run_id": run.info.run_id, "key": key}).encode())
    return Run(run.info.run_id, client)


def _describe(
    client: "MlflowClient",
    run_id: str,
    params: Mapping[str, Any],
    inputs: Mapping[str, Path],
    digests: Mapping[str, str],
) -> None:
    """Log parameters and dataset inputs. Both are immutable: a continued run has equal ones (see `_key`)."""
    from mlflow.entities import Dataset, DatasetInput, InputTag, Param

    flat = [Param(name, str(value)[:_PARAM_LENGTH]) for name, value in _flatten(params).items()]
    for first in range(0, len(flat), _PARAMS_A_BATCH):
        client.log_batch(run_id, params=flat[first : first + _PARAMS_A_BATCH])
    datasets = [
        DatasetInput(
            Dataset(label, digests[label], "local", json.dumps({"uri": str(path)})),
            [InputTag("mlflow.data.context", "input")],
        )
        for label, path in inputs.items()
    ]
    if datasets:
        client.log_inputs(run_id, datasets=datasets)


def _tags(stage: str, item: str | None) -> dict[str, str]:
    commit, changes = _git("rev-parse", "HEAD"), _git("status", "--porcelain")
    tags = {
        "stage": stage,
        "item": item or "",
        "pipeline": os.environ.get("PENTIMENTO_PROFILE", "default"),
        "commit": commit,
        "dirty": str(bool(changes)).lower(),
        "experiment": os.environ.get("DVC_EXP_NAME", ""),
        "mlflow.source.name": f"pipelines/{stage}.py",
        "mlflow.source.git.commit": commit,
    }
    return {name: value for name, value in tags.items() if value}


def _git(*arguments: str) -> str:
    """Return git's answer, or nothing outside a repository with a commit."""
    answer = subprocess.run(["git", *arguments], capture_output=True, text=True, check=False)
    return answer.stdout.strip() if answer.returncode == 0 else ""


def _key(params: Mapping[str, Any], digests: Mapping[str, str]) -> str:
    return _md5(json.dumps([_flatten(params), dict(digests)], sort_keys=True, default=str).encode())


def _state_file(name: str) -> Path:
    return UNFINISHED / f"{name}.json"


def _flatten(values: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for name, value in values.items():
        if isinstance(value, Mapping):
            flat |= _flatten(value, f"{prefix}{name}.")
        else:
            flat[f"{prefix}{name}"] = value
    return flat


def _md5(content: bytes) -> str:
    return hashlib.md5(content, usedforsecurity=False).hexdigest()


def _write_timing(name: str, run_id: str, seconds: float) -> None:
    TIMINGS.mkdir(parents=True, exist_ok=True)
    finished = time.strftime("%Y-%m-%d %H:%M:%S")
    timing = {"stage": name, "seconds": round(seconds, 2), "finished": finished, "run_id": run_id}
    atomic_write(TIMINGS / f"{name}.json", (json.dumps(timing, indent=2) + "\n").encode())
    timings = [json.loads(file.read_text()) for file in TIMINGS.glob("*.json")]
    atomic_write(TIMINGS / "index.html", _timings_page(timings).encode())


def _timings_page(timings: list[dict[str, Any]]) -> str:
    """Return a page with the latest execution of each stage item, as a table that needs nothing else."""
    rows = "\n".join(
        f"<tr><td>{escape(t['stage'])}<td class=n>{t['seconds']:.1f}<td>{t['finished']}<td>{t['run_id']}"
        for t in sorted(timings, key=lambda t: (t["finished"], t["stage"]))
    )
    total = sum(t["seconds"] for t in timings)
    return f"""<!doctype html><html lang=en><meta charset=utf-8><title>Timings</title>
<style>body{{font:15px/1.5 system-ui,sans-serif;color:#333;margin:0}} table{{border-collapse:collapse}}
td,th{{padding:.2em 1.2em .2em 0;text-align:left;border-bottom:1px solid #ddd}} .n{{text-align:right}}</style>
<table><tr><th>stage<th class=n>seconds<th>finished<th>MLflow run
{rows}
<tr><th>together<th class=n>{total:.1f}<th><th></table></html>
"""
