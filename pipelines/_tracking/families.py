"""What a reviewer sees first: the family of each stage, its main figure with a baseline, and the note on its run."""

import ast
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

FAMILIES = {
    "strokes": ("collect_strokes", "train_stroke_dynamics", "diagnose_gap"),
    "painting": ("paint", "paint_by_meaning", "plan_painting"),
    "co-painting": (
        "build_scenes",
        "train_semantics",
        "synthesize_copaintings",
        "pretrain_goal_planner",
        "finetune_goal_planner",
        "evaluate_copainting",
        "duet",
    ),
    "hands": ("gather_demonstrations", "train_trajvae", "draw_in_hands", "draw_subjects_in_hands"),
    "sculpting": ("collect_pushes", "train_push_dynamics", "diagnose_pushes", "sculpt"),
    "delivery": ("deploy", "run_bundle", "report"),
}
OTHER = "other"
"""Family of stages that no other family has."""
_DESCRIPTIONS = {
    "strokes": "Strokes of each brush and pen: recorded, predicted by a model, and the model's errors diagnosed.",
    "painting": "Paintings planned by gradient and executed by the virtual robot.",
    "co-painting": "Scenes, text-image encoders, the goal planner, and drawing together with a person.",
    "hands": "Handwriting styles of people, and drawings made in them.",
    "sculpting": "Pushes into clay and foam: recorded, predicted, diagnosed, and sculptures.",
    "delivery": "The bundle for the robot's computer, its trial run, and the report.",
    OTHER: "Stages that no other family has.",
}


@dataclass(frozen=True)
class Headline:
    """The main figure of a stage on held-out data, by the names of its metrics."""

    metric: str
    baseline: str | None
    """The metric of the strongest trivial answer; None where there is none to compare with."""


HEADLINES = {
    "train_stroke_dynamics": Headline("held_out.model.mse", "held_out.polyline.mse"),
    "diagnose_gap": Headline("held_out.extended.mse", "held_out.base.mse"),
    "paint": Headline("error.with_replanning", "error.without_replanning"),
    "plan_painting": Headline("error.plan", "error.blank"),
    "train_semantics": Headline("main.picture.objects.recognised", "main.picture.objects.chance"),
    "pretrain_goal_planner": Headline("held_out.mse", "held_out.mse_of_copying"),
    "finetune_goal_planner": Headline("held_out.fine_tuned.mse", "held_out.fine_tuned.mse_of_copying"),
    "evaluate_copainting": Headline("begun.fine_tuned.judge_score.value", "begun.no_change.judge_score.value"),
    "train_push_dynamics": Headline("held_out.model.window_l_3d_mm2", "held_out.mean_footprint.window_l_3d_mm2"),
    "diagnose_pushes": Headline("held_out.planned_mm2", "held_out.network_mm2"),
    "deploy": Headline("largest_difference", None),
}


def family_of(stage: str) -> str:
    """Return the family of a stage, `OTHER` where it has none."""
    return next((family for family, stages in FAMILIES.items() if stage in stages), OTHER)


def experiment_of(stage: str) -> str:
    """Return the name of a stage's MLflow experiment: one for each family, so that its columns are comparable."""
    return f"pentimento/{family_of(stage)}"


def experiment_tags(name: str) -> dict[str, str]:
    """Return the tags by which MLflow opens an experiment on its training runs and says what is in it."""
    family = name.rpartition("/")[2]
    stages = ", ".join(f"`{stage}`" for stage in FAMILIES.get(family, ()))
    figures = "; ".join(
        f"`{HEADLINES[stage].metric}` of `{stage}`" for stage in FAMILIES.get(family, ()) if stage in HEADLINES
    )
    paragraphs = [
        _DESCRIPTIONS.get(family, _DESCRIPTIONS[OTHER]),
        stages and f"Stages: {stages}.",
        figures and f"Main figures on held-out data: {figures}.",
    ]
    return {
        "mlflow.experimentKind": "custom_model_development",  # without it, MLflow shows traces of language models
        "mlflow.note.content": "\n\n".join(filter(None, paragraphs)),
    }


def experiments() -> list[str]:
    """Return the names of all experiments."""
    return [f"pentimento/{family}" for family in (*FAMILIES, OTHER)]


_MAX_ROWS = 24  # of a table; all figures are among the run's metrics
_PIPELINES = Path(__file__).resolve().parents[1]


def note(stage: str, metrics: Mapping[str, Any]) -> str:
    """Return the note on the page of a stage's run as Markdown; `metrics` as in its metrics.json, nested."""
    paragraphs = [purpose(stage)] if purpose(stage) else []
    headline = HEADLINES.get(stage)
    if headline is not None:
        figure, baseline = (_at(metrics, name) for name in (headline.metric, headline.baseline))
        if figure is not None:
            beside = f", beside {baseline:.4g} of `{headline.baseline}`" if baseline is not None else ""
            paragraphs.append(f"**`{headline.metric}` {figure:.4g}**{beside}.")
    groups = sorted(_groups(metrics, ""), key=lambda group: group[0].startswith("training"))  # held-out figures first
    paragraphs += [_table(name, group) for name, group in groups]
    return "\n\n".join(paragraphs)


def purpose(stage: str) -> str:
    """Return the first line of the stage module's docstring; empty for an unknown stage."""
    file = _PIPELINES / f"{stage}.py"
    if not file.is_file():
        return ""
    return (ast.get_docstring(ast.parse(file.read_text(encoding="utf-8"))) or "").partition("\n")[0]


def _groups(metrics: Mapping[str, Any], name: str) -> list[tuple[str, Mapping[str, Any]]]:
    """Return the mappings in `metrics` whose entries have equal keys, such as a model and its baselines."""
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
    """Return a table with a row for each figure and a column for each entry."""
    figures = _figures(next(iter(group.values())))[:_MAX_ROWS]
    lines = [f"| {name or 'figure'} | {' | '.join(group)} |", f"|---|{'---:|' * len(group)}"]
    lines += [
        f"| {figure} | " + " | ".join(f"{each[figure]:.4g}" for each in group.values()) + " |" for figure in figures
    ]
    return "\n".join(lines)


def _at(metrics: Mapping[str, Any], name: str | None) -> float | None:
    """Return the number under a dotted name; None where there is none."""
    found: Any = metrics
    for key in (name or "").split("."):
        found = found.get(key) if isinstance(found, Mapping) else None
    return float(found) if isinstance(found, int | float) else None
