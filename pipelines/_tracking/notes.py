"""What MLflow's page says of a run: what its stage does, and its figures beside the trivial ones."""

import ast
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pipelines._tracking.families import HEADLINES

_LONGEST = 24  # rows; all figures are among the run's metrics anyway
_PIPELINES = Path(__file__).resolve().parents[1]


def note(stage: str, metrics: Mapping[str, Any]) -> str:
    """Return Markdown of a stage's run; `metrics` as in its metrics.json, nested."""
    said = [purpose(stage)] if purpose(stage) else []
    headline = HEADLINES.get(stage)
    if headline is not None:
        figure, baseline = (_at(metrics, name) for name in (headline.metric, headline.baseline))
        if figure is not None:
            beside = f", beside {baseline:.4g} of `{headline.baseline}`" if baseline is not None else ""
            said.append(f"**`{headline.metric}` {figure:.4g}**{beside}.")
    groups = sorted(_groups(metrics, ""), key=lambda group: group[0].startswith("training"))  # held-out figures first
    said += [_table(name, group) for name, group in groups]
    return "\n\n".join(said)


def purpose(stage: str) -> str:
    """The first sentence of the stage's module; empty for what is no stage of this pipeline."""
    file = _PIPELINES / f"{stage}.py"
    if not file.is_file():
        return ""
    return (ast.get_docstring(ast.parse(file.read_text(encoding="utf-8"))) or "").partition("\n")[0]


def _groups(metrics: Mapping[str, Any], name: str) -> list[tuple[str, Mapping[str, Any]]]:
    """The mappings in `metrics` whose entries have the same figures, such as a model and what is trivial."""
    inner = {key: value for key, value in metrics.items() if isinstance(value, Mapping)}
    if (
        len(inner) > 1
        and len({tuple(_figures(value)) for value in inner.values()}) == 1
        and _figures(next(iter(inner.values())))
    ):
        return [(name, inner)]
    return [group for key, value in inner.items() for group in _groups(value, f"{name}.{key}".strip("."))]


def _figures(values: Mapping[str, Any]) -> list[str]:
    return sorted(key for key, value in values.items() if isinstance(value, int | float))


def _table(name: str, group: Mapping[str, Any]) -> str:
    """Rows are figures, columns what they are of."""
    figures = _figures(next(iter(group.values())))[:_LONGEST]
    lines = [f"| {name or 'figure'} | {' | '.join(group)} |", f"|---|{'---:|' * len(group)}"]
    lines += [
        f"| {figure} | " + " | ".join(f"{each[figure]:.4g}" for each in group.values()) + " |" for figure in figures
    ]
    return "\n".join(lines)


def _at(metrics: Mapping[str, Any], name: str | None) -> float | None:
    """The number of a dotted name."""
    found: Any = metrics
    for key in (name or "").split("."):
        found = found.get(key) if isinstance(found, Mapping) else None
    return float(found) if isinstance(found, int | float) else None
