"""The report's section on what the stroke models got wrong: the verdict of each tool's diagnosis and its figures."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

from pentimento.contracts.errors import ContractError
from pentimento.report.html import Album, bar, table
from pentimento.report.wording import count, decimal, percent, tool_name

_FIGURES = {
    "leave_one_out": (
        "Bars from the base model's error by that without each cause to the extended model's, and to the noise floor "
        "({tool}).",
        "From the base model's error on sealed strokes to that of the extended model, how much more is missed without "
        "one of its causes, and the noise floor, which even a perfect model would not pass.",
    ),
    "strokes": (
        "Sealed strokes of the {tool}: photographs, what both models foretell, and their errors.",
        "Sealed strokes: photographs before and after, what both models say, and how far each is off.",
    ),
    "residual_stroke": (
        "Maps of mean and worst residual along straightened strokes of the {tool}.",
        "All strokes laid over one another and straightened: what was measured less what was foretold, on average and "
        "at worst.",
    ),
    "modes": (
        "Heat map of residual modes against covariates for the {tool}.",
        "How strongly the ways in which a mark can differ go with what was recorded, before the extension and after. "
        "A frame marks structure that no known cause explains.",
    ),
}


@dataclass(frozen=True, eq=False)
class DiagnosisInputs:
    """What the diagnosis of one tool's model found."""

    tool: str
    verdict: dict[str, Any]
    figures: dict[str, bytes]
    """PNG by name; those that the diagnosis could draw."""


def read_diagnosis(tool: str, folder: Path) -> DiagnosisInputs:
    """Read the folder that a diagnosis wrote: ``verdict.json`` and ``figures/``.

    Raises:
        ContractError: the verdict is missing, not JSON, or of another schema.
    """
    path = folder / "verdict.json"
    try:
        verdict = json.loads(path.read_text(encoding="utf-8"))
        if verdict["schema"] != 1:
            raise ValueError(f"schema {verdict['schema']}, not 1")
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ContractError(f"{path} is not a verdict ({error}); run the stage diagnose_gap again.") from error
    drawn = {name: folder / "figures" / f"{name}.png" for name in _FIGURES}
    return DiagnosisInputs(tool, verdict, {name: file.read_bytes() for name, file in drawn.items() if file.exists()})


def diagnoses_section(diagnoses: Sequence[DiagnosisInputs], album: Album) -> str:
    """HTML of the section; its pictures go into the album."""
    return f"""<section id="gap">
<h2>What the models got wrong, and why</h2>
<p>Before anything is planned, each stroke model is asked what it gets wrong beyond noise, what that depends on, and
which of a vocabulary of physical causes explains it. A cause is <b>established</b> when strokes that had no part in the
search confirm it; then it becomes part of the model. The gain is measured on strokes that stayed sealed until the end.
All of it, with the strokes that should be made next, is in <code>report.html</code> in the tool’s folder of
<code>data/gap</code>.</p>
{"".join(_of_tool(inputs, album) for inputs in diagnoses)}
</section>"""


def _of_tool(inputs: DiagnosisInputs, album: Album) -> str:
    tool = tool_name(inputs.tool)
    pictures = "".join(
        album.plot(f"gap_{inputs.tool}_{name}.png", inputs.figures[name], alt.format(tool=tool), caption)
        for name, (alt, caption) in _FIGURES.items()
        if name in inputs.figures
    )
    return f"""<h3>The {escape(tool)}</h3>
<p>{escape(inputs.verdict["sentence"])}</p>
{_causes(inputs.verdict)}
{pictures}"""


def _causes(verdict: dict[str, Any]) -> str:
    rows = [
        (
            escape(entry["cause"]), how, f"{percent(entry['gain'])}{bar(entry['gain'])}",
            "&nbsp;… ".join(percent(bound) for bound in entry["gain_ci"]),
            "<br>".join(f"{escape(name)} {_value(q)}" for name, q in entry["parameters"].items()),
            escape(", ".join(entry["rivals"])) or "none",
        )
        for how in ("established", "suspected")
        for entry in verdict[how]
    ]  # fmt: skip
    if not rows:
        return ""
    mse, closed = verdict["mse"], verdict["gap_closed"]["test"]
    floor = "" if mse["floor"] is None else f", the noise floor is {decimal(mse['floor'])}"
    share = "" if closed is None else f"; {percent(closed)} of the gap above the floor is closed"
    caption = (
        f"Of {count(verdict['actions'], 'action')}. Mean squared error on sealed strokes: {decimal(mse['base'])} for "
        f"the base, {decimal(mse['extended'])} for the extended model{floor}{share}. <b>Gain</b>: the share of the "
        f"{'error' if mse['floor'] is None else 'gap'} that the cause removes. A <b>rival</b> would do as well."
    )
    return table(("cause", "verdict", "gain", "95 %", "quantities", "rivals"), rows, caption, numbers_from=9)


def _value(quantity: dict[str, float]) -> str:
    return f"{quantity['value']:.3g} ± {quantity['se']:.1g}".replace("-", "−")
