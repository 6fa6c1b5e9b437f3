"""The diagnosis as one page that needs no other file, and its figures."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from typing import Any

import cv2
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pentimento.diagnosis import figures
from pentimento.diagnosis.experiment_design import ALIASED, aliasing_sentences
from pentimento.diagnosis.figures import _GREEN, _QUIET, ResidualMap
from pentimento.diagnosis.page import html_page, lead, leaderboard, section, temporal_drift
from pentimento.diagnosis.strokes.diagnose import Diagnosis
from pentimento.diagnosis.strokes.measured import Measured
from pentimento.diagnosis.strokes.next_actions import Proposal, Survey
from pentimento.diagnosis.strokes.out_of_distribution import UserBaseline
from pentimento.diagnosis.strokes.predict import predicted
from pentimento.report.figures import BLUE, ERROR_COLOURS, OCHRE, drawing, png, shared_top
from pentimento.report.html import Album, table
from pentimento.report.wording import count, decimal

Array = NDArray[Any]

_QUESTIONS = (BLUE, OCHRE, _GREEN, "#7a4f86", "#a33a3a", "#555555")
_CANVAS_PX = 220
_ALONG, _ACROSS = 120, 60
_BEYOND = 0.25
"""Of a stroke's length: what is shown before its start and after its end."""
_HALF_WIDTHS = 4.0


