"""A stage's execution as a run in MLflow (imported lazily: 3 s): parameters, metrics, pictures, inputs, tags.

Outputs that DVC tracks hold no wall times and no run ids, because these would change every hash. Both are in MLflow and
in `data/timings/` (untracked). The id of an interrupted run is in `.pentimento/` (git-ignored); the next execution
of the same stage item with equal parameters and inputs continues that run.

Names of metrics: a figure `x` (or `x.value`) has its 95 % interval in `x.low` and `x.high`. The values of the held-out
items whose mean it is are the steps of the curve `items.x`.
"""

import json
import os
import posixpath
import re
import resource
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from filelock import FileLock

from pentimento.contracts.atomic import atomic_write
from pipelines._io import failure_sentence
from pipelines._params import files_named_by, read_yaml
from pipelines._tracking.dvc_files import flatten, input_digests, matrix_items, md5, params_digest, value_digest
from pipelines._tracking.families import HEADLINES, experiment_of, family_of, note
from pipelines._tracking.origins import origin_tags
from pipelines._tracking.outbox import Outbox, Point, send_unsent
from pipelines._tracking.store import (
    PART,
    STAGE,
    execution_name,
    execution_run,
    experiment_id,
    group_tags,
    open_store,
    profile_name,
    store_errors,
)
from pipelines._tracking.timings import write_timing

if TYPE_CHECKING:
    from lightning.pytorch.loggers import MLFlowLogger
    from mlflow import MlflowClient

UNFINISHED = Path(".pentimento/runs")
_LOCK = UNFINISHED.parent / "begin.lock"
_FLUSH_AT = 200  # metrics; one transaction each would cost 10 ms
_PARAM_LENGTH = 6000  # MLflow's limit
SYSTEM = "system/"
"""Prefix of metrics that MLflow shows among its system metrics."""
_IN_KEYS = re.compile(r"[^a-zA-Z0-9_\-./ ]")  # what a key of the image grid cannot hold


_NAME_LENGTH = 250  # MLflow's limit


def stored_name(name: str) -> str:
    """Return a name of a metric, parameter or tag as MLflow's store takes it: other letters become `_`."""
    safe = re.sub(r"[^\w.\- :/]", "_", name)[:_NAME_LENGTH]
    if posixpath.normpath(safe) != safe or safe.startswith(("/", "..")):  # a path that leaves its folder
        safe = re.sub(r"/|^\.+", "_", safe)
    return safe


