"""The diagnosis as one page that needs no other file, and its figures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from importlib.resources import files
from typing import Any

from pentimento.diagnosis.leaderboard import leaderboard
from pentimento.diagnosis.result import Judged
from pentimento.diagnosis.strokes import figures
from pentimento.diagnosis.strokes.aliasing import ALIKE, sentences
from pentimento.diagnosis.strokes.diagnose import Diagnosis
from pentimento.diagnosis.strokes.maps import canvas_map, places_known, stroke_map
from pentimento.diagnosis.strokes.next_actions import Proposal
from pentimento.diagnosis.strokes.screening import Survey
from pentimento.diagnosis.strokes.user_baseline import Given
from pentimento.report.html import Album, table
from pentimento.report.wording import count, decimal


def build_page(
    diagnosis: Diagnosis,
    survey: Survey,
    proposal: Proposal,
    verdict: Mapping[str, Any],
    given: Given | None = None,
) -> dict[str, bytes]:
    """``report.html``, which holds every picture, and the pictures as ``figures/<name>.png``.

    Equal inputs give equal bytes.

    Args:
        diagnosis: what was found.
        survey: what is drawn.
        proposal: the next strokes.
        verdict: as ``verdict.json``.
        given: a stroke model to be shown beside the finder's own base.
    """
    album = Album()
    sections = [
        _summary(diagnosis, verdict, given, album),
        section("causes", "Every cause, and what the strokes say of it", leaderboard(diagnosis, survey)),
        _strokes(diagnosis, survey, given, album),
        _residuals(survey, album),
        _modes(diagnosis, survey, album),
        _aliasing(diagnosis, survey, album),
        _next(proposal, survey, album),
    ]
    pictures = {f"figures/{name}": data for name, data in album.files.items()}
    return pictures | {"report.html": html_page(lead(diagnosis), sections)}


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


def lead(diagnosis: Judged) -> str:
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


def _summary(diagnosis: Diagnosis, verdict: Mapping[str, Any], given: Given | None, album: Album) -> str:
    fall = album.plot(
        "leave_one_out.png", figures.leave_one_out(diagnosis, given and given.mse),
        "Bars from the base model's error by that without each cause to the extended model's, and to the noise floor.",
        "Mean squared error over the windows of sealed strokes, sRGB. "
        + ("<b>Given model</b>: the one that was named. " if given else "")
        + "<b>Base</b>: the thesis's stroke model with free "
        "nuisances. Green: how much more is missed without one of the causes, all others fitted again. "
        "<b>Extended</b>: what is left with all of them. Hatched: what a smooth law of a mode that still has structure "
        "would remove, to second order. <b>Noise floor</b>: what even a perfect model would miss, from repeated "
        "actions; the band is its 95&nbsp;% interval.",
    )  # fmt: skip
    splits = diagnosis.splits
    used = (
        f"{count(verdict['rows'], 'row')}, {count(verdict['actions'], 'action')}: {len(splits.discovery)} rows "
        f"searched, {len(splits.confirmation)} confirmed, {len(splits.test)} were sealed until the end."
    )
    return section("verdict", "Verdict", f"<p>{escape(verdict['sentence'])}</p><p>{used}</p>{fall}")


def _strokes(diagnosis: Diagnosis, survey: Survey, given: Given | None, album: Album) -> str:
    sheet = album.plot(
        "strokes.png", figures.strokes(diagnosis, survey),
        "Sealed strokes: photographs before and after, what base and extended model foretell, and their errors.",
        "Sealed strokes, from the one that the extension helps most to the one that it helps least (or harms). "
        "<b>Before</b>, denoised, with the command in ochre from its dot; <b>after</b>: the photograph; <b>base</b>, "
        "<b>extended</b>: what the models say it will be; <b>|error|</b>: root mean squared over the colours.",
    )  # fmt: skip
    if given:
        sheet += album.plot(
            "given_strokes.png", figures.given_strokes(given, diagnosis, survey),
            "Sealed strokes as a given model and the extended model foretell them, and their errors.",
            "The same with the <b>given model</b> in the base's place: where it misses and the base above does not, it "
            "needs no cause, only better calibration.",
        )  # fmt: skip
    return section("strokes", "Strokes before, after, and as foretold", sheet)


def _residuals(survey: Survey, album: Album) -> str:
    measured = survey.measured
    along = album.plot(
        "residual_stroke.png",
        figures.residual_maps(
            stroke_map(survey.base_residual, measured), stroke_map(survey.extended_residual, measured),
            "share of the length", "mm to the left", square=False,
        ),
        "Maps of mean and worst residual along straightened strokes.",
        "All strokes laid over one another, straightened: the start at 0, the end at 1. Red: brighter than foretold, "
        "blue: darker. <b>Mean</b> shows what is wrong every time, <b>worst</b> what is wrong at least once.",
    )  # fmt: skip
    if not places_known(measured):
        canvas = "<p>The strokes are recorded in their own frame: where they lay on the canvas is not known.</p>"
    else:
        canvas = album.plot(
            "residual_canvas.png",
            figures.residual_maps(
                canvas_map(survey.base_residual, measured), canvas_map(survey.extended_residual, measured),
                "x / mm", "y / mm", square=True,
            ),
            "Maps of mean and worst residual over the canvas.",
            "The same residuals where the strokes lay: camera, light and table show here.",
        )  # fmt: skip
    return section("residuals", "Where the models are wrong", along + canvas)


def _modes(diagnosis: Diagnosis, survey: Survey, album: Album) -> str:
    if not survey.covariates:
        return section(
            "modes", "What the residual depends on",
            "<p>Nothing that was recorded of every stroke varies: what the residual depends on cannot be asked.</p>"
            + temporal_drift(diagnosis, album),
        )  # fmt: skip
    structured = {(left.mode, left.covariate) for left in diagnosis.unexplained}
    heat = album.plot(
        "modes.png", figures.mode_heat(survey, structured),
        "Heat map of residual modes against covariates, for base and extended model.",
        "How strongly each way in which a mark can differ as a whole goes with each thing that was recorded: the root "
        "of the number of strokes times the correlation, linear or by the square, whichever is larger. Chance alone "
        "makes about 1, rarely 4. A frame marks what is significant among all pairs (permutations, p &lt; .01).",
    )  # fmt: skip
    curves = album.plot(
        "dependence.png", figures.dependence(survey),
        "Curves of residual modes against the covariates on which they depend most.",
        "The strongest of these pairs: means over bins with equally many strokes, in robust standard deviations, and "
        "95&nbsp;% bands that take each action as one witness. Ochre: base; blue: extended. Flat at 0 is a cause "
        "dealt with.",
    )  # fmt: skip
    return section("modes", "What the residual depends on", heat + curves + temporal_drift(diagnosis, album))


def temporal_drift(diagnosis: Judged, album: Album) -> str:
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


def _aliasing(diagnosis: Diagnosis, survey: Survey, album: Album) -> str:
    named = [finding.cause for finding in (*diagnosis.established, *diagnosis.suspected)]
    heat = album.plot(
        "aliasing.png", figures.aliasing_heat(survey.aliasing, named),
        "The imitation matrix of the causes.",
        "How well one cause can pass for another <i>in these strokes</i>, when the base may adapt: |cosine| of their "
        f"derivatives. Framed above {ALIKE}. This is a property of how the strokes were chosen, and random place, "
        "heading, speed and dips lower it.",
    )  # fmt: skip
    said = "".join(f"<li>{escape(line)}</li>" for line in sentences(survey.aliasing))
    alike = f"<ul>{said}</ul>" if said else "<p>No two causes imitate each other.</p>"
    return section("aliasing", "What these strokes cannot tell apart", alike + heat)


def _next(proposal: Proposal, survey: Survey, album: Album) -> str:
    title = "The next experiments"
    if not proposal.actions:
        return section("next", title, "<p>There is no pair of causes to tell apart and nothing to measure better.</p>")
    lines = album.plot(
        "next_actions.png", figures.proposal_lines(proposal, survey),
        "The proposed strokes on the canvas, numbered in their order.",
        f"<b>{count(len(proposal.actions), 'stroke')}</b> that say most about the open questions, over the recorded "
        "ones (grey). Dashed: dip first. They are in <code>next_actions.parquet</code>.",
    )  # fmt: skip
    rows = [
        (escape(f"{first} and {second}"), f"{before:.2f}", f"{after:.2f}")
        for (first, second), (before, after) in proposal.aliasing.items()
    ]
    alike = (
        table(("pair", "imitation now", "with these strokes"), rows, "What they are foretold to do.") if rows else ""
    )
    times = [
        (str(number), "yes" if action.reload else "", decimal(action.wait_s), escape(" | ".join(question)))
        for number, (action, question) in enumerate(zip(proposal.actions, proposal.question, strict=True), 1)
    ]
    list_of = table(("stroke", "dip first", "wait, s", "says most about"), times, "In the order of execution.", 9)
    return section("next", title, lines + alike + list_of)


def section(name: str, title: str, content: str) -> str:
    """A section of HTML."""
    return f'<section id="{name}"><h2>{title}</h2>{content}</section>'
