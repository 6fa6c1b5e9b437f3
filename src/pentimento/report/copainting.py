"""The report's section on co-painting: Table 6.1 of the thesis with baselines, example drawings, turns."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from markupsafe import Markup

from pentimento.contracts.errors import ContractError
from pentimento.report.html import Album
from pentimento.report.templates import render
from pentimento.report.wording import decimal, percent

_METHODS = {
    "no_change": "no change",
    "copy_input": "copy the input",
    "ignore_input": "ignore the input",
    "text_only": "no goal planner, text-guided",
    "base": "base, no fine-tuning",
    "fine_tuned": Markup("<b>fine-tuned</b>"),
    "oracle": "oracle: the true full drawing",
}
_COLUMNS = {
    "clip_score": "CLIPScore ↑",
    "judge_score": "judge score ↑",
    "objects": "found ↑",
    "delta_pix": Markup("1000 Δ<sub>pix</sub> ↓"),
    "delta_sem": Markup("1000 Δ<sub>sem</sub> ↓"),
    "goal_keeps": "ink kept by the goal ↑",
    "drawing_keeps": "by the drawing ↑",
    "changed": "changed",
    "strokes": "strokes",
}
_SHARES = {"objects", "goal_keeps", "drawing_keeps", "changed", "covered", "first_found"}
_THOUSANDTHS = {"delta_pix", "delta_sem"}
_SYMBOLS = {"delta_pix": Markup("Δ<sub>pix</sub>"), "delta_sem": Markup("Δ<sub>sem</sub>")}
_PICTURES = ("begun", "on_paper", "other_medium", "turns", "executed")
_FURTHER = {
    "overlapping": "On canvases that another drawing fills; the requested object is drawn over it",
    "composed_seen": "Several objects in a relation, on blank paper; pairs and relations occur in training",
    "composed_held_out": "Several objects in a relation, on blank paper; pairs and relations do not occur in training",
}
"""Tables that only named things have."""
_KINDS = {
    "begun": "beside another drawing",
    "overlapping": "over a drawing that fills the canvas",
    "on_paper": "on blank paper",
    "composed_seen": "several objects, combinations in the training data",
    "composed_held_out": "several objects, combinations not in the training data",
}
_OF_A_TURN = (
    "judge_score_no_change", "judge_score", "goal_keeps", "drawing_keeps", "changed", "covered", "first_found",
    "strokes",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class CopaintingInputs:
    """The evaluation of one setting."""

    setting: str
    metrics: dict[str, Any]
    pictures: dict[str, bytes]
    """PNG by name."""


def read_copainting(setting: str, folder: Path) -> CopaintingInputs:
    """Read the folder that an evaluation wrote.

    Raises:
        ContractError: the metrics are missing, not JSON, or lack a part.
    """
    path = folder / "metrics.json"
    try:
        metrics = json.loads(path.read_text(encoding="utf-8"))
        for part in ("begun", "comparisons", "on_paper", "other_medium", "turns", "executed", "correlation", "cases"):
            metrics[part]
        shown = [*_PICTURES, *(name for name in _FURTHER if name in metrics)]
        pictures = {name: (folder / f"{name}.png").read_bytes() for name in shown}
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ContractError(f"{folder} holds no evaluation ({error}); run the stage evaluate_copainting.") from error
    return CopaintingInputs(setting, metrics, pictures)


def copainting_section(evaluations: Sequence[CopaintingInputs], album: Album) -> Markup:
    """HTML of the section; its pictures go into the album."""
    return render("report/copainting.html", album=album, settings=[_values(inputs) for inputs in evaluations])


def _values(inputs: CopaintingInputs) -> dict[str, Any]:
    metrics = inputs.metrics
    correlation = metrics["correlation"]
    return {
        "name": inputs.setting,
        "title": inputs.setting.replace("_", " ").capitalize(),
        "cases": metrics["cases"],
        "pictures": inputs.pictures,
        "gains": _gains(metrics),
        "begun": _scores(metrics["begun"]),
        "paper": _scores(metrics["on_paper"]),
        "further": [
            _scores(metrics[name]) | {"name": name, "title": title, "cases": metrics["cases"][name]}
            for name, title in _FURTHER.items()
            if name in metrics
        ],
        "foreign": _scores(metrics["other_medium"]),
        "executed": _executed_rows(metrics),
        "turns": _turn_rows(metrics["turns"]),
        "correlations": [_correlation(name, found) for name, found in correlation.items()],
        "paintings": max((int(found["paintings"]) for found in correlation.values()), default=0),
    }


def _scores(rows: Mapping[str, Mapping[str, Any]]) -> dict[str, list[Any]]:
    """The `head` and the `rows` of a table of the methods' scores."""
    used = [name for name in _COLUMNS if any(name in row for row in rows.values())]
    lines = [
        [label, *(_cell(rows[method].get(name), name) for name in used)]
        for method, label in _METHODS.items()
        if method in rows
    ]
    return {"head": ["method", *(_COLUMNS[name] for name in used)], "rows": lines}