def build_page(
    diagnosis: Diagnosis,
    survey: Survey,
    proposal: Proposal,
    verdict: Mapping[str, Any],
    given: UserBaseline | None = None,
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


def _summary(diagnosis: Diagnosis, verdict: Mapping[str, Any], given: UserBaseline | None, album: Album) -> str:
    fall = album.plot(
        "leave_one_out.png", figures.leave_one_out(diagnosis, given and given.mse),
        "Bars from the base model's error by that without each cause to the extended model's, and to the noise floor.",
        "Mean squared error over the windows of sealed strokes, sRGB. "
        + ("<b>UserBaseline model</b>: the one that was named. " if given else "")
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


def _strokes(diagnosis: Diagnosis, survey: Survey, given: UserBaseline | None, album: Album) -> str:
    sheet = album.plot(
        "strokes.png", strokes(diagnosis, survey),
        "Sealed strokes: photographs before and after, what base and extended model foretell, and their errors.",
        "Sealed strokes, from the one that the extension helps most to the one that it helps least (or harms). "
        "<b>Before</b>, denoised, with the command in ochre from its dot; <b>after</b>: the photograph; <b>base</b>, "
        "<b>extended</b>: what the models say it will be; <b>|error|</b>: root mean squared over the colours.",
    )  # fmt: skip
    if given:
        sheet += album.plot(
            "given_strokes.png", given_strokes(given, diagnosis, survey),
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


def _aliasing(diagnosis: Diagnosis, survey: Survey, album: Album) -> str:
    named = [finding.cause for finding in (*diagnosis.established, *diagnosis.suspected)]
    heat = album.plot(
        "aliasing.png", figures.aliasing_heat(survey.aliasing, named),
        "The imitation matrix of the causes.",
        "How well one cause can pass for another <i>in these strokes</i>, when the base may adapt: |cosine| of their "
        f"derivatives. Framed above {ALIASED}. This is a property of how the strokes were chosen, and random place, "
        "heading, speed and dips lower it.",
    )  # fmt: skip
    said = "".join(f"<li>{escape(line)}</li>" for line in aliasing_sentences(survey.aliasing))
    alike = f"<ul>{said}</ul>" if said else "<p>No two causes imitate each other.</p>"
    return section("aliasing", "What these strokes cannot tell apart", alike + heat)


def _next(proposal: Proposal, survey: Survey, album: Album) -> str:
    title = "The next experiments"
    if not proposal.actions:
        return section("next", title, "<p>There is no pair of causes to tell apart and nothing to measure better.</p>")
    lines = album.plot(
        "next_actions.png", proposal_lines(proposal, survey),
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


def strokes(diagnosis: Diagnosis, survey: Survey, shown: int = 5) -> bytes:
    """Sealed strokes: photographs before and after, both models' foretelling, both errors."""
    base, extended = (predicted(model, survey.test_split) for model in (diagnosis.base, diagnosis.extended))
    return _stroke_sheet(survey.test_split, {"base": base, "extended": extended}, shown)


def given_strokes(given: UserBaseline, diagnosis: Diagnosis, survey: Survey, shown: int = 5) -> bytes:
    """The same with a given model in the base's place."""
    beside = {"given model": given.predicted, "extended": predicted(diagnosis.extended, survey.test_split)}
    return _stroke_sheet(survey.test_split, beside, shown)


def _stroke_sheet(test_split: Measured, models: Mapping[str, Array], shown: int) -> bytes:
    """Strokes from the one where the second model is the most better than the first to where it is the least."""
    images = list(models.values())
    after, valid = test_split.samples.after.numpy(), test_split.samples.valid.numpy() > 0
    wrong = [np.square(image - after).mean(-1) for image in images]
    fall = ((wrong[0] - wrong[1]) * valid).sum((1, 2))
    order = np.argsort(-fall, kind="stable")
    chosen = order[np.unique(np.linspace(0, len(order) - 1, shown).round().astype(int))]
    top = shared_top([np.sqrt(w[b][valid[b]]) for b in chosen for w in wrong])
    titles = ("before", "after", *models, *(f"|error| {name}" for name in models))
    heights = [valid[b].any(1).sum() / valid[b].any(0).sum() for b in chosen]
    cell = 1.8
    with drawing():
        figure = Figure(figsize=(6 * cell + 1.2, cell * sum(heights) + 0.5), layout="constrained")
        cells = figure.subplots(len(chosen), 6, squeeze=False, gridspec_kw={"height_ratios": heights})
        for row, b in zip(cells, chosen, strict=True):
            height, width = int(valid[b].any(1).sum()), int(valid[b].any(0).sum())
            pictures = (test_split.samples.before.numpy()[b], after[b], images[0][b], images[1][b])
            for axes, picture in zip(row[:4], pictures, strict=True):
                axes.imshow(np.clip(picture[:height, :width], 0, 1))
            for axes, error in zip(row[4:], wrong, strict=True):
                image = axes.imshow(np.sqrt(error[b, :height, :width]), cmap=ERROR_COLOURS, vmin=0, vmax=top)
            one = test_split.pick(np.array([b])).samples
            path = one.view.to_pixels(one.path[..., 1:3])[0].numpy()
            row[0].plot(*path.T, color=OCHRE, lw=1.2)
            row[0].plot(*path[0], "o", color=OCHRE, ms=4)
            row[0].set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5))
            for axes in row:
                axes.set_xticks([])
                axes.set_yticks([])
                for side in axes.spines.values():
                    side.set(visible=True, color="#d5d5d0", linewidth=0.6)
        for axes, title in zip(cells[0], titles, strict=True):
            axes.set_title(title)
        figure.colorbar(image, ax=list(cells[:, 5]), label="sRGB", extend="max", shrink=0.8)
        return png(figure)


def proposal_lines(proposal: Proposal, survey: Survey) -> bytes:
    """The proposed strokes over the recorded ones, numbered, in the colour of the question they answer."""
    questions = list(dict.fromkeys(proposal.question))
    recorded = survey.measured.samples.path[..., 1:3].double().numpy() * 1e3
    with drawing():
        figure = Figure(figsize=(9.0, 5.6), layout="constrained")
        axes = figure.add_subplot()
        for path in recorded:
            axes.plot(*path.T, color="#deded8", lw=0.9, zorder=1)
        for number, (action, question) in enumerate(zip(proposal.actions, proposal.question, strict=True), 1):
            colour = _QUESTIONS[questions.index(question) % len(_QUESTIONS)]
            xy = action.path[:, 1:3] * 1e3
            axes.plot(*xy.T, color=colour, lw=2.2, zorder=3, ls="-" if not action.reload else (0, (4, 1)))
            axes.annotate(
                "", xy[-1], xy[-4], arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 1.5, "shrinkA": 0}, zorder=3
            )
            axes.annotate(str(number), xy[0], (3, 3), textcoords="offset points", fontsize=9, color=colour, zorder=4)
        for number, question in enumerate(questions):
            axes.plot([], [], color=_QUESTIONS[number % len(_QUESTIONS)], lw=2.2, label=" | ".join(question))
        if any(action.reload for action in proposal.actions):
            axes.plot([], [], color=_QUIET, lw=2.2, ls=(0, (4, 1)), label="dip first")
        axes.set(xlabel="x / mm", ylabel="y / mm", aspect="equal")
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.1), ncols=3, fontsize=9)
        return png(figure)


def places_known(measured: Measured) -> bool:
    """Whether the strokes' places on the canvas were recorded (they do not all start at one point)."""
    start = measured.samples.path[:, 0, 1:3]
    return float((start.amax(0) - start.amin(0)).max()) > 1e-3