@dataclass
class Run:
    """The run of a stage's execution, to which the stage logs."""

    id: str
    _client: "MlflowClient"
    _outbox: Outbox
    parent: str | None = None
    """The id of the parent run of the execution."""
    label: str = ""
    """`stage/item`."""
    metrics: dict[str, Any] = field(default_factory=dict)
    """The metrics given to `log_metrics`, nested."""
    _pending: list[Point] = field(default_factory=list)
    _names: dict[str, str] = field(default_factory=dict)
    """Of curves, by their names in the store."""

    def log(self, name: str, value: float, step: int | None = None) -> None:
        """Add one point to the curve `name` (`step` defaults to 0, a single value)."""
        stored = stored_name(name)
        while self._names.setdefault(stored, name) != name:  # two names that differ only in letters that are replaced
            stored += "_"
        self._pending.append((stored, float(value), int(time.time() * 1000), step or 0))
        if len(self._pending) >= _FLUSH_AT:
            self.flush()

    def log_under(self, suffix: str) -> Callable[[str, float, int], None]:
        """Return a `log` function that appends `suffix` to the names of its curves."""
        return lambda name, value, step: self.log(f"{name}.{suffix}", value, step)

    def log_metrics(self, metrics: Mapping[str, Any]) -> None:
        """Log the numbers of a metrics.json, nested names joined by dots; other values stay there.

        The interval `x_ci: [low, high]` becomes `x.low` and `x.high`.
        """
        self.metrics |= metrics
        for name, value in flatten(metrics).items():
            if isinstance(value, int | float):
                self.log(name, value)
            elif name.endswith("_ci") and isinstance(value, Sequence) and len(value) == 2:
                for end, bound in zip(("low", "high"), value, strict=True):
                    self.log(f"{name.removesuffix('_ci')}.{end}", bound)

    def log_items(self, name: str, items: Sequence[object], values: Sequence[float]) -> None:
        """Log the contribution of each held-out item to the figure `name`, so that runs are compared item by item.

        `items` are ids with the same meaning in every run on the same data, one for each value.
        """
        for step, value in enumerate(values):
            self.log(f"items.{name}", value, step)
        self.tag(f"items.{name}", value_digest([str(item) for item in items]))

    def tag(self, name: str, value: str) -> None:
        """Set a tag of the run."""
        self._outbox.send("tags", tags={stored_name(name): value})

    def log_picture(self, path: Path, group: str = "", step: int = 0) -> None:
        """Keep a copy of a picture in the run's folder `pictures`, and enter it in MLflow's image grid.

        `group` is for runs with pictures of the same name for several settings. The grid shows the rows of the
        experiment's table, which are executions: there the key is `stage/item/group/name`, and pictures of equal keys
        meet.
        """
        self._outbox.send("artifact", file=str(path), folder=f"pictures/{group}".rstrip("/"))
        key = _IN_KEYS.sub("_", "/".join(filter(None, (self.label, group, path.stem))))
        self._outbox.send("image", run=self.parent or self.id, file=str(path), key=key, step=step)

    def log_child(self, name: str, curves: Mapping[str, Mapping[int, float]], tags: Mapping[str, str]) -> None:
        """Add a finished run below this one, with curves {name: {step: value}}."""
        now = int(time.time() * 1000)
        points = [
            (stored_name(metric), float(value), now, step)
            for metric, curve in curves.items()
            for step, value in curve.items()
        ]
        self._outbox.send("child", name=name, points=points, tags={"kind": PART, **tags})

    def mlflow_logger(self) -> "MLFlowLogger":
        """Return the logger by which Lightning's trainer writes its curves into this run."""
        from lightning.pytorch.loggers import MLFlowLogger

        name = self._client.get_experiment(self._client.get_run(self.id).info.experiment_id).name
        return MLFlowLogger(name, tracking_uri=os.environ["MLFLOW_TRACKING_URI"], run_id=self.id)

    def flush(self) -> None:
        """Write what was logged so far into the store."""
        if self._pending:
            self._outbox.send("metrics", points=self._pending)
            self._pending.clear()

    def end(self, status: str, **tags: str) -> None:
        """Close the run and its parent as FINISHED, FAILED or KILLED; a killed run can be continued."""
        self.flush()
        if tags:
            self._outbox.send("tags", tags=tags)
        self._outbox.send("ended", also=[self.parent] if self.parent else [], status=status)
        self._outbox.close()

    def describe(self, params: Mapping[str, Any], inputs: Mapping[str, Path], digests: Mapping[str, str]) -> None:
        """Log parameters, inputs and their origins. A continued run has equal ones (see `_key`)."""
        values = {stored_name(name): str(value)[:_PARAM_LENGTH] for name, value in flatten(params).items()}
        known = [(label, digests[label], str(path)) for label, path in inputs.items()]
        self._outbox.send("described", params=values, inputs=known)
        if origins := origin_tags(inputs):
            self._outbox.send("tags", tags={stored_name(name): value for name, value in origins.items()})

    def summarise(self, stage: str, item: str | None) -> None:
        """Write the note on the run's page, and copy the main figure into the parent run."""
        self.tag("mlflow.note.content", note(stage, self.metrics))
        headline, figures = HEADLINES.get(stage), flatten(self.metrics)
        if self.parent is None or headline is None:
            return
        now = int(time.time() * 1000)
        points = [
            ("/".join(filter(None, (stage, item, name))), float(figures[name]), now, 0)
            for name in (headline.metric, headline.baseline)
            if name and isinstance(figures.get(name), int | float)
        ]
        self._outbox.send("metrics", run=self.parent, points=points)


@contextmanager
def tracked_run(stage: str, item: str | None, params: Mapping[str, Any], inputs: Mapping[str, Path]) -> Iterator[Run]:
    """Track the block as one execution of `stage` for the matrix `item` (None where there is no matrix).

    `params` is the stage's section, `inputs` names the data and models that it reads. When the block ends
    well, the run is FINISHED and timed. When it raises, the run is FAILED with the sentence as tag `error`.
    When it is interrupted, the run is KILLED, to be continued by the next execution.
    """
    name = stage if item is None else f"{stage}@{item}"
    _warn_of_unnoticed_files(stage)
    digests = input_digests(inputs)
    started = time.perf_counter()
    with store_errors():
        with _begin_lock():
            client = open_store()
            send_unsent(client)
            run = _begin(client, stage, item, name, _key(params, digests))
        run.describe(params, inputs, digests)
        try:
            yield run
        except (KeyboardInterrupt, SystemExit):
            run.end("KILLED")
            raise
        except Exception as error:  # recorded in the run, then raised again
            _end_failed(run, failure_sentence(error))
            _state_file(name).unlink()
            raise
        seconds = time.perf_counter() - started
        run.log("wall_s", seconds)
        for figure, value in _used().items():
            run.log(f"{SYSTEM}{figure}", value)
        run.summarise(stage, item)
        run.end("FINISHED")
    _state_file(name).unlink()
    write_timing(name, run.id, seconds)


