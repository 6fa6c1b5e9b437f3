"""The report's section on sculpting: what was learned of a material, and what was sculpted in it."""

from __future__ import annotations

import json
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

from pentimento.contracts.errors import ContractError
from pentimento.report.figures import BLUE, OCHRE, Series, line_chart
from pentimento.report.html import Album, bar, row, table
from pentimento.report.wording import decimal, lowered, percent

_SHOWN = {
    "before": ("Before", "the clay as it was found"),
    "goal": ("Goal", "what was asked for, fitted to the material at hand"),
    "plan": ("Plan", "what the model foretells of all actions, planned at once without looking"),
    "result": ("Result", "what the robot made, looking and replanning every few actions"),
}


@dataclass(frozen=True, eq=False)
class SculptureInputs:
    """What was sculpted in one material."""

    material: str
    goals: dict[str, dict[str, Any]]
    """metrics.json of the stage sculpt: by goal, in the order in which they were sculpted."""
    pictures: dict[str, dict[str, bytes]]
    """PNG by goal and by what it shows."""
    time_lapse: bytes
    """GIF."""
    model: dict[str, Any]
    """metrics.json of the push model."""
    held_out: bytes
    """PNG: held-out pushes as measured and as foretold."""
    verdict: str
    """The gap finder's, on what an analytic model gets wrong about the material: one sentence."""


def read_sculpture(material: str, folder: Path, weights: Path, gap: Path) -> SculptureInputs:
    """Read what the stage sculpt wrote, the scores of the push model of the material, and its diagnosis.

    Raises:
        ContractError: metrics or a picture are missing.
    """
    try:
        goals = json.loads((folder / "metrics.json").read_text(encoding="utf-8"))
        ordered = {name: goals[name] for name in sorted(goals, key=lambda name: int(name.partition("_")[0]))}
        pictures = {name: {part: (folder / name / f"{part}.png").read_bytes() for part in _SHOWN} for name in ordered}
        lapse = (folder / "time_lapse.gif").read_bytes()
        model = json.loads((weights / "metrics.json").read_text(encoding="utf-8"))
        held_out = (weights / "held_out.png").read_bytes()
        verdict = str(json.loads((gap / "verdict.json").read_text(encoding="utf-8"))["sentence"])
    except (OSError, ValueError, AttributeError, KeyError, TypeError) as error:
        raise ContractError(
            f"{folder}, {weights} and {gap} hold no sculpture with its push model and diagnosis ({error}); run the "
            "stages train_push_dynamics, diagnose_pushes and sculpt."
        ) from error
    return SculptureInputs(material, ordered, pictures, lapse, model, held_out, verdict)


def sculpting_section(inputs: SculptureInputs, album: Album) -> str:
    """HTML of the section; its pictures go into the album."""
    material = escape(inputs.material)
    last = list(inputs.goals)[-1]
    lapse = album.photo(
        f"{inputs.material}_sculpting.gif",
        inputs.time_lapse,
        f"Time-lapse of the {inputs.material}, photographed from its scans.",
        "The clay before every plan, as its scan shows it: one goal after another, never smoothed in between.",
        still=inputs.pictures[last]["result"],
    )
    return f"""<section id="sculpting-{material}">
<h2>Sculpting in {material}</h2>
<p>The robot pressed into the {material} by design, scanned it before and after each push, and learned from that what
a push does to whatever relief it meets. With what it learned it plans pushes towards a goal, in height and in slope:
slopes are what light makes visible.</p>
{_learned(inputs, album)}
{lapse}
{"".join(_of_goal(name, inputs, album) for name in inputs.goals)}
{_results(inputs)}
{_curves(inputs, album)}
</section>"""


