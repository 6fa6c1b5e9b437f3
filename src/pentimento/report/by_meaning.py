"""The report's section on paintings by meaning: each sum of objectives beside its terms alone."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from markupsafe import Markup

from pentimento.report.files import incomplete, read_bytes, read_json
from pentimento.report.html import Album
from pentimento.report.templates import render
from pentimento.report.wording import decimal, tool_name

_SUM = "sum"
_TERMS = ("print", "semantic", "text", "style")
_TITLES = {_SUM: "all objectives"} | {term: f"{term} alone" for term in _TERMS}


@dataclass(frozen=True, eq=False)
class MeaningInputs:
    """The output of the stage paint_by_meaning for one setting."""

    name: str
    setting: dict[str, Any]
    """setting.json."""
    metrics: dict[str, Any]
    """By objective."""
    target: bytes
    """PNG, as all pictures."""
    painted: dict[str, bytes]
    """By objective, the sum first."""


def read_meanings(folder: Path) -> list[MeaningInputs]:
    """Read the stage's folder.

    Raises:
        ContractError: metrics or a picture are missing.
    """
    metrics = read_json(folder / "metrics.json")
    try:
        return [
            MeaningInputs(
                name=name,
                setting=read_json(folder / name / "setting.json"),
                metrics=of_setting,
                target=read_bytes(folder / name / "target.png"),
                painted={
                    kind: read_bytes(folder / name / f"{kind}_painted.png")
                    for kind in sorted(of_setting, key=lambda kind: (kind != _SUM, kind))
                },
            )
            for name, of_setting in metrics.items()
        ]
    except (AttributeError, KeyError, TypeError) as error:
        raise incomplete(folder, error, "paint_by_meaning") from error


def meanings_section(inputs: list[MeaningInputs], album: Album) -> Markup:
    """HTML of the section; its pictures go into the album."""
    settings = [(one, _head(one), _caption(one), _rows(one)) for one in inputs]
    return render("report/by_meaning.html", album=album, settings=settings, titles=_TITLES)


def _caption(one: MeaningInputs) -> str:
    """The setting in a sentence."""
    setting = one.setting
    weights = ", ".join(f"{name} {weight:g}" for name, weight in setting["weights"].items())
    style = f" in the style of “{setting['style']}”" if setting["style"] else ""
    what = f"“{setting['words']}”{style}" if setting["words"] else f"the photograph “{setting['picture']}”{style}"
    return f"{what}, {setting['strokes']} strokes of the {tool_name(setting['tool'])}; weights: {weights}"


def _terms(one: MeaningInputs) -> list[str]:
    return [term for term in _TERMS if term in one.metrics[_SUM]["objectives"]]


def _head(one: MeaningInputs) -> list[str]:
    ranked = ["rank of the words"] if one.setting["words"] else []
    return ["planned by", *(f"{term} objective" for term in _terms(one)), "similarity, painted", *ranked]


def _rows(one: MeaningInputs) -> list[list[str]]:
    rows = []
    for kind in one.painted:
        found = one.metrics[kind]
        values = [decimal(found["objectives"][term]) for term in _terms(one)]
        rank = [str(found["painted"]["rank_of_words"])] if one.setting["words"] else []
        rows.append([_TITLES[kind], *values, decimal(found["painted"]["similarity"]), *rank])
    return rows
