"""Figures as PNG bytes (curves, difference maps, stroke paths), image differences and time-lapses.

Drawn with matplotlib's defaults, independent of the user's settings, and without metadata: equal data give equal bytes.
"""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple

import cv2
import matplotlib.style
import numpy as np
import PIL.Image
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pentimento.contracts.colour import linear_to_srgb, srgb_to_linear, to_float
from pentimento.contracts.plan import Plan

FloatArray = NDArray[np.float64]
Image = NDArray[np.uint8]

INK, BLUE, OCHRE = "#2b2b2b", "#1f6f8b", "#c26a1b"
ERROR_COLOURS = "OrRd"
_DPI = 130
_MM = 1000.0
_HOLD = 12  # frames for which a time-lapse shows its last picture
_STYLE: dict[str, Any] = {
    "font.size": 11.0,
    "text.color": INK,
    "axes.edgecolor": "#8a8a86",
    "axes.labelcolor": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlesize": 11.0,
    "xtick.color": "#55554f",
    "ytick.color": "#55554f",
    "figure.facecolor": "white",
    "legend.frameon": False,
}


class Series(NamedTuple):
    """One curve of a chart."""

    label: str
    x: Sequence[float]
    y: Sequence[float]
    colour: str
    line: str = "-"


@contextmanager
def drawing() -> Iterator[None]:
    """The settings with which every figure is drawn and saved."""
    with matplotlib.style.context(["default", _STYLE]):
        yield


def png(figure: Figure) -> bytes:
    """The figure's bytes; call within `drawing()`."""
    data = io.BytesIO()
    figure.savefig(data, format="png", dpi=_DPI, metadata={"Software": None})
    return data.getvalue()


def line_chart(series: Sequence[Series], x_label: str, y_label: str, size_in: tuple[float, float]) -> bytes:
    """Curves over a common axis, from zero; a legend where there is more than one."""
    with drawing():
        figure = Figure(figsize=size_in, layout="constrained")
        axes = figure.add_subplot()
        for curve in series:
            marker = "o" if len(curve.x) <= 40 else None
            axes.plot(
                curve.x, curve.y, curve.line, label=curve.label, color=curve.colour, lw=2, marker=marker, markersize=4
            )
        axes.set(xlabel=x_label, ylabel=y_label)
        axes.set_ylim(bottom=0)
        axes.margins(x=0.01)
        axes.grid(axis="y", color="#e4e4df", lw=0.8)
        axes.set_axisbelow(True)
        if len(series) > 1:
            axes.legend(loc="best")
        return png(figure)


def difference_maps(maps: Mapping[str, FloatArray], label: str) -> bytes:
    """Images [H, W] under their titles side by side with a common colour scale."""
    top = shared_top(list(maps.values()))
    height, width = next(iter(maps.values())).shape
    cell_in = 3.4
    with drawing():
        size_in = (cell_in * len(maps) + 1.0, cell_in * height / width + 0.4)
        figure = Figure(figsize=size_in, layout="constrained")
        cells = figure.subplots(1, len(maps), squeeze=False)[0]
        for axes, (title, values) in zip(cells, maps.items(), strict=True):
            image = axes.imshow(values, cmap=ERROR_COLOURS, vmin=0.0, vmax=top)
            axes.set_title(title)
            _bare(axes)
        figure.colorbar(image, cax=_beside(cells[-1]), label=label, extend="max")
        return png(figure)


def stroke_lines(plan: Plan) -> bytes:
    """The paths of all strokes on the canvas in mm: in the colour of their paint, and by their order."""
    width_m, height_m = plan.header.canvas_size_m
    paths = [stroke.path for stroke in plan.strokes]
    pieces = [np.stack([path[:-1, 1:3], path[1:, 1:3]], axis=1) * _MM for path in paths]
    lengths = [len(piece) for piece in pieces]
    press_mm = np.concatenate([np.clip(-(path[:-1, 3] + path[1:, 3]) / 2, 0, None) for path in paths]) * _MM
    line_pt = 0.8 + 2.0 * press_mm / max(float(press_mm.max()), 1e-6)
    painted = np.repeat(np.stack([stroke.color_srgb for stroke in plan.strokes]), lengths, axis=0)
    order = np.repeat(np.arange(1, len(paths) + 1), lengths)
    segments = np.concatenate(pieces)
    with drawing():
        figure = Figure(figsize=(11.5, 4.95 * height_m / width_m + 0.8), layout="constrained")
        left, right = figure.subplots(1, 2)
        left.add_collection(LineCollection(list(segments), colors=painted, linewidths=line_pt, capstyle="round"))
        by_order = LineCollection(
            list(segments),
            array=order,
            cmap="viridis",
            norm=Normalize(1, len(paths)),
            linewidths=line_pt,
            capstyle="round",
        )
        right.add_collection(by_order)
        for axes, title in ((left, "in the colour of the paint"), (right, "in the order of execution")):
            axes.set(xlim=(0, width_m * _MM), ylim=(0, height_m * _MM), aspect="equal", xlabel="x / mm")
            axes.set_title(title)
            axes.set_facecolor("#cfcfca" if axes is left else "#f7f7f4")
        left.set_ylabel("y / mm")
        figure.colorbar(by_order, cax=_beside(right), label="stroke")
        return png(figure)


def difference(predicted: Image, real: Image) -> FloatArray:
    """Root mean squared difference over the channels, sRGB in [0, 1], [H, W] of `predicted`.

    A `real` photograph of another resolution is resampled to that of `predicted` by area averages of linear light.
    """
    squared = np.square(to_float(predicted).astype(np.float64) - resized(real, predicted.shape))
    return np.asarray(np.sqrt(squared.mean(axis=-1)))


def resized(image: Image, shape: Sequence[int]) -> FloatArray:
    """An sRGB image as floats [h, w, 3] at `shape` (h, w, ...)."""
    srgb = to_float(image).astype(np.float64)
    if image.shape[:2] == tuple(shape[:2]):
        return srgb
    linear = cv2.resize(srgb_to_linear(srgb), (shape[1], shape[0]), interpolation=cv2.INTER_AREA)
    return linear_to_srgb(np.asarray(linear, dtype=np.float64))


def time_lapse(frames: Sequence[Image], frame_ms: int) -> bytes:
    """An endless GIF of sRGB frames [H, W, 3]; the last one is held.

    All frames share one palette of 256 colours, so that colours do not flicker.
    """
    strip = PIL.Image.fromarray(np.concatenate(list(frames)))
    palette = strip.quantize(256, method=PIL.Image.Quantize.MEDIANCUT)
    pages = [PIL.Image.fromarray(frame).quantize(palette=palette, dither=PIL.Image.Dither.NONE) for frame in frames]
    durations = [frame_ms] * (len(pages) - 1) + [frame_ms * _HOLD]
    data = io.BytesIO()
    pages[0].save(data, "GIF", save_all=True, append_images=pages[1:], duration=durations, loop=0)
    return data.getvalue()


def shared_top(maps: Sequence[FloatArray]) -> float:
    """A common max of colour scales: the 99.5th percentile of all, rounded up to 0.05."""
    high = float(np.percentile(np.concatenate([values.ravel() for values in maps]), 99.5))
    return max(float(np.ceil(high / 0.05)) * 0.05, 0.05)


def _beside(axes: Axes) -> Axes:
    """Axes for a colour bar of the height of `axes`."""
    return axes.inset_axes((1.03, 0.0, 0.035, 1.0))


def _bare(axes: Axes) -> None:
    axes.set_xticks([])
    axes.set_yticks([])
    for side in axes.spines.values():
        side.set_visible(False)