def _learned(inputs: SculptureInputs, album: Album) -> str:
    held_out = inputs.model["held_out"]
    lines = [
        ("the model", held_out["model"]),
        ("the mean footprint of all pushes", held_out["mean_footprint"]),
        ("no change at all", held_out["unchanged"]),
    ]
    if "floor" in inputs.model:
        lines.append(("the repeatability floor", inputs.model["floor"]))
    rows = [[name, decimal(scores["l_3d_mm2"]), decimal(scores["l_viz"])] for name, scores in lines]
    over = inputs.model.get("held_out_repeats", {}).get("over_floor")
    floor = (
        f" On repeated pushes among them, which no model can foretell better than they repeat, the model’s error is "
        f"{decimal(over['l_3d_mm2'])} times the floor."
        if over
        else ""
    )
    caption = (
        "Pushes that the model has not seen, in the square around each: mean squared error in height (mm²) and slope."
        + floor
    )
    shown = album.photo(
        f"{inputs.material}_pushes.png",
        inputs.held_out,
        f"Held-out pushes into the {inputs.material}: before, after, foretold, and the difference.",
        "Pushes that the model has not seen: before, after as measured, after as foretold, and the difference.",
    )
    verdict = (
        f"<p>What a plain model of the tool’s way through the {escape(inputs.material)} gets wrong: "
        f"{escape(inputs.verdict)} The whole diagnosis is <code>report.html</code> in "
        f"<code>data/gap/push_{escape(inputs.material)}</code>.</p>"
    )
    return shown + table(("what foretells", "height, mm²", "slope"), rows, caption) + verdict


def _of_goal(name: str, inputs: SculptureInputs, album: Album) -> str:
    told, title = inputs.goals[name], _title(inputs.goals[name])
    figures = [
        album.photo(
            f"{inputs.material}_{name}_{part}.png", inputs.pictures[name][part], f"{head} ({title}).",
            f"<b>{head}</b>: {meaning}.",
        )
        for part, (head, meaning) in _SHOWN.items()
    ]  # fmt: skip
    return f"<h3>{escape(title)}</h3><p>{_sentence(told)}</p>{row(figures[:2])}{row(figures[2:])}"


def _title(told: dict[str, Any]) -> str:
    kind, _, name = told["source"].partition(":")
    return f"The {kind} {name}" if name and kind in ("letter", "shape") else Path(told["source"]).name


def _sentence(told: dict[str, Any]) -> str:
    height, slope = told["error_3d_mm2"]["removed"], told["visual_error"]["removed"]
    read = told.get("read")
    reader = ""
    if read is not None:
        says = "reads it right" if read["right"] else f"takes it for {read['clay']}"
        reader = f" A reader trained on rendered letters only {says}."
    return (
        f"{_pushes(told['actions'])} {lowered('the error in height', height)} and "
        f"{lowered('that in slope', slope)}; it ended because {told['stopped']}.{reader}"
    )


def _pushes(number: int) -> str:
    return f"{number} push" + ("" if number == 1 else "es")


def _results(inputs: SculptureInputs) -> str:
    rows = []
    for told in inputs.goals.values():
        height, slope = told["error_3d_mm2"], told["visual_error"]
        rows.append(
            [
                escape(_title(told)),
                decimal(height["before"]),
                decimal(height["planned"]),
                decimal(height["after"]),
                f"{percent(height['removed'])}{bar(max(height['removed'], 0.0))}",
                percent(slope["removed"]),
                str(told["actions"]),
            ]
        )
    caption = (
        "Error in height against the goal over the whole area, mm²: if nothing is done, as a plan without looking "
        "foretold it, and as it came; and the shares removed of the errors in height and in slope."
    )
    return table(("goal", "nothing done", "predicted", "made", "removed", "of slope", "pushes"), rows, caption)


def _curves(inputs: SculptureInputs, album: Album) -> str:
    series = []
    made = 0
    for told in inputs.goals.values():
        for name, label, colour in (("error_3d_mm2", "height", BLUE), ("visual_error", "slope", OCHRE)):
            values = told["curve"][name]
            top = values[0] if values[0] > 0 else 1.0
            first = made == 0
            actions = [float(made + number) for number in range(len(values))]
            series.append(Series(label if first else "", actions, [value / top for value in values], colour))
        made += told["actions"]
    return album.plot(
        f"{inputs.material}_sculpting_curve.png",
        line_chart(series, "pushes made", "share of the error at its start", (11, 3)),
        f"Error against each goal over {made} pushes, in height and in slope.",
        "Error against the goal of the time, over the pushes made, as measured by scans: each goal begins at 1.",
    )