def _cell(estimate: Mapping[str, float] | None, column: str) -> str:
    if estimate is None:
        return "–"
    thousandths = column in _THOUSANDTHS
    value, low, high = (
        f"{1000 * estimate[name]:.2f}".replace("-", "−") if thousandths else _number(estimate[name], column in _SHARES)
        for name in ("value", "low", "high")
    )
    return Markup(f"{value}<br><small>{low}&nbsp;… {high}</small>")


def _number(value: float, share: bool) -> str:
    if share:
        return percent(value)
    text = f"{value:.3f}" if abs(value) < 10 else decimal(value)
    return text.replace("-", "−")


def _gains(metrics: Mapping[str, Any]) -> list[str]:
    """The gains by fine-tuning as sentences, each with its interval."""
    found = metrics["comparisons"]
    lines: list[str] = []
    for name, symbol in _SYMBOLS.items():
        closed, ratio = found.get(f"{name}_closed"), found.get(f"{name}_ratio")
        if closed is not None:
            share = _estimate(closed, True)
            lines.append(
                Markup("Fine-tuning closes {} of the gap in {} between base and oracle.").format(share, symbol)
            )
        else:
            lines.append(
                Markup("The base’s {} is no larger than the oracle’s: there is no gap to close.").format(symbol)
            )
        if ratio is not None:
            factor = _estimate(ratio, False)
            lines.append(Markup("{} of the base is {} times that of the fine-tuned planner.").format(symbol, factor))
    for other, words in (("no_change", "no change"), ("base", "no fine-tuning")):
        gain = found.get(f"judge_score_over_{other}")
        if gain is not None:
            lines.append(f"The judge score of the fine-tuned planner is {_estimate(gain, False)} above {words}.")
    kept = metrics.get("vae_ink_recall", {}).get("fine_tuned")
    if kept is not None:
        lines.append(f"The autoencoder alone keeps {percent(kept)} of the ink.")
    return lines


def _estimate(value: Mapping[str, float], share: bool) -> str:
    middle, low, high = (_number(value[name], share) for name in ("value", "low", "high"))
    return f"{middle} ({low}\u00a0… {high})"


def _executed_rows(metrics: Mapping[str, Any]) -> list[list[str]]:
    """By kind of request, what the judge finds on photographs, and in the predicted drawing of the oracle."""
    return [
        [_KINDS[name], _cell(found, "objects"), _cell(metrics[name]["oracle"].get("objects"), "objects")]
        for name, found in metrics["executed"].items()
    ]


def _turn_rows(turns: Mapping[str, Sequence[Mapping[str, float | None]]]) -> list[list[str]]:
    def cell(value: float | None, name: str) -> str:
        return "–" if value is None else _number(float(value), name in _SHARES)

    return [
        [Markup("turn {}, {}").format(number, _METHODS[method]), *(cell(turn[name], name) for name in _OF_A_TURN)]
        for method, played in turns.items()
        for number, turn in enumerate(played, 1)
    ]


def _correlation(name: str, found: Mapping[str, float]) -> Markup:
    """Whether drawings that lose more of a scene fit its text less (thesis 6.8.2)."""
    p = f"{found['p']:.1g}".replace("e-", "e−")
    return Markup("{} and CLIPScore: r = {}, p = {}").format(_SYMBOLS[name], _number(found["r"], False), p)
