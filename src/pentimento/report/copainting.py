"""The report's section on co-painting: Table 6.1 of the thesis with its baselines, drawings side by side, the turns."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

from pentimento.contracts.errors import ContractError
from pentimento.report.html import Album, table
from pentimento.report.wording import count, decimal, percent

_METHODS = {
    "no_change": "no change",
    "copy_input": "copy the input",
    "ignore_input": "ignore the input",
    "text_only": "no goal planner, text-guided",
    "base": "base, no fine-tuning",
    "fine_tuned": "<b>fine-tuned</b>",
    "oracle": "oracle: the true full drawing",
}
_COLUMNS = {
    "clip_score": "CLIPScore ↑",
    "judge_score": "judge score ↑",
    "objects": "found ↑",
    "delta_pix": "1000 Δ<sub>pix</sub> ↓",
    "delta_sem": "1000 Δ<sub>sem</sub> ↓",
    "goal_keeps": "ink kept by the goal ↑",
    "drawing_keeps": "by the drawing ↑",
    "changed": "changed",
    "strokes": "strokes",
}
_SHARES = {"objects", "goal_keeps", "drawing_keeps", "changed"}
_THOUSANDTHS = {"delta_pix", "delta_sem"}
_PICTURES = {
    "methods": (
        "Begun drawings, and for each method its goal and the drawing that the robot foretells.",
        "Drawings of other prompts, what each method wants to make of them, and what the robot would draw.",
    ),
    "on_paper": (
        "Goals and foretold drawings on blank paper.",
        "The same prompts on blank paper; <code>oracle</code> is the scene itself as the robot draws it.",
    ),
    "other_medium": (
        "Goals and foretold drawings on canvases that were begun with another medium.",
        "Canvases begun with a medium that fine-tuning never saw.",
    ),
    "turns": (
        "Three turns on one sheet: the person's strokes, the goal, the plan, and the robot's strokes.",
        "Three turns on one sheet in the studio (photographs): the person draws and asks, the robot looks, plans a "
        "goal and adds to it. From top to bottom.",
    ),
}


@dataclass(frozen=True, eq=False)
class CopaintingInputs:
    """What the evaluation of one setting found."""

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
        for part in ("table", "comparisons", "on_paper", "other_medium", "turns", "correlation", "cases"):
            metrics[part]
        pictures = {name: (folder / f"{name}.png").read_bytes() for name in _PICTURES}
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ContractError(f"{folder} holds no evaluation ({error}); run the stage evaluate_copainting.") from error
    return CopaintingInputs(setting, metrics, pictures)


def copainting_section(evaluations: Sequence[CopaintingInputs], album: Album) -> str:
    """HTML of the section; its pictures go into the album."""
    return f"""<section id="copainting">
