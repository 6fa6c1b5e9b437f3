"""The report of a diagnosis as one page, from templates that strokes and pushes share."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from pentimento.diagnosis import figures
from pentimento.diagnosis.diagnose import Finding, Result
from pentimento.diagnosis.experiment_design import ALIASED, aliasing_sentences
from pentimento.diagnosis.figures import Screening
from pentimento.diagnosis.problem import Cause, M
from pentimento.diagnosis.search import Test
from pentimento.diagnosis.verdict import size
from pentimento.report.templates import render
from pentimento.report.wording import decimal, percent


class CauseRow(NamedTuple):
    """One cause of the vocabulary in the table of causes; numbers as text."""

    name: str
    verdict: str
    probability: str = ""
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
    result: Result[M],
    screening: Screening[Any, Any],
    *,
    verdict: Mapping[str, Any],
    drawn: Mapping[str, bytes],
    pairs: Mapping[tuple[str, str], tuple[float, float]],
    **values: Any,
) -> dict[str, bytes]:
    """``report.html``, which holds every figure, and the figures as ``figures/<name>.png``.

    Equal inputs give equal bytes.

    Args:
        template_name: extends ``diagnosis.html``.
        result: of the diagnosis.
        screening: what is drawn.
        verdict: content of ``verdict.json``.
        drawn: figures of the rows' own kind, PNG by file name.
        pairs: aliasing of pairs of causes now, and with the proposed actions.
        values: further variables of the template.
    """
    files = shared_figures(result, screening, verdict["mse"].get("given")) | dict(drawn)
    page = render(
        template_name,
        lead=lead(result),
        verdict=verdict,
        rows=result.known.kind,
        unit=result.known.unit,
        causes=cause_rows(result, screening),
        figures=files,
        aliased=aliasing_sentences(screening.aliasing),
        aliased_above=ALIASED,
        pairs=[(f"{a} and {b}", f"{now:.2f}", f"{then:.2f}") for (a, b), (now, then) in pairs.items()],
        **values,
    )
    return {f"figures/{name}": data for name, data in files.items()} | {"report.html": page.encode("utf-8")}


def shared_figures(result: Result[M], screening: Screening[Any, Any], given_mse: float | None) -> dict[str, bytes]:
    """The figures that strokes and pushes share, PNG by file name."""
    named = [finding.cause for finding in (*result.established, *result.suspected)]
    files = {
        "leave_one_out.png": figures.leave_one_out(result, given_mse),
        "aliasing.png": figures.aliasing_heat(screening.aliasing, named),
    }
    if screening.covariates:
        structured = {(left.mode, left.covariate) for left in result.structure.unexplained}
        files["modes.png"] = figures.mode_heat(screening, structured)
        files["dependence.png"] = figures.dependence(screening)
    if result.drift is not None:
        files["temporal_drift.png"] = figures.drift_curve(result.drift)
    return files


def lead(result: Result[M]) -> str:
    """The result in a few words."""
    if result.established:
        return ", ".join(finding.cause for finding in result.established).replace("_", " ").capitalize() + "."
    if result.structure.unexplained:
        left = result.structure.unexplained[0]
        return f"An effect that no known cause explains: {left.mode} depends on {left.covariate}."
    if result.drift:
        return f"An effect that nobody recorded: {result.drift.mode} drifts from one action to the next."
    return "No known cause is established."


def cause_rows(result: Result[M], screening: Screening[Any, Any]) -> list[CauseRow]:
    """Established and suspected causes, then all others by p, then those that these rows cannot show."""
    causes = result.known.causes
    rows = [_of_finding(f, causes[f.cause], "established", screening) for f in result.established]
    rows += [_of_finding(f, causes[f.cause], "suspected", screening) for f in result.suspected]
    error = float(result.known.losses(result.decided.model).mean())
    for cause, test in sorted(result.others.items(), key=lambda item: item[1].p):
        rows.append(_of_test(cause, test, error, screening))
    return rows + [CauseRow(cause, "not observable", reason=why) for cause, why in result.known.unobservable.items()]


def _of_finding(finding: Finding, cause: Cause, verdict: str, screening: Screening[Any, Any]) -> CauseRow:
    return CauseRow(
        finding.cause,
        verdict,
        probability=f"{finding.probability:.2f}",
        gain=_share(finding.gain),
        share=finding.gain,
        interval=_between(finding.gain_interval),
        quantities=[size(q, *finding.values[q.name]).replace(" ", "\u00a0") for q in cause.quantities],
        rivals=finding.rivals,
        aliased=_aliased(finding.cause, screening),
        detectable=_detectable(finding.cause, screening),
    )


def _of_test(cause: str, test: Test, error: float, screening: Screening[Any, Any]) -> CauseRow:
    return CauseRow(
        cause,
        "",
        gain=_share(test.gain / error),
        p=_number(test.p),
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
