"""The report of a diagnosis of pushes: its page, and the figures of pushes; equal data give equal bytes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import cv2
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pentimento.contracts.frames import canvas_to_pixel
from pentimento.diagnosis.figures import ResidualMap, residual_maps
from pentimento.diagnosis.page import render_report
from pentimento.diagnosis.pushes.jacobian import MM
from pentimento.diagnosis.pushes.measured import MeasuredPushes
from pentimento.diagnosis.pushes.next_pushes import PushProposal, PushScreening
from pentimento.diagnosis.pushes.problem import PushResult
from pentimento.report.figures import BLUE, ERROR_COLOURS, INK, OCHRE, drawing, png, shared_top

Array = NDArray[Any]
_QUESTIONS = (BLUE, OCHRE, "#4f7f4a", "#7a4f86", "#a33a3a", "#555555")
"""Colours of the open questions."""
_LIGHT = np.array([-0.5, 0.6, 0.62])
"""Direction of the light, from the upper left: right, up, towards the eye."""
_SLOPE_GAIN = 1.5
"""Slopes are exaggerated by this factor."""
_CELL_MM = 0.8
"""Pixel of the residual maps."""


def build_page(
    result: PushResult, screening: PushScreening, proposal: PushProposal, verdict: Mapping[str, Any]
) -> dict[str, bytes]:
    """``report.html``, which holds every figure, and the figures as ``figures/<name>.png``."""
    maps = [
        push_map(residual, screening.measured) for residual in (screening.base_residual, screening.extended_residual)
    ]
    drawn = {
        "pushes.png": push_sheet(result, screening),
        "residual_push.png": residual_maps(
            maps[0], maps[1], "mm along the travel from the start", y_label="mm to the left", square=True, unit="mm"
        ),
    }
    if len(proposal.action):
        drawn["next_actions.png"] = proposal_lines(proposal, screening.measured)
    return render_report(
        "diagnosis_pushes.html", result, screening, verdict=verdict, drawn=drawn,
        pairs=proposal.aliasing, splits=result.splits, proposed=len(proposal.action),
    )  # fmt: skip


def push_sheet(result: PushResult, screening: PushScreening, shown: int = 5) -> bytes:
    """Test pushes, from the one that the extension improves most to the one that it improves least: shaded surfaces."""
    test = screening.test
    models = {"base": result.base.model, "extended": result.extended.model}
    predicted = {
        name: test.scene.before + model.change(test.scene) + test.learned_mm / np.float32(MM)
        for name, model in models.items()
    }
    wrong = [np.where(test.valid, np.abs(test.after - image) * 1e3, 0.0) for image in predicted.values()]
    fall = (np.square(wrong[0]) - np.square(wrong[1])).sum((1, 2))
    order = np.argsort(-fall, kind="stable")
    chosen = order[np.unique(np.linspace(0, len(order) - 1, shown).round().astype(int))]
    top = shared_top([each[b] for b in chosen for each in wrong])
    titles = ("before", "after", *models, *(f"|error| {name}" for name in models))
    with drawing():
        figure = Figure(figsize=(12.0, 1.9 * len(chosen) + 0.5), layout="constrained")
        cells = figure.subplots(len(chosen), 6, squeeze=False)
        for row, b in zip(cells, chosen, strict=True):
            surfaces = (test.scene.before[b], test.after[b], *(image[b] for image in predicted.values()))
            for axes, surface in zip(row[:4], surfaces, strict=True):
                axes.imshow(shaded(surface, test.scene.pixel_m), cmap="gray", vmin=0, vmax=1)
            for axes, error in zip(row[4:], wrong, strict=True):
                image = axes.imshow(error[b], cmap=ERROR_COLOURS, vmin=0, vmax=top)
            row[0].plot(*_path_px(test, int(b)).T, color=OCHRE, lw=1.4)
            row[0].plot(*_path_px(test, int(b))[0], "o", color=OCHRE, ms=4)
            for axes in row:
                axes.set(xticks=[], yticks=[])
        for axes, title in zip(cells[0], titles, strict=True):
            axes.set_title(title)
        figure.colorbar(image, ax=list(cells[:, 5]), label="mm", extend="max", shrink=0.8)
        return png(figure)


def shaded(height_m: Array, pixel_m: float) -> Array:
    """Brightness of heights [H, W] in light from the upper left, 0 to 1."""
    down, right = np.gradient(height_m.astype(np.float64), pixel_m)
    normal = np.stack([-right * _SLOPE_GAIN, down * _SLOPE_GAIN, np.ones_like(down)], axis=-1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    light: Array = np.clip(normal @ (_LIGHT / np.linalg.norm(_LIGHT)), 0.0, 1.0)
    return light


def push_map(residual: Array, measured: MeasuredPushes) -> ResidualMap:
    """Residuals [B, H, W] of all pushes, superimposed in the frame of the push, mm from the start."""
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
    """The proposed pushes over the recorded ones, numbered, in the colour of their question."""
    asked = list(dict.fromkeys(proposal.question))
    with drawing():
        figure = Figure(figsize=(8.0, 7.0), layout="constrained")
        axes = figure.add_subplot()
        for path in _paths_mm(measured.scene.action):
            axes.plot(*path.T, color="#deded8", lw=0.9, zorder=1)
        for number, (path, question) in enumerate(zip(_paths_mm(proposal.action), proposal.question, strict=True), 1):
            colour = _QUESTIONS[asked.index(question) % len(_QUESTIONS)]
            axes.annotate(
                "", path[1], path[0], arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 2.0, "shrinkA": 0},
                zorder=3,
            )  # fmt: skip
            axes.annotate(str(number), path[0], (3, 3), textcoords="offset points", fontsize=9, color=colour, zorder=4)
        for number, question in enumerate(asked):
            axes.plot([], [], color=_QUESTIONS[number % len(_QUESTIONS)], lw=2.2, label=" | ".join(question))
        axes.plot([], [], color=INK, lw=0, label="odd numbers: smooth first")
        axes.set(xlabel="x / mm", ylabel="y / mm", aspect="equal")
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.08), ncols=2, fontsize=9)
        return png(figure)


def _paths_mm(action: Array) -> Array:
    """Start and end of travel, [B, 2, 2] mm."""
    ahead = action[:, 3:4] * np.stack([np.cos(action[:, 2]), np.sin(action[:, 2])], axis=1)
    return np.stack([action[:, :2], action[:, :2] + ahead], axis=1) * 1e3


def _path_px(measured: MeasuredPushes, row: int) -> Array:
    path = _paths_mm(measured.scene.action[row : row + 1])[0] / 1e3
    return canvas_to_pixel(path, measured.samples.window_m[row], measured.samples.pixels_per_m)
