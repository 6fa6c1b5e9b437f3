"""Recorded strokes with their predictions: selection and drawing of a sheet (thesis Figure 4.8)."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from numpy.typing import NDArray
from torch import Tensor

from pentimento.dynamics.strokes.evaluation import predict, predicted_ink
from pentimento.dynamics.strokes.samples import StrokeSamples
from pentimento.dynamics.strokes.traj2stroke import Traj2Stroke, Traj2StrokeParameters
from pentimento.report.figures import ERROR_COLOURS, OCHRE, drawing, png, shared_top

FloatArray = NDArray[np.float64]

COLUMNS = ("before", "after", "Traj2Stroke", "polyline", "|error| Traj2Stroke", "|error| polyline")
_LABEL_IN = 1.25
"""Width of the rows' labels; all sizes in inches."""
_CELL_IN = 1.62
"""Width of the widest picture."""
_GAP_IN = 0.06
"""Gap between pictures."""
_TITLE_IN = 0.32
"""Height of the columns' titles."""
_BAR_IN = 0.75
"""Width of the space for the colour bar."""
_SCALE_BAR_M = 0.01


class ShownStroke(NamedTuple):
    """One row of the sheet. Images are sRGB [H, W, 3]."""

    label: str
    before: FloatArray
    after: FloatArray
    model: FloatArray
    polyline: FloatArray
    path_px: FloatArray
    """[N, 2] the commanded path, (column, row)."""
    pixels_per_m: float
    iou: tuple[float, float]
    """Of the model and of the polyline."""
    l1: tuple[float, float]


def choose(
    samples: StrokeSamples, model: Traj2StrokeParameters, polyline: Traj2StrokeParameters, shown: int
) -> list[ShownStroke]:
    """Strokes from the model's best prediction (by IoU) through the median to the worst, evenly by rank.

    Strokes without visible ink have no IoU and are excluded unless there are no others.
    """
    predicted = [predict_photos(parameters, samples) for parameters in (model, polyline)]
    ious, l1s = zip(*(stroke_scores(image, samples) for image in predicted), strict=True)
    inked = torch.nonzero(~torch.isnan(ious[0])).flatten()
    ranked = inked[torch.argsort(ious[0][inked], descending=True, stable=True)]
    if len(ranked) == 0:
        ranked = torch.arange(len(samples.path))
    ranks = np.unique(np.linspace(0, len(ranked) - 1, shown).round().astype(int))
    return [
        _shown(
            _rank_name(int(rank), len(ranked)), samples, [image[int(ranked[rank])] for image in predicted],
            index=int(ranked[rank]), ious=[iou[ranked[rank]].item() for iou in ious],
            l1s=[l1[ranked[rank]].item() for l1 in l1s],
        )
        for rank in ranks
    ]  # fmt: skip


def predict_photos(parameters: Traj2StrokeParameters, samples: StrokeSamples) -> Tensor:
    """The photographs after the strokes as predicted by a model, sRGB [B, H, W, 3]."""
    with torch.no_grad():
        return predict(Traj2Stroke(parameters), samples)


def stroke_scores(predicted: Tensor, samples: StrokeSamples) -> tuple[Tensor, Tensor]:
    """(IoU, L1) of each stroke, [B] each; IoU is NaN for strokes without visible ink."""
    truth, guess = samples.ink, predicted_ink(samples, predicted)
    union = (truth | guess).flatten(1).sum(1)
    iou = (truth & guess).flatten(1).sum(1) / union
    iou = torch.where(truth.flatten(1).any(1), iou, torch.nan)
    difference = (predicted - samples.after).abs().mean(-1) * samples.valid
    return iou, difference.flatten(1).sum(1) / samples.valid.flatten(1).sum(1)


