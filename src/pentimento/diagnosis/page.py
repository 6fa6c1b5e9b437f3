"""The diagnosis as one page that needs no other file, and its figures."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from importlib.resources import files

import numpy as np

from pentimento.diagnosis import figures
from pentimento.diagnosis.experiment_design import ALIASED
from pentimento.diagnosis.figures import Surveyed
from pentimento.diagnosis.score import Evidence
from pentimento.diagnosis.strokes.model import UnevenEnds
from pentimento.diagnosis.verdict import DiagnosisResult, Finding
from pentimento.report.html import Album, bar, table
from pentimento.report.wording import decimal, percent

_HEAD = ("cause", "verdict", "held-out gain", "95 %", "p", "quantities", "rivals and imitators", "found from")


def html_page(said: str, sections: Sequence[str]) -> bytes:
    """The page from its sections, after a first sentence; all HTML."""
    style = (files("pentimento.report") / "templates/style.css").read_text(encoding="utf-8")
    page = f"""<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<title>Pentimento: what the simulation gets wrong</title>
<style>
{style}</style>
</head>
<body>
<header>
<h1>What the simulation gets wrong</h1>
<p class="lead">{said}</p>
</header>
<main>
{"".join(sections)}
</main>
</body>
</html>
"""
    return page.encode("utf-8")


def lead(diagnosis: DiagnosisResult) -> str:
    """What was found, in a few words of HTML."""
    if diagnosis.established:
        return (
            escape(", ".join(finding.cause for finding in diagnosis.established).replace("_", " ").capitalize()) + "."
        )
    if diagnosis.unexplained:
        left = diagnosis.unexplained[0]
        return f"Something that no known cause explains: {escape(left.mode)} depends on {escape(left.covariate)}."
    if diagnosis.drifts:
        return f"Something that nobody recorded: from one action to the next {escape(diagnosis.drifts.mode)} wanders."
    return "No known cause is established."


def temporal_drift(diagnosis: DiagnosisResult, album: Album) -> str:
    """What wanders, as a figure; nothing where nothing does."""
    if diagnosis.drifts is None:
        return ""
    return album.plot(
        "wandering.png", figures.drift_curve(diagnosis.drifts),
        f"Residual {diagnosis.drifts.mode} in the order of execution, row by row and as a running mean.",
        "What wanders: the residual of each row in this mode, in robust standard deviations, in the order in which "
        "the rows were made, and the mean of neighbours. Repeats differ by it, but it is no noise, and the noise floor "
        "is without it. Where no recorded column goes with it, record what drifts: the next diagnosis can name it.",
    )  # fmt: skip


def section(name: str, title: str, content: str) -> str:
    """A section of HTML."""
    return f'<section id="{name}"><h2>{title}</h2>{content}</section>'


def leaderboard(diagnosis: DiagnosisResult, survey: Surveyed) -> str:
    """HTML: established, suspected, then all others by p; last those that these rows cannot show."""
    rows = [_found(f, "established", survey) for f in diagnosis.established]
    rows += [_found(f, "suspected", survey) for f in diagnosis.suspected]
    named = {f.cause for f in (*diagnosis.established, *diagnosis.suspected)} | {UnevenEnds.cause}
    last = diagnosis.search.steps[-1].evidence if diagnosis.search.steps else {}
    others = sorted((e.p_adjusted, e.p, cause) for cause, e in last.items() if cause not in named)
    rows += [_other(cause, last[cause], survey) for _, _, cause in others]
    rows += [
        (escape(cause), "cannot be seen", "", "", "", "", escape(reason), "")
        for cause, reason in diagnosis.search.not_observable.items()
    ]
    of = "gap above the noise floor" if diagnosis.floor else "error (the noise floor is unknown)"
    caption = (
        f"<b>Gain</b>: of established and suspected causes the share of the {of} on sealed rows that the cause "
        "removes; of the others the share of the error on held-out rows of the search, at the extended model. "
        "<b>p</b> is adjusted for all causes tested together. <b>Quantities</b> with standard errors that take each "
        "action as one witness. In italics: what imitates the cause in these rows. <b>Found from</b>: the smallest "
        "share of the error that a cause must remove to be found in four of five such collections."
    )
    return table(_HEAD, rows, caption, numbers_from=9)


def _found(finding: Finding, verdict: str, survey: Surveyed) -> tuple[str, ...]:
    quantities = "<br>".join(
        f"{escape(name)} {_number(value)}&nbsp;±&nbsp;{_number(error, 1)}"
        for name, (value, error) in finding.values.items()
    )
    return (
        f"<b>{escape(finding.cause)}</b>", f"<b>{verdict}</b>", f"{_share(finding.gain)}{bar(finding.gain)}",
        _between(finding.gain_interval), _number(finding.p_adjusted), quantities,
        _alike(finding.cause, finding.rivals, survey), _power(finding.cause, survey),
    )  # fmt: skip


def _other(cause: str, evidence: Evidence, survey: Surveyed) -> tuple[str, ...]:
    return (
        escape(cause), "", _share(evidence.gain), _between(evidence.gain_interval), _number(evidence.p_adjusted), "",
        _alike(cause, (), survey), _power(cause, survey),
    )  # fmt: skip


def _alike(cause: str, rivals: tuple[str, ...], survey: Surveyed) -> str:
    said = [escape(rival) for rival in rivals]
    if cause in survey.aliasing.causes:
        said += [
            f"<i>{escape(other)}&nbsp;{survey.aliasing.of(cause, other):.2f}</i>"
            for other in survey.aliasing.causes
            if other != cause and survey.aliasing.of(cause, other) > ALIASED
        ]
    return ", ".join(said)


def _power(cause: str, survey: Surveyed) -> str:
    smallest = survey.detectable.get(cause, np.inf)
    return percent(smallest) if smallest < 1 else "nothing"


def _share(value: float) -> str:
    """A percentage with a true minus, and none before nothing."""
    number, unit = percent(value).split()
    return f"{number.replace('-', '' if float(number) == 0 else '−')}&nbsp;{unit}"


def _between(interval: tuple[float, float]) -> str:
    low, high = (_share(value) for value in interval)
    return f"{low.removesuffix('&nbsp;%')}&nbsp;…&nbsp;{high}"


def _number(value: float, digits: int = 3) -> str:
    """With a true minus, which no line breaks at."""
    plain = decimal(value, digits) if 1e-4 <= abs(value) < 1e4 or value == 0 else f"{value:.{digits - 1}e}"
    return plain.replace("-", "−")