<h2>Drawing with a person</h2>
<p>A goal planner is given a begun drawing and a text, and answers with a picture of how the sheet should look; the
planner of strokes then foretells what the robot will make of it (thesis, chapter 6). The base has learned to complete
ordinary pictures; fine-tuning shows it what this robot can draw. <b>Δ<sub>pix</sub></b> and <b>Δ<sub>sem</sub></b> are
how far the foretold drawing is from the goal, in pixels and in meaning. The <b>judge</b> is an encoder that no plan was
guided by. <b>Found</b> is the share of the things asked for that the judge finds. A gap alone says little: copying the
input has none.</p>
{"".join(_of_setting(inputs, album) for inputs in evaluations)}
</section>"""


def _of_setting(inputs: CopaintingInputs, album: Album) -> str:
    metrics, cases = inputs.metrics, inputs.metrics["cases"]
    shown = {
        name: album.plot(f"copainting_{inputs.setting}_{name}.png", inputs.pictures[name], alt, caption)
        for name, (alt, caption) in _PICTURES.items()
    }
    begun = (
        f"{count(cases['prompts'], 'held-out prompt')} on begun drawings of other prompts. In small type: 95&nbsp;% by "
        "bootstrap over prompts."
    )
    paper = f"On blank paper: {count(cases['on_paper'], 'prompt')}. Objects stand in combinations not seen in training."
    foreign = f"On canvases begun with another medium: {count(cases['other_medium'], 'prompt')}."
    return f"""<h3>{escape(inputs.setting.replace("_", " ").capitalize())}</h3>
{_gains(metrics)}
{_scores(metrics["table"], begun)}
{shown["methods"]}
{_scores(metrics["on_paper"], paper)}
{shown["on_paper"]}
{_scores(metrics["other_medium"], foreign)}
{shown["other_medium"]}
<h4>Three turns</h4>
{_turns(metrics["turns"])}
{shown["turns"]}
{_correlations(metrics["correlation"])}"""


def _scores(rows: Mapping[str, Mapping[str, Any]], caption: str) -> str:
    used = [name for name in _COLUMNS if any(name in row for row in rows.values())]
    lines = [
        (label, *(_cell(rows[method].get(name), name) for name in used))
        for method, label in _METHODS.items()
        if method in rows
    ]
    return table(("method", *(_COLUMNS[name] for name in used)), lines, caption)


def _cell(estimate: Mapping[str, float] | None, column: str) -> str:
    if estimate is None:
        return "–"
    thousandths = column in _THOUSANDTHS
    value, low, high = (
        f"{1000 * estimate[name]:.2f}".replace("-", "−") if thousandths else _number(estimate[name], column in _SHARES)
        for name in ("value", "low", "high")
    )
    return f"{value}<br><small>{low}&nbsp;… {high}</small>"


def _number(value: float, share: bool) -> str:
    if share:
        return percent(value)
    text = f"{value:.3f}" if abs(value) < 10 else decimal(value)
    return text.replace("-", "−")


def _gains(metrics: Mapping[str, Any]) -> str:
    """What fine-tuning gains, each with its interval."""
    found = metrics["comparisons"]
    gaps = {"delta_pix": "Δ<sub>pix</sub>", "delta_sem": "Δ<sub>sem</sub>"}
    lines = []
    for name, symbol in gaps.items():
        closed, ratio = found.get(f"{name}_closed"), found.get(f"{name}_ratio")
        if closed is not None:
            lines.append(f"Of the gap {symbol} between base and oracle, fine-tuning closes {_estimate(closed, True)}.")
        else:
            lines.append(f"The base’s {symbol} is no larger than the oracle’s: there is no gap to close.")
        if ratio is not None:
            lines.append(f"{symbol} of the base is {_estimate(ratio, False)} times that of the fine-tuned planner.")
    for other, words in (("no_change", "no change"), ("base", "no fine-tuning")):
        gain = found.get(f"judge_score_over_{other}")
        if gain is not None:
            lines.append(f"The judge scores the fine-tuned planner’s drawings {_estimate(gain, False)} above {words}.")
    kept = metrics.get("vae_ink_recall", {}).get("fine_tuned")
    if kept is not None:
        lines.append(f"The autoencoder alone keeps {percent(kept)} of the ink.")
    return "<ul>" + "".join(f"<li>{line}</li>" for line in lines) + "</ul>"


def _estimate(value: Mapping[str, float], share: bool) -> str:
    middle, low, high = (_number(value[name], share) for name in ("value", "low", "high"))
    return f"{middle} ({low}&nbsp;… {high})"


def _turns(turns: Mapping[str, Sequence[Mapping[str, float | None]]]) -> str:
    lines = [
        (
            f"turn {number}, {_METHODS[method]}",
            *(
                "–" if turn[name] is None else _number(float(turn[name] or 0), name in _SHARES)
                for name in (
                    "judge_score_no_change", "judge_score", "goal_keeps", "drawing_keeps", "changed", "strokes",
                )
            ),
        )
        for method, played in turns.items()
        for number, turn in enumerate(played, 1)
    ]  # fmt: skip
    head = ("turn", "judge score before", "after", "ink kept by the goal", "by the drawing", "changed", "strokes")
    return table(head, lines, "The judge’s score for the prompt of the turn, before the robot’s strokes and after.")


def _correlations(found: Mapping[str, Mapping[str, float]]) -> str:
    """Whether drawings that lose more of a scene fit its words less (thesis 6.8.2)."""
    if not found:
        return ""
    symbols = {"delta_pix": "Δ<sub>pix</sub>", "delta_sem": "Δ<sub>sem</sub>"}
    words = [
        f"{symbols[name]} and CLIPScore: r = {_number(value['r'], False)}, p = {value['p']:.1g}".replace("e-", "e−")
        for name, value in found.items()
    ]
    paintings = max(int(value["paintings"]) for value in found.values())
    return (
        f"<p>Between scenes and the robot’s full paintings of them ({count(paintings, 'painting')}): "
        f"{'; '.join(words)} (the thesis: −.08, not significant, and −.48).</p>"
    )
