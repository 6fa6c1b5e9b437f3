"""The differences between two runs, or stage by stage between two executions of the pipeline."""

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace

from pipelines._review.agreement import OUTPUT
from pipelines._review.figures import Figure, figures, paired
from pipelines._review.history import Execution, History, StageRun
from pipelines._tracking.families import HEADLINES
from pipelines._tracking.run import SYSTEM

Pair = tuple[str | None, str | None]

_TIME = "wall_s"
_TASK = ("photograph", "world", "goals")
"""Parameters of the stages that paint and sculpt which say what is to be made, and in which world."""


@dataclass(frozen=True)
class Side:
    """One of the two compared runs or executions."""

    title: str
    started_ms: int
    status: str
    commit: str
    dirty: bool
    profile: str
    runs: dict[str, StageRun]
    """By stage item."""

    @property
    def started(self) -> str:
        """Local time."""
        return time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(self.started_ms / 1000))


@dataclass(frozen=True)
class StageDifference:
    """The differences of one stage item; a side is None where it has no run of it."""

    name: str
    runs: tuple[StageRun | None, StageRun | None]
    params: dict[str, Pair]
    """Parameters that differ."""
    inputs: dict[str, Pair]
    """MD5 of data and models read that differ, by path."""
    outputs: dict[str, Pair]
    """MD5 of data and models written that differ, by path."""
    figures: tuple[Figure, ...]
    """The main figure first, then figures with a better side, then the others."""
    seconds: tuple[float | None, float | None]
    pictures: tuple[dict[str, bytes], dict[str, bytes]]
    """PNGs by name."""

    @property
    def same(self) -> bool:
        """Whether both sides are one run, or differ only in time; a run that did not finish has no results."""
        a, b = self.runs
        if a is None or b is None:
            return False
        if a.id == b.id:
            return True
        changed = self.params or self.inputs or self.outputs or any(figure.changed for figure in self.figures)
        return not changed and a.status == b.status == "FINISHED"

    @property
    def headline(self) -> Figure | None:
        """The stage's main figure."""
        known = HEADLINES.get(self.name.partition("@")[0])
        return next((each for each in self.figures if known and each.name == known.metric), None)


@dataclass(frozen=True)
class Comparison:
    """Two sides and their differences."""

    sides: tuple[Side, Side]
    stages: tuple[StageDifference, ...]
    """In the order of execution."""

    @property
    def changed(self) -> tuple[StageDifference, ...]:
        """Stages that differ."""
        return tuple(stage for stage in self.stages if not stage.same)

    @property
    def origins(self) -> dict[str, Pair]:
        """Source and licence of the data that each side read, as far as known, by path."""
        a, b = (
            {path: origin for run in side.runs.values() for path, origin in run.origins.items()} for side in self.sides
        )
        return {path: (a.get(path), b.get(path)) for path in sorted(a | b)}


def compare(history: History, a: StageRun | Execution, b: StageRun | Execution) -> Comparison:
    """Compare two runs, or two executions. Runs of different stages have only figures in common."""
    sides = (_side(history, a), _side(history, b))
    pairs: dict[str, tuple[StageRun | None, StageRun | None]]
    if isinstance(a, StageRun) and isinstance(b, StageRun):
        pairs = {a.name if a.name == b.name else f"{a.name} and {b.name}": (a, b)}
    else:
        runs = [run for side in sides for run in side.runs.values()]
        names = dict.fromkeys(run.name for run in sorted(runs, key=lambda run: run.started_ms))
        pairs = {name: (sides[0].runs.get(name), sides[1].runs.get(name)) for name in names}
    return Comparison(sides, tuple(_stage(history, name, *pair) for name, pair in pairs.items()))


def _side(history: History, of: StageRun | Execution) -> Side:
    if isinstance(of, Execution):
        title, runs = of.name, history.of_execution(of)
    else:
        title, runs = f"{of.name} {of.id[:8]}", {of.name: of}
    tags = of.tags
    return Side(
        title,
        of.started_ms,
        of.status,
        tags.get("commit", ""),
        tags.get("dirty") == "true",
        tags.get("profile", ""),
        runs,
    )


def _stage(history: History, name: str, a: StageRun | None, b: StageRun | None) -> StageDifference:
    metrics_a, metrics_b = _metrics(a), _metrics(b)
    seconds = (metrics_a.pop(_TIME, None), metrics_b.pop(_TIME, None))
    if a is not None and b is not None and a.id == b.id:
        return StageDifference(name, (a, b), {}, {}, {}, (), seconds, ({}, {}))
    params = _differing(a.params, b.params) if a and b else {}
    found = [_with_items(history, figure, a, b) for figure in figures(metrics_a, metrics_b)]
    if task := _other_task(name, params):
        found = [replace(figure, better=None, other_task=task) for figure in found]
    return StageDifference(
        name,
        (a, b),
        params,
        _differing(a.inputs, b.inputs) if a and b else {},
        _differing(_outputs(a), _outputs(b)) if a and b else {},
        tuple(sorted(found, key=lambda figure: _rank(name, figure))),
        seconds,
        (history.pictures(a) if a else {}, history.pictures(b) if b else {}),
    )


def _other_task(name: str, params: Mapping[str, Pair]) -> str:
    """The differing parameter that gives two runs of a stage item different tasks; empty where there is none."""
    stage, _, item = name.partition("@")
    own = f"settings.{item}." if stage == "sculpt" else ""
    known = [f"{own}{part}" for part in _TASK] if stage in ("paint", "sculpt") else []
    return next((part.removeprefix(own) for part in known if part in params), "")


def _metrics(run: StageRun | None) -> dict[str, float]:
    """Return a run's metrics, without the processor time and memory that it used."""
    return {name: value for name, value in run.metrics.items() if not name.startswith(SYSTEM)} if run else {}


def _with_items(history: History, figure: Figure, a: StageRun | None, b: StageRun | None) -> Figure:
    """Pair a figure where both runs kept the values of the same held-out items; else say why not."""
    mark = f"items.{figure.name}"
    if a is None or b is None or not figure.changed or mark not in a.tags or mark not in b.tags:
        return figure
    if a.inputs != b.inputs:  # items of one name may differ between data sets
        return replace(figure, not_paired="the runs read different data, so that held-out items are not paired")
    if a.tags[mark] != b.tags[mark]:
        return replace(figure, not_paired="the held-out items differ")
    return paired(figure, history.items(a, figure.name), history.items(b, figure.name), 0)


def _outputs(run: StageRun) -> dict[str, str]:
    return {tag.removeprefix(OUTPUT): digest for tag, digest in run.tags.items() if tag.startswith(OUTPUT)}


def _differing(a: Mapping[str, str], b: Mapping[str, str]) -> dict[str, Pair]:
    return {name: (a.get(name), b.get(name)) for name in dict.fromkeys([*a, *b]) if a.get(name) != b.get(name)}


def _rank(stage: str, figure: Figure) -> tuple[int, str]:
    headline = HEADLINES.get(stage.partition("@")[0])
    if headline is not None and figure.name in (headline.metric, headline.baseline):
        return int(figure.name == headline.baseline), figure.name
    if not figure.changed:
        return 5, figure.name
    return 2 + int(figure.better is None) + int(figure.name.startswith("training.")), figure.name
