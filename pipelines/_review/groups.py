"""Groups of runs of one stage with different seeds, and whether one group is better than another or lucky.

Runs of equal seed number read the same data and start from the same random numbers, so that the groups are paired over
seeds. The interval of the mean difference is Student's over the seeds. Where all runs recorded what each of the same
held-out items contributes, the variance from the choice of items (a bootstrap over items) is added.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from pentimento.contracts.errors import PentimentoError
from pentimento.contracts.statistics import difference, item_resamples
from pipelines._review.figures import figures, less_is_better
from pipelines._review.history import Execution, History, StageRun
from pipelines._tracking.families import HEADLINES

_MIN_SEEDS = 3  # Student's interval of two is thirteen times their standard error
_MIN_ITEMS = 6
_CONFIDENCE = 0.95


@dataclass(frozen=True)
class Group:
    """Executions of `make repro SEEDS=… STAGE=…`."""

    name: str
    stage: str
    """Or stage@item."""
    profile: str
    members: dict[int, Execution]
    """By seed number."""


@dataclass(frozen=True)
class SeedFigure:
    """One figure of a stage item in two groups, over the seeds that both have."""

    stage: str
    name: str
    a: tuple[float, ...]
    b: tuple[float, ...]
    items: int
    """Number of held-out items whose choice the interval accounts for; 0 where it accounts for seeds alone."""
    half_width: float
    """Of the 95 % interval of the mean difference."""

    @property
    def mean(self) -> float:
        """Mean of B − A."""
        return float(np.mean(np.subtract(self.b, self.a)))

    @property
    def main(self) -> bool:
        """Whether it is the stage's main figure."""
        known = HEADLINES.get(self.stage.partition("@")[0])
        return known is not None and known.metric == self.name

    @property
    def verdict(self) -> str:
        """Which group is better, or that the difference may be luck."""
        if self.a == self.b:
            return "equal"
        if abs(self.mean) <= self.half_width:
            return "may be luck"
        return f"{'B' if (self.mean < 0) == bool(less_is_better(self.name)) else 'A'} is better; beyond luck"


def groups(history: History) -> list[Group]:
    """Return the groups of which at least one run ended well, newest first."""
    found: dict[str, dict[int, Execution]] = {}
    for execution in history.executions:
        if "group" in execution.tags and execution.status == "FINISHED":
            found.setdefault(execution.tags["group"], {})[int(execution.tags["seed"])] = execution
    return [
        Group(name, name.partition(" · ")[0], next(iter(members.values())).tags.get("profile", ""), members)
        for name, members in found.items()
    ]


def compare_groups(history: History, a: Group, b: Group) -> list[SeedFigure]:
    """Return the figures that both groups have and whose better direction is known, the main ones first.

    Raises:
        PentimentoError: they have fewer than three seeds in common, or no stage item.
    """
    seeds = sorted(set(a.members) & set(b.members))
    if len(seeds) < _MIN_SEEDS:
        raise PentimentoError(
            f"{a.name!r} and {b.name!r} have {len(seeds)} seeds in common and {_MIN_SEEDS} are needed; "
            f"make both with `make repro SEEDS=5 STAGE={b.stage}`."
        )
    runs = [[_runs(history, group, seed) for seed in seeds] for group in (a, b)]
    names = [name for name in runs[1][0] if all(name in member for side in runs for member in side)]
    if not names:
        raise PentimentoError(
            f"No stage item ran in all runs of {a.name!r} and {b.name!r}; compare groups of one stage."
        )
    found = [
        figure
        for name in names
        for figure in _figures(history, name, *([member[name] for member in side] for side in runs))
    ]
    return sorted(found, key=lambda figure: (not figure.main, figure.stage, figure.name.startswith("training.")))


def _runs(history: History, group: Group, seed: int) -> dict[str, StageRun]:
    """Return the runs of a member of the stage that the group is of, by stage item."""
    standing = history.of_execution(group.members[seed])
    return {name: run for name, run in standing.items() if group.stage in (run.name, run.stage)}


def _figures(history: History, stage: str, a: Sequence[StageRun], b: Sequence[StageRun]) -> list[SeedFigure]:
    """Return the figures that all runs of a stage item have."""
    runs = [*a, *b]
    names = [figure.name for figure in figures(a[0].metrics, a[0].metrics) if less_is_better(figure.name) is not None]
    found = []
    for name in names:
        if name != "wall_s" and all(name in run.metrics for run in runs):
            of_a, of_b = (tuple(run.metrics[name] for run in side) for side in (a, b))
            by_seed = np.subtract(of_b, of_a)
            quantile = stats.t.ppf((1 + _CONFIDENCE) / 2, len(by_seed) - 1)
            over_seeds = float(quantile * np.std(by_seed, ddof=1) / math.sqrt(len(by_seed)))
            items, over_items = _over_items(history, name, a, b)
            found.append(SeedFigure(stage, name, of_a, of_b, items, math.hypot(over_seeds, over_items)))
    return found


def _over_items(history: History, name: str, a: Sequence[StageRun], b: Sequence[StageRun]) -> tuple[int, float]:
    """Return the number of items, and half the interval of the difference from the choice of items; 0 if unknown."""
    runs, mark = [*a, *b], f"items.{name}"
    if any(run.tags.get(mark) != a[0].tags.get(mark, "none") or run.inputs != a[0].inputs for run in runs):
        return 0, 0.0
    of_a, of_b = (np.mean([history.items(run, name) for run in side], axis=0) for side in (a, b))
    if len(of_a) < _MIN_ITEMS:
        return 0, 0.0
    estimate = difference(of_b, of_a, item_resamples(len(of_a), 0))
    return (0, 0.0) if estimate is None else (len(of_a), (estimate.high - estimate.low) / 2)


def spread(history: History, group: Group) -> list[str]:
    """Return a line for each stage item's main figure, and one for its baseline, over the seeds of one group."""
    runs = [_runs(history, group, seed) for seed in sorted(group.members)]
    lines = []
    for name, first in runs[0].items():
        headline = HEADLINES.get(first.stage)
        for metric in filter(None, (headline.metric, headline.baseline) if headline else ()):
            values = [run[name].metrics[metric] for run in runs if name in run and metric in run[name].metrics]
            if len(values) == len(runs) > 1:
                lines.append(f"{name}: {metric} {_mean(values)} ({', '.join(f'{value:.4g}' for value in values)})")
    return lines


def table(figures_: Sequence[SeedFigure]) -> str:
    """Return the table for the terminal."""
    lines = [("stage", "figure", "A", "B", "B − A, 95 % interval", "verdict"), *map(columns, figures_)]
    widths = [max(len(line[column]) for line in lines) for column in range(len(lines[0]))]
    return "\n".join("  ".join(map(str.ljust, line, widths)).rstrip() for line in lines)


def columns(figure: SeedFigure) -> tuple[str, ...]:
    """Return a figure's row: stage, figure, A, B, their difference with its interval, and the verdict."""
    low, high = figure.mean - figure.half_width, figure.mean + figure.half_width
    over = f"{len(figure.a)} seeds" + (f", {figure.items} items" if figure.items else "")
    change = f"{figure.mean:+.3g} [{low:+.3g}, {high:+.3g}] over {over}".replace("-", "−")
    name = f"{figure.name} (main)" if figure.main else figure.name
    return figure.stage, name, _mean(figure.a), _mean(figure.b), change, figure.verdict


def _mean(values: Sequence[float]) -> str:
    """Mean and standard deviation over seeds."""
    return f"{np.mean(values):.4g} ± {np.std(values, ddof=1):.2g}"
