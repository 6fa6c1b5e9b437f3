"""The runs in MLflow's store as plain values."""

import json
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from pentimento.contracts.errors import PentimentoError
from pipelines._tracking.families import experiments
from pipelines._tracking.origins import described_origin
from pipelines._tracking.store import EXECUTION, PART, STAGE, open_store

if TYPE_CHECKING:
    from mlflow.entities import Run as StoredRun

_PAGE = 1000
_PICTURES = "pictures"
_MIN_LETTERS = 4  # of an abbreviated id


@dataclass(frozen=True)
class StageRun:
    """One execution of a stage item."""

    id: str
    stage: str
    item: str
    status: str
    started_ms: int
    params: dict[str, str]
    metrics: dict[str, float]
    tags: dict[str, str]
    inputs: dict[str, str]
    """MD5 of the inputs, by path."""
    origins: dict[str, str]
    """Source and licence of the inputs, as far as known, by path."""

    @property
    def name(self) -> str:
        """As DVC writes it."""
        return f"{self.stage}@{self.item}" if self.item else self.stage


@dataclass(frozen=True)
class Execution:
    """One execution of the pipeline: its parent runs, one in the experiment of each family, share a name."""

    name: str
    ids: tuple[str, ...]
    status: str
    started_ms: int
    tags: dict[str, str]

    @property
    def reused(self) -> dict[str, str]:
        """Ids of the earlier runs whose outputs were kept, by stage item."""
        return dict(json.loads(self.tags.get("reused", "{}")))


class History:
    """All runs of the pipeline's stages, and its executions, newest first."""

    def __init__(self) -> None:
        self._client = open_store()
        stored = self._stored()
        kinds: dict[str, list[StoredRun]] = {STAGE: [], EXECUTION: []}
        for run in stored:
            kinds.get(run.data.tags.get("kind", ""), []).append(run)
        self.runs = [_stage_run(run) for run in kinds[STAGE]]
        self.executions = _executions(kinds[EXECUTION])

    def _stored(self) -> list["StoredRun"]:
        found = (self._client.get_experiment_by_name(name) for name in experiments())
        ids = [experiment.experiment_id for experiment in found if experiment is not None]
        runs: list[StoredRun] = []
        token: str | None = None
        while ids:
            page = self._client.search_runs(
                ids, f"tags.kind != '{PART}'", max_results=_PAGE,
                order_by=["attributes.start_time DESC"], page_token=token,
            )  # fmt: skip
            runs += page
            token = page.token
            if not token:
                break
        return runs

    def of_execution(self, execution: Execution) -> dict[str, StageRun]:
        """Return the runs whose outputs stood when an execution ended, by stage item: new ones and kept ones."""
        by_id = {run.id: run for run in self.runs}
        standing = {name: by_id[id_] for name, id_ in execution.reused.items() if id_ in by_id}
        own = [run for run in reversed(self.runs) if run.tags.get("execution") == execution.name]
        return standing | {run.name: run for run in own}

    def find(self, reference: str) -> StageRun | Execution:
        """Return the run or execution with an id, a prefix of four letters or more, or a name.

        Raises:
            PentimentoError: there is none, or there are several.
        """
        known: list[tuple[StageRun | Execution, tuple[str, ...], str]]
        known = [(run, (run.id,), run.tags.get("mlflow.runName", "")) for run in self.runs]
        known += [(each, each.ids, each.name) for each in self.executions]
        exact = [each for each, ids, name in known if reference in (*ids, name)]
        near = [each for each, ids, _ in known if any(id_.startswith(reference) for id_ in ids)]
        found = exact or (near if len(reference) >= _MIN_LETTERS else [])
        if len(found) == 1:
            return found[0]
        if not found:
            raise PentimentoError(
                f"No run or execution is called {reference!r}; give an id, its first letters, or an execution's name. "
                f"The last ones are {self._last()}."
            )
        listed = ", ".join(each.id[:8] if isinstance(each, StageRun) else each.ids[0][:8] for each in found[:6])
        raise PentimentoError(f"{reference!r} may be any of {len(found)} runs ({listed}); give one of these ids.")

    def items(self, run: StageRun, metric: str) -> list[float]:
        """Return the contribution of each held-out item to a figure."""
        points = self._client.get_metric_history(run.id, f"items.{metric}")
        return [value for _, value in sorted({point.step: point.value for point in points}.items())]

    def pictures(self, run: StageRun) -> dict[str, bytes]:
        """Return the run's PNGs by their path in its folder `pictures`."""
        folders, listed = [_PICTURES], list[str]()
        while folders:
            entries = self._client.list_artifacts(run.id, folders.pop())
            folders += [entry.path for entry in entries if entry.is_dir]
            listed += [entry.path for entry in entries if not entry.is_dir]
        pictures = {}
        with tempfile.TemporaryDirectory() as scratch:
            for path in sorted(listed):
                if path.endswith(".png"):
                    pictures[path.removeprefix(f"{_PICTURES}/")] = Path(
                        self._client.download_artifacts(run.id, path, scratch)
                    ).read_bytes()
        return pictures

    def _last(self) -> str:
        names = [f"{each.name!r}" for each in self.executions[:3]] or [
            f"{run.name} {run.id[:8]}" for run in self.runs[:3]
        ]
        return ", ".join(names) or "none: run `make repro`"


def _stage_run(run: "StoredRun") -> StageRun:
    used = run.inputs.dataset_inputs if run.inputs is not None else []
    tags = dict(run.data.tags)
    paths = {str(json.loads(each.dataset.source)["uri"]): each.dataset for each in used}
    inputs = {path: dataset.digest for path, dataset in paths.items()}
    origins = {path: text for path, dataset in paths.items() if (text := described_origin(tags, dataset.name))}
    return StageRun(
        run.info.run_id, tags["stage"], tags.get("item", ""), run.info.status, run.info.start_time,
        dict(run.data.params), dict(run.data.metrics), tags, inputs, origins,
    )  # fmt: skip


def _executions(runs: Sequence["StoredRun"]) -> list[Execution]:
    """Return the executions, newest first; the parent runs of one execution become one value."""
    by_name: dict[str, list[StoredRun]] = {}
    for run in runs:
        by_name.setdefault(run.data.tags["execution"], []).append(run)
    executions = [
        Execution(
            name,
            tuple(run.info.run_id for run in parents),
            _worst([run.info.status for run in parents]),
            min(run.info.start_time for run in parents),
            dict(parents[0].data.tags),
        )
        for name, parents in by_name.items()
    ]
    return sorted(executions, key=lambda each: each.started_ms, reverse=True)


def _worst(statuses: Sequence[str]) -> str:
    return next((status for status in ("RUNNING", "FAILED", "KILLED") if status in statuses), "FINISHED")