def draw_sheet(rows: list[ShownStroke]) -> bytes:
    """A row a stroke at one scale: before with the commanded path, after, both predictions, both errors."""
    widest = max(row.before.shape[1] / row.pixels_per_m for row in rows)
    inches_per_m = _CELL_IN / widest
    heights = [row.before.shape[0] / row.pixels_per_m * inches_per_m for row in rows]
    errors = [(row, np.abs(guess - row.after).mean(-1)) for row in rows for guess in (row.model, row.polyline)]
    top = shared_top([error for _, error in errors])
    width = _LABEL_IN + len(COLUMNS) * (_CELL_IN + _GAP_IN) + _BAR_IN
    height = _TITLE_IN + sum(max(h, 0.75) + _GAP_IN for h in heights)
    with drawing():
        figure = Figure(figsize=(width, height))
        y = height - _TITLE_IN
        for row, own in zip(rows, heights, strict=True):
            y -= max(own, 0.75) + _GAP_IN
            images = (row.before, row.after, row.model, row.polyline)
            maps = tuple(np.abs(guess - row.after).mean(-1) for guess in (row.model, row.polyline))
            own_width = row.before.shape[1] / row.pixels_per_m * inches_per_m
            for column, image in enumerate((*images, *maps)):
                x = _LABEL_IN + column * (_CELL_IN + _GAP_IN) + (_CELL_IN - own_width) / 2
                axes = figure.add_axes((x / width, y / height, own_width / width, own / height))
                last = _draw(axes, image, top)
                if column == 0:
                    _draw_command(axes, row)
            figure.text(0.06 / width, (y + own / 2) / height, _row_label(row), va="center", fontsize=11)
        for column, title in enumerate(COLUMNS):
            x = _LABEL_IN + column * (_CELL_IN + _GAP_IN) + _CELL_IN / 2
            figure.text(x / width, 1 - 0.2 / height, title, ha="center", fontsize=11)
        tall = min(height - _TITLE_IN, 4.0)
        bar = figure.add_axes(
            ((width - _BAR_IN + 0.1) / width, (height - _TITLE_IN - tall) / height, 0.13 / width, tall / height)
        )
        figure.colorbar(last, cax=bar, extend="max")
        return png(figure)


def _draw(axes: Axes, image: FloatArray, top: float) -> AxesImage:
    axes.set_xticks([])
    axes.set_yticks([])
    for side in axes.spines.values():
        side.set(visible=True, color="#d5d5d0", linewidth=0.6)
    if image.ndim == 2:
        return axes.imshow(image, cmap=ERROR_COLOURS, vmin=0.0, vmax=top, aspect="auto")
    return axes.imshow(np.clip(image, 0, 1), aspect="auto")


def _draw_command(axes: Axes, row: ShownStroke) -> None:
    axes.plot(*row.path_px.T, color=OCHRE, lw=1.2)
    axes.plot(*row.path_px[0], "o", color=OCHRE, markersize=4)
    height, width = row.before.shape[:2]
    axes.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5))
    right, below = width - 0.05 * width, height - 0.08 * height
    axes.plot([right - _SCALE_BAR_M * row.pixels_per_m, right], [below, below], color="#333", lw=2)


def _row_label(row: ShownStroke) -> str:
    return f"{row.label}\nIoU {_score(row.iou[0])}\npolyline {_score(row.iou[1])}"


def _score(value: float) -> str:
    return "–" if np.isnan(value) else f"{value:.2f}"


def _rank_name(rank: int, of: int) -> str:
    match rank:
        case 0:
            return "best"
        case _ if rank == of - 1:
            return "worst"
        case _ if 2 * rank in (of - 2, of - 1, of):
            return "median"
        case _:
            return f"rank {rank + 1} of {of}"


def _shown(
    label: str, samples: StrokeSamples, predicted: list[Tensor], *, index: int, ious: list[float], l1s: list[float]
) -> ShownStroke:
    """One stroke's pictures without their padding (right and bottom)."""
    valid = samples.valid[index] > 0
    height, width = int(valid.any(1).sum()), int(valid.any(0).sum())

    def image(values: Tensor) -> NDArray[Any]:
        return values[:height, :width].double().numpy()

    one = samples.pick(torch.tensor([index]))
    return ShownStroke(
        label=label,
        before=image(samples.before[index]),
        after=image(samples.after[index]),
        model=image(predicted[0]),
        polyline=image(predicted[1]),
        path_px=one.view.to_pixels(one.path[..., 1:3])[0].double().numpy(),
        pixels_per_m=float(samples.pixels_per_m[index]),
        iou=(ious[0], ious[1]),
        l1=(l1s[0], l1s[1]),
    )
