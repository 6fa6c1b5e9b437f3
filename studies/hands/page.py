"""The study's page."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

TITLES: Final = {"motion_capture": "Motion capture of a marker", "tablet": "Web tablet"}


def page(found: Mapping[str, Any], few: int) -> str:
    """Markdown of all tables; numbers are those of ``hands.json``."""
    parts = [
        "# TrajVAE on strokes that people drew\n\n"
        "Written by `python -m studies.hands`; do not edit. Distances are means over points of held-out strokes, mm. "
        f"*nearest* takes the nearest of the session's {few} strokes that the model was fine-tuned on, *mean* their "
        "mean.\n"
    ]
    for name, title in TITLES.items():
        result = found[name]
        gathered = result["gathered"]
        faults = {fault: n for fault, n in gathered["faults"].items() if n}
        parts.append(
            f"## {title}\n\n{gathered['recorded']} strokes recorded, {gathered['kept']} kept; faults: "
            f"{faults or 'none'}.\n\n{_sessions(result['sessions'], few)}\n\n{_auc(result['auc'])}\n\n"
            f"{_by_number(result['auc_by_number'])}\n\n"
            f"People's strokes, and below them as many samples, two rows a session:\n\n![]({name}_samples.png)\n\n"
            f"The latent space:\n\n![]({name}_map.png)\n"
        )
    quick = found["quickdraw"]
    parts.append(
        f"## Quick, Draw!\n\n{quick['gathered']['recorded']} strokes of {quick['gathered']['sessions']} drawings; "
        f"{quick['measured']} strokes of held-out drawings: {quick['pretrained_mm']:.2f} mm (nearest of all strokes "
        f"learned from {quick['nearest_mm']:.2f}, mean stroke {quick['mean_stroke_mm']:.2f}).\n"
    )
    return "\n".join(parts)


def _sessions(sessions: list[dict[str, Any]], few: int) -> str:
    lines = [
        f"| session | strokes measured | pretrained | fine-tuned on {few} | nearest | mean |",
        "|---|---|---|---|---|---|",
    ]
    for result in sessions:
        numbers = (f"{result[key]:.2f}" for key in ("pretrained_mm", "fine_tuned_mm", "nearest_mm", "mean_stroke_mm"))
        lines.append(f"| {result['session']} | {result['measured']} | {' | '.join(numbers)} |")
    return "\n".join(lines)


def _auc(auc: Mapping[str, float]) -> str:
    lines = ["| samples of | AUC against held-out strokes |", "|---|---|"]
    return "\n".join(lines + [f"| {name} | {value:.2f} |" for name, value in auc.items()])


def _by_number(result: list[dict[str, Any]]) -> str:
    lines = [
        "| session | strokes known | strokes measured | AUC of samples | AUC, 20 against 20 |",
        "|---|---|---|---|---|",
    ]
    for row in result:
        aucs = f"{row['auc']:.2f} | {row['auc_of_few']:.2f}"
        lines.append(f"| {row['session']} | {row['known']} | {row['measured']} | {aucs} |")
    return "\n".join(lines)
