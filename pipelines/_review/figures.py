"""Figures of two runs: which side is better, and whether the difference could be luck."""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from pentimento.contracts.statistics import Estimate, difference, item_resamples

Side = Literal["A", "B"]

_MIN_ITEMS = 6  # a bootstrap over fewer items gives no useful interval
_EQUAL = 1e-9  # relative; metrics.json keeps 9 digits
_LESS_IS_BETTER = {
    "mse", "l1", "weighted_l1", "loss", "error", "deviation", "chamfer_mm", "emd_mm", "l_3d_mm2", "l_viz", "delta_pix",
    "delta_sem", "window_l_3d_mm2", "window_l_viz", "network_mm2", "planned_mm2", "corrected_mm2", "sim2real_mse",
    "pixel_mse", "validation_l1", "quarantined", "largest_difference", "wall_s", "error_3d_mm2", "visual_error",
    "prediction_error_mm2", "plan_execution_error_base", "plan_execution_error_extended", "over_floor",
}  # fmt: skip
_MORE_IS_BETTER = {
    "iou", "gap_closed", "recognised", "clip_score", "judge_score", "objects", "kept", "retrieval", "sim2real_factor",
    "replanning_lowers_error_by", "plan_execution_factor", "vae_ink_recall",
}  # fmt: skip
# Baselines and counts, of which neither side is better.
_BASELINE = re.compile(
    r"(^|[./])(blank|unchanged|chance|floor|polyline|copy_input|no_change|mean_footprint|oracle)([./]|$)"
)
_BOUND = re.compile(r"(.*)[._](low|high)$")


@dataclass(frozen=True)
class Figure:
    """One metric of both runs; None where a run has none."""

    name: str
    values: tuple[float | None, float | None]
    intervals: tuple[tuple[float, float] | None, tuple[float, float] | None]
    """95 %, as recorded."""
    better: Side | None
    """By value alone; None where the values are equal or the direction is unknown."""
    paired: Estimate | None
    """B − A over the same held-out items, with a 95 % bootstrap interval."""
    items: int
    """Number of paired items."""
    not_paired: str = ""
    """Why the values of the held-out items that both runs recorded are not paired; empty where they are, or are not
    recorded."""
    other_task: str = ""
    """Parameter that gave both runs different tasks, so that neither is better; empty where their task is the same."""

    @property
    def changed(self) -> bool:
        """Whether the values differ at all."""
        a, b = self.values
        return a is None or b is None or not math.isclose(a, b, rel_tol=_EQUAL, abs_tol=1e-300)

    @property
    def beyond_luck(self) -> bool | None:
        """Whether the choice of held-out items does not explain the difference; None if unknown."""
        if not self.changed:
            return False
        if self.other_task:
            return None
        if self.paired is not None:
            return self.paired.low > 0 or self.paired.high < 0
        a, b = self.intervals
        return None if a is None or b is None else a[0] > b[1] or b[0] > a[1]

    @property
    def sentence(self) -> str:
        """Which side is better, and whether the difference could be luck."""
        if not self.changed:
            return "equal"
        if None in self.values:
            return "in one run only"
        if self.other_task:
            return f"differs; not comparable: the runs have different tasks ({self.other_task})"
        better = f"{self.better} is better" if self.better else "differs"
        if self.beyond_luck is None:
            return f"{better}; {self.not_paired or 'no interval recorded'}, so luck is not ruled out"
        if self.paired is not None:
            by = f"B − A = {self.paired.value:+.3g} [{self.paired.low:+.3g}, {self.paired.high:+.3g}]"
            luck = "beyond luck" if self.beyond_luck else "may be luck"
            return f"{better}; {luck}: {by.replace('-', '−')}, paired over {self.items} held-out items"
        return (
            f"{better}; beyond luck: the intervals do not overlap"
            if self.beyond_luck
            else (f"{better}; may be luck: the intervals overlap")
        )


def figures(a: Mapping[str, float], b: Mapping[str, float]) -> list[Figure]:
    """Return every metric of either run, unpaired, except bounds of intervals and values of items."""
    names = dict.fromkeys([*a, *b])
    return [
        Figure(name, (a.get(name), b.get(name)), (_interval(a, name), _interval(b, name)), _better(a, b, name), None, 0)
        for name in names
        if not name.startswith("items.") and not _is_bound(name, names)
    ]


def paired(figure: Figure, a: Sequence[float], b: Sequence[float], seed: int) -> Figure:
    """Return the figure with its paired difference over the same items, or with the reason why there is none."""
    if len(a) != len(b) or len(a) < _MIN_ITEMS:
        fewest = min(len(a), len(b))
        too_few = f"an interval needs {_MIN_ITEMS} held-out items and there {'is' if fewest == 1 else 'are'} {fewest}"
        return replace(figure, not_paired=too_few if fewest < _MIN_ITEMS else "the numbers of held-out items differ")
    estimate = difference(np.asarray(b), np.asarray(a), item_resamples(len(a), seed))
    return replace(figure, paired=estimate, items=len(a))


def less_is_better(name: str) -> bool | None:
    """Return the direction of a metric by the last known part of its name; None where it is unknown or a baseline."""
    if _BASELINE.search(name):
        return None
    for part in reversed(re.split(r"[./]", name)):
        if part in _LESS_IS_BETTER:
            return True
        if part in _MORE_IS_BETTER:
            return False
    return None


def _better(a: Mapping[str, float], b: Mapping[str, float], name: str) -> Side | None:
    less = less_is_better(name)
    if less is None or name not in a or name not in b or a[name] == b[name]:
        return None
    return "A" if (a[name] < b[name]) == less else "B"


def _interval(values: Mapping[str, float], name: str) -> tuple[float, float] | None:
    """Return the interval `x.low`, `x.high` or `x_low`, `x_high` of a figure `x` or `x.value`."""
    stem = name.removesuffix(".value")
    for mark in "._":
        if f"{stem}{mark}low" in values and f"{stem}{mark}high" in values:
            return values[f"{stem}{mark}low"], values[f"{stem}{mark}high"]
    return None


def _is_bound(name: str, names: Mapping[str, None]) -> bool:
    found = _BOUND.match(name)
    return found is not None and (found[1] in names or f"{found[1]}.value" in names)
