"""Two groups of seeds as one self-contained HTML page: figures paired over seeds and items, and pictures by seed."""

from collections.abc import Sequence
from typing import Any

from pentimento.report.templates import render
from pipelines._review.groups import Group, SeedFigure, columns
from pipelines._review.history import History
from pipelines._review.page import beside

_CLASSES = {"may be luck": "unsure", "equal": ""}
"""CSS class by verdict; the others are sure."""


def group_page(history: History, a: Group, b: Group, *, found: Sequence[SeedFigure], changes: Sequence[str]) -> str:
    """Return the page.

    Args:
        found: the figures of `compare_groups`.
        changes: sentences on what differs between the groups.
    """
    seeds = sorted(set(a.members) & set(b.members))
    return render(
        "group_comparison.html",
        groups=[a.name, b.name],
        changes=changes,
        figures=[_figure(figure) for figure in found],
        by_seed=[_by_seed(figure, seeds) for figure in found if figure.main],
        pictures=_pictures(history, a, b, stages=list(dict.fromkeys(figure.stage for figure in found)), seeds=seeds),
    )


def _figure(figure: SeedFigure) -> dict[str, Any]:
    return {"cells": list(columns(figure)), "class": _CLASSES.get(figure.verdict, "sure")}


def _by_seed(figure: SeedFigure, seeds: Sequence[int]) -> dict[str, Any]:
    pairs = zip(seeds, figure.a, figure.b, strict=True)
    return {
        "title": f"{figure.name} of {figure.stage}",
        "rows": [(f"{seed}", f"{a:.4g}", f"{b:.4g}", f"{b - a:+.3g}".replace("-", "−")) for seed, a, b in pairs],
    }


def _pictures(
    history: History, a: Group, b: Group, *, stages: Sequence[str], seeds: Sequence[int]
) -> list[dict[str, Any]]:
    """Of each seed and stage item that has pictures: those of A beside those of B, and their differences."""
    shown = []
    for seed in seeds:
        runs = [history.of_execution(group.members[seed]) for group in (a, b)]
        for stage in stages:
            rows = beside(*(history.pictures(side[stage]) for side in runs))
            if rows:
                shown.append({"title": f"{stage}, seed {seed}", "rows": rows})
    return shown