def canvas_map(residual: Array, measured: Measured) -> ResidualMap:
    """Residuals [B, H, W] (NaN outside the windows) at their places on the canvas, mm."""
    samples = measured.samples
    k = samples.pixels_per_m.double().numpy()
    x_min, y_max = samples.top_left_m.double().numpy().T
    height, width = residual.shape[1:]
    x = x_min[:, None] + (np.arange(width) + 0.5) / k[:, None]
    y = y_max[:, None] - (np.arange(height) + 0.5) / k[:, None]
    seen = np.isfinite(residual)
    b, r, c = np.nonzero(seen)
    xs, ys, values = x[b, c], y[b, r], residual[seen]
    left, right, bottom, top = xs.min(), xs.max(), ys.min(), ys.max()
    cell = max(right - left, top - bottom) / _CANVAS_PX
    columns, rows = int((right - left) / cell) + 1, int((top - bottom) / cell) + 1
    at = ((top - ys) / cell).astype(int) * columns + ((xs - left) / cell).astype(int)
    # A cell's residual of one stroke is the mean of its pixels.
    key = b * (rows * columns) + at
    cells, group, count = np.unique(key, return_inverse=True, return_counts=True)
    of_stroke = np.bincount(group, values) / count
    mean, worst = _mean_and_worst(cells % (rows * columns), of_stroke, rows * columns)
    extent = (left * 1e3, right * 1e3, bottom * 1e3, top * 1e3)
    return ResidualMap(mean.reshape(rows, columns), worst.reshape(rows, columns), extent)


def stroke_map(residual: Array, measured: Measured) -> ResidualMap:
    """Residuals [B, H, W] along straightened strokes: share of the length from start to end, mm to the left."""
    samples = measured.samples
    half_m = min(float(np.median(np.minimum(*_sides_m(measured)))) / 2, _reach_m(measured))
    share = np.linspace(-_BEYOND, 1 + _BEYOND, _ALONG)
    across = np.linspace(half_m, -half_m, _ACROSS)
    maps = []
    for b, path in enumerate(samples.path[..., 1:3].double().numpy()):
        points = _straightened(path, share, across)
        x = (points[..., 0] - float(samples.top_left_m[b, 0])) * float(samples.pixels_per_m[b]) - 0.5
        y = (float(samples.top_left_m[b, 1]) - points[..., 1]) * float(samples.pixels_per_m[b]) - 0.5
        maps.append(
            cv2.remap(
                residual[b].astype(np.float32), x.astype(np.float32), y.astype(np.float32), cv2.INTER_LINEAR,
                borderMode=cv2.BORDER_CONSTANT, borderValue=(np.nan,),
            )
        )  # fmt: skip
    values = np.stack(maps)
    seen = np.isfinite(values)
    _, row, column = np.nonzero(seen)
    mean, worst = _mean_and_worst(row * _ALONG + column, values[seen], _ACROSS * _ALONG)
    extent = (-_BEYOND, 1 + _BEYOND, -half_m * 1e3, half_m * 1e3)
    return ResidualMap(mean.reshape(_ACROSS, _ALONG), worst.reshape(_ACROSS, _ALONG), extent)


def _straightened(path: Array, share: Array, across: Array) -> Array:
    """Places [A, S, 2] at shares of a path's [N, 2] length and distances to its left."""
    steps = np.hypot(*np.diff(path, axis=0).T)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    length = max(along[-1], 1e-9)
    tangent = np.gradient(path, axis=0)
    tangent /= np.maximum(np.hypot(*tangent.T), 1e-12)[:, None]
    at = np.clip(share, 0, 1) * length
    on_path = np.stack([np.interp(at, along, path[:, i]) for i in (0, 1)], 1)
    heading = np.stack([np.interp(at, along, tangent[:, i]) for i in (0, 1)], 1)
    on_path = on_path + (share * length - at)[:, None] * heading
    left = np.stack([-heading[:, 1], heading[:, 0]], 1)
    places: Array = on_path[None] + across[:, None, None] * left[None]
    return places


def _mean_and_worst(cell: Array, values: Array, cells: int) -> tuple[Array, Array]:
    count = np.bincount(cell, minlength=cells)
    mean = np.where(count > 0, np.bincount(cell, values, minlength=cells) / np.maximum(count, 1), np.nan)
    worst = np.full(cells, np.nan)
    order = np.argsort(np.abs(values), kind="stable")
    worst[cell[order]] = values[order]  # the last one written is the largest
    return mean, worst


def _reach_m(measured: Measured) -> float:
    """How far to a side strokes are shown: four times their usual half-width; without bound where no ink is seen."""
    samples = measured.samples
    area = samples.ink.flatten(1).sum(1).double().numpy() / samples.pixels_per_m.double().numpy() ** 2
    length = samples.path[..., 1:3].diff(dim=1).norm(dim=-1).sum(1).double().numpy()
    half = float(np.median(area / np.maximum(length, 1e-6))) / 2
    return _HALF_WIDTHS * half if half > 0 else np.inf


def _sides_m(measured: Measured) -> tuple[Array, Array]:
    valid = measured.samples.valid
    k = measured.samples.pixels_per_m.double().numpy()
    return valid.amax(1).sum(1).numpy() / k, valid.amax(2).sum(1).numpy() / k
