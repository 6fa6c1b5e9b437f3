"""The report of a diagnosis of strokes: its page, and the figures of strokes; equal data give equal bytes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import cv2
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pentimento.diagnosis.figures import GREEN, QUIET, ResidualMap, Screening, residual_maps
from pentimento.diagnosis.page import render_report
from pentimento.diagnosis.strokes.measured import Measured
from pentimento.diagnosis.strokes.model import Model
from pentimento.diagnosis.strokes.next_actions import Proposal
from pentimento.diagnosis.strokes.out_of_distribution import UserBaseline
from pentimento.diagnosis.strokes.predict import predicted
from pentimento.diagnosis.strokes.problem import StrokeResult
from pentimento.report.figures import BLUE, ERROR_COLOURS, OCHRE, drawing, png, shared_top
from pentimento.report.wording import decimal

StrokeScreening = Screening[Measured, Model]
Array = NDArray[Any]

_QUESTIONS = (BLUE, OCHRE, GREEN, "#7a4f86", "#a33a3a", "#555555")
_CANVAS_PX = 220
"""Cells of the longer side of the canvas map."""
_ALONG = 120
"""Cells of the straightened map along the stroke."""
_ACROSS = 60
"""Cells of the straightened map across it."""
_BEYOND = 0.25
"""Shown length before the start and after the end, as a share of the stroke's length."""
_HALF_WIDTHS = 4.0
"""Shown half-widths to a side."""


def build_page(
    result: StrokeResult,
    screening: StrokeScreening,
    proposal: Proposal,
    verdict: Mapping[str, Any],
    given: UserBaseline | None = None,
) -> dict[str, bytes]:
    """``report.html``, which holds every figure, and the figures as ``figures/<name>.png``.

    Args:
        result: of the diagnosis.
        screening: what is drawn.
        proposal: the next strokes.
        verdict: content of ``verdict.json``.
        given: a user-supplied baseline model, shown beside the base.
    """
    residuals, measured = (screening.base_residual, screening.extended_residual), screening.measured
    along = [stroke_map(residual, measured) for residual in residuals]
    drawn = {
        "strokes.png": strokes(result, screening),
        "residual_stroke.png": residual_maps(
            along[0], along[1], "share of the length", y_label="mm to the left", square=False
        ),
    }
    if places_known(measured):
        canvas = [canvas_map(residual, measured) for residual in residuals]
        drawn["residual_canvas.png"] = residual_maps(canvas[0], canvas[1], "x / mm", y_label="y / mm", square=True)
    if given:
        drawn["given_strokes.png"] = given_strokes(given, result, screening)
    if proposal.actions:
        drawn["next_actions.png"] = proposal_lines(proposal, screening)
    actions = [
        (str(number), "yes" if action.reload else "", decimal(action.wait_s), " | ".join(question))
        for number, (action, question) in enumerate(zip(proposal.actions, proposal.question, strict=True), 1)
    ]
    return render_report(
        "diagnosis_strokes.html", result, screening, verdict=verdict, drawn=drawn,
        pairs=proposal.aliasing, splits=result.splits, user_baseline=given is not None, actions=actions,
    )  # fmt: skip


def strokes(result: StrokeResult, screening: StrokeScreening, shown: int = 5) -> bytes:
    """Test strokes: photographs before and after, both predictions, both errors."""
    base, extended = (predicted(model, screening.test) for model in (result.base.model, result.extended.model))
    return _stroke_sheet(screening.test, {"base": base, "extended": extended}, shown)


def given_strokes(given: UserBaseline, result: StrokeResult, screening: StrokeScreening, shown: int = 5) -> bytes:
    """The same with a user-supplied baseline model in the base's place."""
    beside = {"given model": given.predicted, "extended": predicted(result.extended.model, screening.test)}
    return _stroke_sheet(screening.test, beside, shown)


def _stroke_sheet(test_split: Measured, models: Mapping[str, Array], shown: int) -> bytes:
    """Strokes from the one that the second model improves most to the one that it improves least."""
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


def proposal_lines(proposal: Proposal, screening: StrokeScreening) -> bytes:
    """The proposed strokes over the recorded ones, numbered, in the colour of their question."""
    questions = list(dict.fromkeys(proposal.question))
    recorded = screening.measured.samples.path[..., 1:3].double().numpy() * 1e3
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
            axes.plot([], [], color=QUIET, lw=2.2, ls=(0, (4, 1)), label="dip first")
        axes.set(xlabel="x / mm", ylabel="y / mm", aspect="equal")
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.1), ncols=3, fontsize=9)
        return png(figure)


def places_known(measured: Measured) -> bool:
    """Whether places on the canvas were recorded (not all strokes start at one point)."""
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
    """Shown distance to a side: four times the usual half-width; unlimited where no ink is visible."""
    samples = measured.samples
    area = samples.ink.flatten(1).sum(1).double().numpy() / samples.pixels_per_m.double().numpy() ** 2
    length = samples.path[..., 1:3].diff(dim=1).norm(dim=-1).sum(1).double().numpy()
    half = float(np.median(area / np.maximum(length, 1e-6))) / 2
    return _HALF_WIDTHS * half if half > 0 else np.inf


def _sides_m(measured: Measured) -> tuple[Array, Array]:
    valid = measured.samples.valid
    k = measured.samples.pixels_per_m.double().numpy()
    return valid.amax(1).sum(1).numpy() / k, valid.amax(2).sum(1).numpy() / k
