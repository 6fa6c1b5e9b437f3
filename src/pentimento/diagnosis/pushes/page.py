"""The diagnosis of pushes as one page that needs no other file, and its figures."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from typing import Any

import cv2
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pentimento.contracts.frames import canvas_to_pixel
from pentimento.diagnosis import figures
from pentimento.diagnosis.experiment_design import ALIASED, aliasing_sentences
from pentimento.diagnosis.figures import ResidualMap
from pentimento.diagnosis.page import html_page, lead, leaderboard, section, temporal_drift
from pentimento.diagnosis.pushes.diagnose import PushDiagnosis
from pentimento.diagnosis.pushes.fit import MM
from pentimento.diagnosis.pushes.measured import MeasuredPushes
from pentimento.diagnosis.pushes.next_pushes import PushProposal, PushScreening
from pentimento.diagnosis.verdict import PUSHES
from pentimento.report.figures import BLUE, ERROR_COLOURS, INK, OCHRE, drawing, png, shared_top
from pentimento.report.html import Album, table
from pentimento.report.wording import count

Array = NDArray[Any]
_QUESTIONS = (BLUE, OCHRE, "#4f7f4a", "#7a4f86", "#a33a3a", "#555555")
_LIGHT = np.array([-0.5, 0.6, 0.62])  # from the upper left
_STEEPER = 1.5
_CELL_MM = 0.8


def build_page(
    diagnosis: PushDiagnosis, screening: PushScreening, proposal: PushProposal, verdict: Mapping[str, Any]
) -> dict[str, bytes]:
    """``report.html``, which holds every picture, and the pictures as ``figures/<name>.png``.

    Equal inputs give equal bytes.
    """
    album = Album()
    sections = [
        _summary(diagnosis, verdict, album),
        section("causes", "Every cause, and what the pushes say of it", leaderboard(diagnosis, screening)),
        _pushes(diagnosis, screening, album),
        _modes(diagnosis, screening, album),
        _aliasing(diagnosis, screening, album),
        _next(proposal, screening, album),
    ]
    pictures = {f"figures/{name}": data for name, data in album.files.items()}
    return pictures | {"report.html": html_page(lead(diagnosis), sections)}


def _summary(diagnosis: PushDiagnosis, verdict: Mapping[str, Any], album: Album) -> str:
    fall = album.plot(
        "leave_one_out.png", figures.leave_one_out(diagnosis, kind=PUSHES),
        "Bars from the base model's error by that without each cause to the extended model's, and to the noise floor.",
        "Mean squared error over the windows of sealed pushes, mm². <b>Base</b>: the swept tool with free nuisances "
        "(profile, depth gain, give, rims, heap, blur), and what was learnt of what it does alike in every push. "
        "Green: how much more is missed without one of the causes, all others fitted again. "
        "<b>Extended</b>: what is left with all of them. Hatched: what a smooth law of a mode that still has structure "
        "would remove, to second order. <b>Noise floor</b>: what even a perfect model would miss, from repeated "
        "actions; the band is its 95&nbsp;% interval.",
    )  # fmt: skip
    parts = diagnosis.splits
    used = (
        f"{count(verdict['rows'], 'row')}, {count(verdict['actions'], 'action')}: {len(parts.discovery)} rows "
        f"were searched, {len(parts.test)} sealed until the end: they confirm and value what was found."
    )
    return section("verdict", "Verdict", f"<p>{escape(verdict['sentence'])}</p><p>{used}</p>{fall}")


def _pushes(diagnosis: PushDiagnosis, screening: PushScreening, album: Album) -> str:
    sheet = album.plot(
        "pushes.png", push_sheet(diagnosis, screening),
        "Sealed pushes: shaded scans before and after, what base and extended model foretell, and their errors.",
        "Sealed pushes in light from the upper left, from the one that the extension helps most to the one that it "
        "helps least (or harms). <b>Before</b>, denoised, with the command in ochre from its dot; <b>after</b>: the "
        "scan; <b>base</b>, <b>extended</b>: what the models say it will be.",
    )  # fmt: skip
    along = album.plot(
        "residual_push.png",
        figures.residual_maps(
            push_map(screening.base_residual, screening.measured),
            push_map(screening.extended_residual, screening.measured),
            "mm along the travel from the start", "mm to the left", square=True, unit="mm",
        ),
        "Maps of mean and worst residual in the frame of the push.",
        "All pushes laid over one another in their own frame. Red: higher than foretold, blue: lower. <b>Mean</b> "
        "shows what is wrong every time, <b>worst</b> what is wrong at least once.",
    )  # fmt: skip
    return section("pushes", "Pushes before, after, and as foretold", sheet + along)


def _modes(diagnosis: PushDiagnosis, screening: PushScreening, album: Album) -> str:
    structured = {(left.mode, left.covariate) for left in diagnosis.unexplained}
    heat = album.plot(
        "modes.png", figures.mode_heat(screening, structured),
        "Heat map of residual modes against covariates, for base and extended model.",
        "How strongly each way in which a push can differ as a whole goes with each thing that was recorded, or that "
        "follows from its command and the surface below: the root of the number of pushes times the correlation, "
        "linear or by the square. Chance alone makes about 1, rarely 4. A frame marks what is significant among all "
        "pairs (permutations, p &lt; .01).",
    )  # fmt: skip
    curves = album.plot(
        "dependence.png", figures.dependence(screening),
        "Curves of residual modes against the covariates on which they depend most.",
        "The strongest of these pairs: means over bins with equally many pushes, in robust standard deviations, and "
        "95&nbsp;% bands that take each action as one witness. Ochre: base; blue: extended.",
    )  # fmt: skip
    return section("modes", "What the residual depends on", heat + curves + temporal_drift(diagnosis, album))


def _aliasing(diagnosis: PushDiagnosis, screening: PushScreening, album: Album) -> str:
    named = [finding.cause for finding in (*diagnosis.established, *diagnosis.suspected)]
    heat = album.plot(
        "aliasing.png", figures.aliasing_heat(screening.aliasing, named),
        "The imitation matrix of the causes.",
        "How well one cause can pass for another <i>in these pushes</i>, when the base may adapt: |cosine| of their "
        f"derivatives. Framed above {ALIASED}.",
    )  # fmt: skip
    said = "".join(f"<li>{escape(line)}</li>" for line in aliasing_sentences(screening.aliasing))
    alike = f"<ul>{said}</ul>" if said else "<p>No two causes imitate each other.</p>"
    return section("aliasing", "What these pushes cannot tell apart", alike + heat)


def _next(proposal: PushProposal, screening: PushScreening, album: Album) -> str:
    title = "The next experiments"
    if not len(proposal.action):
        return section("next", title, "<p>There is no pair of causes to tell apart and nothing to measure better.</p>")
    lines = album.plot(
        "next_actions.png", proposal_lines(proposal, screening.measured),
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


def push_sheet(diagnosis: PushDiagnosis, screening: PushScreening, shown: int = 5) -> bytes:
    """Sealed pushes, from the one that the extension helps most to the one that it helps least: shaded surfaces."""
    test_split = screening.test
    models = {"base": diagnosis.base, "extended": diagnosis.extended}
    predicted = {
        name: test_split.scene.before + model.change(test_split.scene) + test_split.learned_mm / np.float32(MM)
        for name, model in models.items()
    }
    wrong = [np.where(test_split.valid, np.abs(test_split.after - image) * 1e3, 0.0) for image in predicted.values()]
    fall = (np.square(wrong[0]) - np.square(wrong[1])).sum((1, 2))
    order = np.argsort(-fall, kind="stable")
    chosen = order[np.unique(np.linspace(0, len(order) - 1, shown).round().astype(int))]
    top = shared_top([each[b] for b in chosen for each in wrong])
    titles = ("before", "after", *models, *(f"|error| {name}" for name in models))
    with drawing():
        figure = Figure(figsize=(12.0, 1.9 * len(chosen) + 0.5), layout="constrained")
        cells = figure.subplots(len(chosen), 6, squeeze=False)
        for row, b in zip(cells, chosen, strict=True):
            surfaces = (test_split.scene.before[b], test_split.after[b], *(image[b] for image in predicted.values()))
            for axes, surface in zip(row[:4], surfaces, strict=True):
                axes.imshow(shaded(surface, test_split.scene.pixel_m), cmap="gray", vmin=0, vmax=1)
            for axes, error in zip(row[4:], wrong, strict=True):
                image = axes.imshow(error[b], cmap=ERROR_COLOURS, vmin=0, vmax=top)
            row[0].plot(*_way_px(test_split, int(b)).T, color=OCHRE, lw=1.4)
            row[0].plot(*_way_px(test_split, int(b))[0], "o", color=OCHRE, ms=4)
            for axes in row:
                axes.set(xticks=[], yticks=[])
        for axes, title in zip(cells[0], titles, strict=True):
            axes.set_title(title)
        figure.colorbar(image, ax=list(cells[:, 5]), label="mm", extend="max", shrink=0.8)
        return png(figure)


def shaded(height_m: Array, pixel_m: float) -> Array:
    """Heights [H, W] in light from the upper left, 0 to 1."""
    down, right = np.gradient(height_m.astype(np.float64), pixel_m)
    normal = np.stack([-right * _STEEPER, down * _STEEPER, np.ones_like(down)], axis=-1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    light: Array = np.clip(normal @ (_LIGHT / np.linalg.norm(_LIGHT)), 0.0, 1.0)
    return light


def push_map(residual: Array, measured: MeasuredPushes) -> ResidualMap:
    """Residuals [B, H, W] of all pushes laid over one another in the frame of the push, mm from the start."""
    reach = 4 * measured.scene.half_width_m
    x = np.arange(-reach, measured.scene.action[:, 3].max() + reach, _CELL_MM * 1e-3)
    y = np.arange(reach, -reach, -_CELL_MM * 1e-3)
    maps = []
    for b in range(len(measured)):
        x0, y0, theta = measured.scene.action[b, :3]
        along, across = np.meshgrid(x, y)
        points = np.stack(
            [x0 + np.cos(theta) * along - np.sin(theta) * across, y0 + np.sin(theta) * along + np.cos(theta) * across],
            axis=-1,
        )
        at = canvas_to_pixel(points, measured.samples.window_m[b], measured.samples.pixels_per_m).astype(np.float32)
        maps.append(
            cv2.remap(
                residual[b].astype(np.float32), at[..., 0], at[..., 1], cv2.INTER_LINEAR,
                borderMode=cv2.BORDER_CONSTANT, borderValue=(np.nan,),
            )
        )  # fmt: skip
    values = np.stack(maps)
    known = np.isfinite(values)
    count = known.sum(0)
    mean = np.where(count > 0, np.where(known, values, 0).sum(0) / np.maximum(count, 1), np.nan)
    worst = np.take_along_axis(values, np.abs(np.where(known, values, 0)).argmax(0)[None], 0)[0]
    extent = (x[0] * 1e3, x[-1] * 1e3, y[-1] * 1e3, y[0] * 1e3)
    return ResidualMap(mean, worst, extent)


def proposal_lines(proposal: PushProposal, measured: MeasuredPushes) -> bytes:
    """The proposed pushes over the recorded ones, numbered, in the colour of the question they answer."""
    asked = list(dict.fromkeys(proposal.question))
    with drawing():
        figure = Figure(figsize=(8.0, 7.0), layout="constrained")
        axes = figure.add_subplot()
        for way in _ways_mm(measured.scene.action):
            axes.plot(*way.T, color="#deded8", lw=0.9, zorder=1)
        for number, (way, question) in enumerate(zip(_ways_mm(proposal.action), proposal.question, strict=True), 1):
            colour = _QUESTIONS[asked.index(question) % len(_QUESTIONS)]
            axes.annotate(
                "", way[1], way[0], arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 2.0, "shrinkA": 0},
                zorder=3,
            )  # fmt: skip
            axes.annotate(str(number), way[0], (3, 3), textcoords="offset points", fontsize=9, color=colour, zorder=4)
        for number, question in enumerate(asked):
            axes.plot([], [], color=_QUESTIONS[number % len(_QUESTIONS)], lw=2.2, label=" | ".join(question))
        axes.plot([], [], color=INK, lw=0, label="odd numbers: smooth first")
        axes.set(xlabel="x / mm", ylabel="y / mm", aspect="equal")
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.08), ncols=2, fontsize=9)
        return png(figure)


def _ways_mm(action: Array) -> Array:
    """Start and end of travel, [B, 2, 2] mm."""
    ahead = action[:, 3:4] * np.stack([np.cos(action[:, 2]), np.sin(action[:, 2])], axis=1)
    return np.stack([action[:, :2], action[:, :2] + ahead], axis=1) * 1e3


def _way_px(measured: MeasuredPushes, row: int) -> Array:
    way = _ways_mm(measured.scene.action[row : row + 1])[0] / 1e3
    return canvas_to_pixel(way, measured.samples.window_m[row], measured.samples.pixels_per_m)
