"""The diagnosis of pushes as one page that needs no other file, and its figures."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from typing import Any

from pentimento.diagnosis import figures as drawn
from pentimento.diagnosis.experiment_design import ALIASED, aliasing_sentences
from pentimento.diagnosis.page import html_page, lead, leaderboard, section, temporal_drift
from pentimento.diagnosis.pushes import figures
from pentimento.diagnosis.pushes.diagnose import PushDiagnosis
from pentimento.diagnosis.pushes.next_pushes import PushProposal
from pentimento.diagnosis.pushes.screening import PushSurvey
from pentimento.diagnosis.verdict import PUSHES
from pentimento.report.html import Album, table
from pentimento.report.wording import count


def build_page(
    diagnosis: PushDiagnosis, survey: PushSurvey, proposal: PushProposal, verdict: Mapping[str, Any]
) -> dict[str, bytes]:
    """``report.html``, which holds every picture, and the pictures as ``figures/<name>.png``.

    Equal inputs give equal bytes.
    """
    album = Album()
    sections = [
        _summary(diagnosis, verdict, album),
        section("causes", "Every cause, and what the pushes say of it", leaderboard(diagnosis, survey)),
        _pushes(diagnosis, survey, album),
        _modes(diagnosis, survey, album),
        _aliasing(diagnosis, survey, album),
        _next(proposal, survey, album),
    ]
    pictures = {f"figures/{name}": data for name, data in album.files.items()}
    return pictures | {"report.html": html_page(lead(diagnosis), sections)}


def _summary(diagnosis: PushDiagnosis, verdict: Mapping[str, Any], album: Album) -> str:
    fall = album.plot(
        "leave_one_out.png", drawn.leave_one_out(diagnosis, kind=PUSHES),
        "Bars from the base model's error by that without each cause to the extended model's, and to the noise floor.",
        "Mean squared error over the windows of sealed pushes, mm². <b>Base</b>: the swept tool with free nuisances "
        "(profile, depth gain, give, rims, heap, blur), and what was learnt of what it does alike in every push. "
        "Green: how much more is missed without one of the causes, all others fitted again. "
        "<b>Extended</b>: what is left with all of them. Hatched: what a smooth law of a mode that still has structure "
        "would remove, to second order. <b>Noise floor</b>: what even a perfect model would miss, from repeated "
        "actions; the band is its 95&nbsp;% interval.",
    )  # fmt: skip
    parts = diagnosis.parts
    used = (
        f"{count(verdict['rows'], 'row')}, {count(verdict['actions'], 'action')}: {len(parts.discovery_split)} rows "
        f"were searched, {len(parts.test_split)} sealed until the end: they confirm and value what was found."
    )
    return section("verdict", "Verdict", f"<p>{escape(verdict['sentence'])}</p><p>{used}</p>{fall}")


def _pushes(diagnosis: PushDiagnosis, survey: PushSurvey, album: Album) -> str:
    sheet = album.plot(
        "pushes.png", figures.pushes(diagnosis, survey),
        "Sealed pushes: shaded scans before and after, what base and extended model foretell, and their errors.",
        "Sealed pushes in light from the upper left, from the one that the extension helps most to the one that it "
        "helps least (or harms). <b>Before</b>, denoised, with the command in ochre from its dot; <b>after</b>: the "
        "scan; <b>base</b>, <b>extended</b>: what the models say it will be.",
    )  # fmt: skip
    along = album.plot(
        "residual_push.png",
        drawn.residual_maps(
            figures.push_map(survey.base_residual, survey.measured),
            figures.push_map(survey.extended_residual, survey.measured),
            "mm along the travel from the start", "mm to the left", square=True, unit="mm",
        ),
        "Maps of mean and worst residual in the frame of the push.",
        "All pushes laid over one another in their own frame. Red: higher than foretold, blue: lower. <b>Mean</b> "
        "shows what is wrong every time, <b>worst</b> what is wrong at least once.",
    )  # fmt: skip
    return section("pushes", "Pushes before, after, and as foretold", sheet + along)


def _modes(diagnosis: PushDiagnosis, survey: PushSurvey, album: Album) -> str:
    structured = {(left.mode, left.covariate) for left in diagnosis.unexplained}
    heat = album.plot(
        "modes.png", drawn.mode_heat(survey, structured),
        "Heat map of residual modes against covariates, for base and extended model.",
        "How strongly each way in which a push can differ as a whole goes with each thing that was recorded, or that "
        "follows from its command and the surface below: the root of the number of pushes times the correlation, "
        "linear or by the square. Chance alone makes about 1, rarely 4. A frame marks what is significant among all "
        "pairs (permutations, p &lt; .01).",
    )  # fmt: skip
    curves = album.plot(
        "dependence.png", drawn.dependence(survey),
        "Curves of residual modes against the covariates on which they depend most.",
        "The strongest of these pairs: means over bins with equally many pushes, in robust standard deviations, and "
        "95&nbsp;% bands that take each action as one witness. Ochre: base; blue: extended.",
    )  # fmt: skip
    return section("modes", "What the residual depends on", heat + curves + temporal_drift(diagnosis, album))


def _aliasing(diagnosis: PushDiagnosis, survey: PushSurvey, album: Album) -> str:
    named = [finding.cause for finding in (*diagnosis.established, *diagnosis.suspected)]
    heat = album.plot(
        "aliasing.png", drawn.aliasing_heat(survey.aliasing, named),
        "The imitation matrix of the causes.",
        "How well one cause can pass for another <i>in these pushes</i>, when the base may adapt: |cosine| of their "
        f"derivatives. Framed above {ALIASED}.",
    )  # fmt: skip
    said = "".join(f"<li>{escape(line)}</li>" for line in aliasing_sentences(survey.aliasing))
    alike = f"<ul>{said}</ul>" if said else "<p>No two causes imitate each other.</p>"
    return section("aliasing", "What these pushes cannot tell apart", alike + heat)


def _next(proposal: PushProposal, survey: PushSurvey, album: Album) -> str:
    title = "The next experiments"
    if not len(proposal.action):
        return section("next", title, "<p>There is no pair of causes to tell apart and nothing to measure better.</p>")
    lines = album.plot(
        "next_actions.png", figures.proposal_lines(proposal, survey.measured),
        "The proposed pushes on the table, numbered in their order.",
        f"<b>{len(proposal.action)} pushes</b> that say most about the open "
        "questions, over the recorded ones (grey), in pairs: the first into freshly smoothed material, the second "
        "where the first went. They are in <code>next_actions.parquet</code>.",
    )  # fmt: skip
    rows = [
        (escape(f"{first} and {second}"), f"{before:.2f}", f"{after:.2f}")
        for (first, second), (before, after) in proposal.aliasing.items()
    ]
    alike = table(("pair", "imitation now", "with these pushes"), rows, "What they are foretold to do.") if rows else ""
    return section("next", title, lines + alike)
