"""What reviewers look at first: of each stage its family, its main figure, and the strongest trivial one beside it."""

from dataclasses import dataclass

FAMILIES = {
    "strokes": ("collect_strokes", "train_stroke_dynamics", "diagnose_gap"),
    "painting": ("paint",),
    "co-painting": (
        "build_scenes",
        "train_semantics",
        "synthesize_copaintings",
        "pretrain_goal_planner",
        "finetune_goal_planner",
        "evaluate_copainting",
    ),
    "hands": ("gather_demonstrations", "train_trajvae", "draw_in_hands"),
    "sculpting": ("collect_pushes", "train_push_dynamics", "diagnose_pushes", "sculpt"),
    "delivery": ("deploy", "run_bundle", "report"),
}
OTHER = "other"
"""Where stages are tracked that belong to no family (see tests/pipelines/test_families.py)."""


@dataclass(frozen=True)
class Headline:
    """A stage's main figure on held-out data, by the names of its metrics."""

    metric: str
    baseline: str | None
    """The strongest answer that needs no such model; None where there is none to compare with."""


HEADLINES = {
    "train_stroke_dynamics": Headline("held_out.model.mse", "held_out.polyline.mse"),
    "diagnose_gap": Headline("held_out.extended.mse", "held_out.base.mse"),
    "paint": Headline("error.with_replanning", "error.without_replanning"),
    "train_semantics": Headline("main.picture.objects.recognised", "main.picture.objects.chance"),
    "pretrain_goal_planner": Headline("held_out.mse", "held_out.mse_of_copying"),
    "finetune_goal_planner": Headline("held_out.fine_tuned.mse", "held_out.fine_tuned.mse_of_copying"),
    "evaluate_copainting": Headline("table.fine_tuned.judge_score.value", "table.no_change.judge_score.value"),
    "train_push_dynamics": Headline("held_out.model.window_l_3d_mm2", "held_out.mean_footprint.window_l_3d_mm2"),
    "diagnose_pushes": Headline("held_out.planned_mm2", "held_out.network_mm2"),
    "deploy": Headline("largest_difference", None),
}


def family_of(stage: str) -> str:
    """The family of a stage, `OTHER` where it has none."""
    return next((family for family, stages in FAMILIES.items() if stage in stages), OTHER)


def experiment_of(stage: str) -> str:
    """The name of MLflow's experiment for a stage: one for each family, so that its columns belong together."""
    return f"pentimento/{family_of(stage)}"


def experiments() -> list[str]:
    """The names of all experiments."""
    return [f"pentimento/{family}" for family in (*FAMILIES, OTHER)]
