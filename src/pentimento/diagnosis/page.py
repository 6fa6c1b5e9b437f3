"""The report of a diagnosis as one page, from templates that strokes and pushes share."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from pentimento.diagnosis import figures
from pentimento.diagnosis.experiment_design import ALIASED, aliasing_sentences
from pentimento.diagnosis.figures import Screening
from pentimento.diagnosis.score import Evidence
from pentimento.diagnosis.verdict import DiagnosisResult, Finding, Kind
from pentimento.report.templates import render
from pentimento.report.wording import decimal, percent


class CauseRow(NamedTuple):
    """One cause of the vocabulary in the table of causes; numbers as text."""

    name: str
    verdict: str
    gain: str = ""
    share: float = 0.0
    """The gain as a number, for its bar."""
    interval: str = ""
    p: str = ""
    quantities: Sequence[str] = ()
    """Each with its standard error."""
    reason: str = ""
    """Why these rows cannot show the cause."""
    rivals: Sequence[str] = ()
    aliased: Sequence[str] = ()
    """Aliased causes with their canonical correlation."""
    detectable: str = ""

    @property
    def named(self) -> bool:
        """Whether it is established or suspected."""
        return self.verdict in ("established", "suspected")


def render_report(
    template_name: str,
    diagnosis: DiagnosisResult,
    screening: Screening[Any, Any],
    *,
    verdict: Mapping[str, Any],
    kind: Kind,
    drawn: Mapping[str, bytes],
    pairs: Mapping[tuple[str, str], tuple[float, float]],
    **values: Any,
) -> dict[str, bytes]:
    """``report.html``, which holds every figure, and the figures as ``figures/<name>.png``.

    Equal inputs give equal bytes.

    Args:
        template_name: extends ``diagnosis.html``.
        diagnosis: the result.
        screening: what is drawn.
        verdict: content of ``verdict.json``.
        kind: of the rows.
        drawn: figures of the rows' own kind, PNG by file name.
        pairs: aliasing of pairs of causes now, and with the proposed actions.
        values: further variables of the template.
    """
    files = shared_figures(diagnosis, screening, kind, verdict["mse"].get("given")) | dict(drawn)
    page = render(
        template_name,
        lead=lead(diagnosis),
        verdict=verdict,
        rows=kind.name,
        unit=kind.unit,
        causes=cause_rows(diagnosis, screening),
        figures=files,
        aliased=aliasing_sentences(screening.aliasing),
        aliased_above=ALIASED,
        pairs=[(f"{a} and {b}", f"{now:.2f}", f"{then:.2f}") for (a, b), (now, then) in pairs.items()],
        **values,
    )
    return {f"figures/{name}": data for name, data in files.items()} | {"report.html": page.encode("utf-8")}


def shared_figures(
    diagnosis: DiagnosisResult, screening: Screening[Any, Any], kind: Kind, given_mse: float | None
) -> dict[str, bytes]:
    """The figures that strokes and pushes share, PNG by file name."""
    named = [finding.cause for finding in (*diagnosis.established, *diagnosis.suspected)]
    files = {
        "leave_one_out.png": figures.leave_one_out(diagnosis, given_mse, kind),
        "aliasing.png": figures.aliasing_heat(screening.aliasing, named),
    }
    if screening.covariates:
        structured = {(left.mode, left.covariate) for left in diagnosis.unexplained}
        files["modes.png"] = figures.mode_heat(screening, structured)
        files["dependence.png"] = figures.dependence(screening)
    if diagnosis.drifts is not None:
        files["temporal_drift.png"] = figures.drift_curve(diagnosis.drifts)
    return files


def lead(diagnosis: DiagnosisResult) -> str:
    """The result in a few words."""
    if diagnosis.established:
        return ", ".join(finding.cause for finding in diagnosis.established).replace("_", " ").capitalize() + "."
    if diagnosis.unexplained:
        left = diagnosis.unexplained[0]
        return f"An effect that no known cause explains: {left.mode} depends on {left.covariate}."
    if diagnosis.drifts:
        return f"An effect that nobody recorded: {diagnosis.drifts.mode} drifts from one action to the next."
    return "No known cause is established."


def cause_rows(diagnosis: DiagnosisResult, screening: Screening[Any, Any]) -> list[CauseRow]:
    """Established and suspected causes, then all others by p, then those that these rows cannot show."""
    rows = [_of_finding(f, "established", screening) for f in diagnosis.established]
    rows += [_of_finding(f, "suspected", screening) for f in diagnosis.suspected]
    named = {row.name for row in rows} | {"uneven_ends"}  # which belong to the base
    last = diagnosis.search.steps[-1].evidence if diagnosis.search.steps else {}
    others = sorted((e.p_adjusted, e.p, cause) for cause, e in last.items() if cause not in named)
    rows += [_of_evidence(cause, last[cause], screening) for _, _, cause in others]
    return rows + [
        CauseRow(cause, "not observable", reason=reason) for cause, reason in diagnosis.search.not_observable.items()
    ]


def _of_finding(finding: Finding, verdict: str, screening: Screening[Any, Any]) -> CauseRow:
    return CauseRow(
        finding.cause,
        verdict,
        gain=_share(finding.gain),
        share=finding.gain,
        interval=_between(finding.gain_interval),
        p=_number(finding.p_adjusted),
        quantities=[
            f"{name} {_number(value)}\u00a0±\u00a0{_number(error, 1)}"
            for name, (value, error) in finding.values.items()
        ],
        rivals=finding.rivals,
        aliased=_aliased(finding.cause, screening),
        detectable=_detectable(finding.cause, screening),
    )


def _of_evidence(cause: str, evidence: Evidence, screening: Screening[Any, Any]) -> CauseRow:
    return CauseRow(
        cause,
        "",
        gain=_share(evidence.gain),
        interval=_between(evidence.gain_interval),
        p=_number(evidence.p_adjusted),
        aliased=_aliased(cause, screening),
        detectable=_detectable(cause, screening),
    )


def _aliased(cause: str, screening: Screening[Any, Any]) -> list[str]:
    found = screening.aliasing
    if cause not in found.causes:
        return []
    values = {other: found.of(cause, other) for other in found.causes if other != cause}
    return [f"{other}\u00a0{value:.2f}" for other, value in values.items() if value > ALIASED]


def _detectable(cause: str, screening: Screening[Any, Any]) -> str:
    smallest = screening.detectable.get(cause, np.inf)
    return percent(smallest) if smallest < 1 else "no effect"


def _share(value: float) -> str:
    """A percentage with a true minus sign, and without one before 0."""
    number, unit = percent(value).split()
    return f"{number.replace('-', '' if float(number) == 0 else '−')}\u00a0{unit}"


def _between(interval: tuple[float, float]) -> str:
    low, high = (_share(value) for value in interval)
    return f"{low.removesuffix(chr(160) + '%')}\u00a0…\u00a0{high}"


def _number(value: float, digits: int = 3) -> str:
    """With a true minus sign, at which no line breaks."""
    plain = decimal(value, digits) if 1e-4 <= abs(value) < 1e4 or value == 0 else f"{value:.{digits - 1}e}"
    return plain.replace("-", "−")