def _used() -> dict[str, float]:
    """Return the processor time and the peak memory of this process and of those that it waited for."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    kib = max(each.ru_maxrss for each in used)  # Linux counts KiB
    return {"cpu_s": sum(each.ru_utime + each.ru_stime for each in used), "peak_memory_mb": kib * 1024 / 1e6}


def _warn_of_unnoticed_files(stage: str) -> None:
    """Print which files of the stage's parameters dvc.yaml does not list, so that DVC would not notice their change."""
    if not (Path("params.yaml").is_file() and Path("dvc.yaml").is_file()):
        return
    described = read_yaml(Path("dvc.yaml")).get("stages", {}).get(stage)
    params = read_yaml(Path("params.yaml"))
    if described is None or stage not in params:
        return
    listed = {os.path.normpath(str(path)) for path in described.get("deps", [])}
    missing = [path for path in files_named_by(stage, params, Path()) if path not in listed]
    if missing:
        print(
            f"{stage}: dvc.yaml does not list {', '.join(missing)}, so that DVC does not notice a change; "
            "`make repro` and `make deps` write it there.",
            file=sys.stderr,
        )


def _end_failed(run: Run, sentence: str) -> None:
    """Mark a failed run if the store still works; the stage's own error is the one to report."""
    from mlflow.exceptions import MlflowException

    with suppress(MlflowException):
        run.end("FAILED", error=sentence)


def _begin_lock() -> FileLock:
    """Return the lock under which the first of several stages creates store, experiment and execution."""
    _LOCK.parent.mkdir(parents=True, exist_ok=True)
    return FileLock(_LOCK)


def _begin(client: "MlflowClient", stage: str, item: str | None, name: str, key: str) -> Run:
    """Open the stage's run below the parent run of this process's execution."""
    experiment = experiment_id(client, experiment_of(stage))
    tags, execution, parent = _tags(stage, item), execution_name(), None
    if execution:
        shared: dict[str, str] = {
            tag: tags[tag]
            for tag in ("profile", "commit", "dirty", "dvc_experiment", "family", "group", "seed")
            if tag in tags
        }
        parent = execution_run(client, experiment, execution, shared)
        client.update_run(parent, status="RUNNING")
        tags |= {"execution": execution, "mlflow.parentRunId": parent}
    run_id = _continue_or_create(client, experiment, name, tags, key)
    return Run(run_id, client, Outbox(client, run_id), parent, name.replace("@", "/"))


def _continue_or_create(client: "MlflowClient", experiment: str, name: str, tags: Mapping[str, str], key: str) -> str:
    """Continue the item's interrupted run if it had the same parameters and inputs, or create a run; return its id."""
    from mlflow.exceptions import MlflowException

    state = _state_file(name)
    if state.is_file():
        try:
            unfinished = json.loads(state.read_text(encoding="utf-8"))
            if unfinished["key"] == key:
                client.update_run(unfinished["run_id"], status="RUNNING")
                for tag, value in tags.items():  # the commit may differ by now
                    client.set_tag(unfinished["run_id"], tag, value)
                return str(unfinished["run_id"])
            client.set_terminated(unfinished["run_id"], "KILLED")  # it was killed without closing the run
        except (MlflowException, ValueError, KeyError, TypeError):
            pass  # the run was deleted from the store or the file is damaged: nothing to continue
    run = client.create_run(experiment, run_name=name.replace("@", " · "), tags=dict(tags))
    state.parent.mkdir(parents=True, exist_ok=True)
    atomic_write(state, json.dumps({"run_id": run.info.run_id, "key": key}).encode())
    return run.info.run_id


def _tags(stage: str, item: str | None) -> dict[str, str]:
    code = code_tags()
    tags = code | {
        "kind": STAGE,
        "family": family_of(stage),
        "stage": stage,
        "item": item or "",
        "profile": profile_name(),
        "dvc_experiment": os.environ.get("DVC_EXP_NAME", ""),
        "mlflow.source.name": f"pipelines/{stage}.py",
        "mlflow.source.git.commit": code["commit"],
    }
    return {name: value for name, value in (tags | _as_written(stage, item) | group_tags()).items() if value}


def code_tags() -> dict[str, str]:
    """Return git's commit as a tag, empty outside a repository, and whether the working tree had changes."""
    # The pipeline itself changes dvc.lock.
    changes = _git("status", "--porcelain", "--", ":(top)", ":(top,exclude)dvc.lock")
    return {"commit": _git("rev-parse", "HEAD"), "dirty": str(bool(changes)).lower()}


def _as_written(stage: str, item: str | None) -> dict[str, str]:
    """Return tags from params.yaml and dvc.yaml: the digest of the stage's parameters, and its matrix item by axis."""
    tags = {}
    if Path("params.yaml").is_file() and stage in (sections := read_yaml(Path("params.yaml"))):
        tags["params_md5"] = params_digest(stage, sections)
    if item and Path("dvc.yaml").is_file():
        tags |= {axis: item for axis, items in matrix_items(Path(), stage).items() if item in items}
    return tags


def _git(*arguments: str) -> str:
    """Return git's answer, or nothing outside a repository with a commit."""
    answer = subprocess.run(["git", *arguments], capture_output=True, text=True, check=False)
    return answer.stdout.strip() if answer.returncode == 0 else ""


def _key(params: Mapping[str, Any], digests: Mapping[str, str]) -> str:
    return md5(json.dumps([flatten(params), dict(digests)], sort_keys=True, default=str).encode())


def _state_file(name: str) -> Path:
    return UNFINISHED / f"{name}.json"
