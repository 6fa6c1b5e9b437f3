"""Drawn figures as PNG bytes: curves, difference maps, the strokes as lines.

Drawn with matplotlib's own defaults, whatever the user's settings, and without metadata: equal data give
equal bytes.
"""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple

import matplotlib.style
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pentimento.contracts.plan import Plan

FloatArray = NDArray[np.float64]

INK, BLUE, OCHRE = "#2b2b2b", "#1f6f8b", "#c26a1b"
ERROR_COLOURS = "OrRd"
_DPI = 130
_MM = 1000.0
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
    """The settings under which every figure is made and saved."""
    with matplotlib.style.context(["default", _STYLE]):
        yield


def png(figure: Figure) -> bytes:
    """The figure's bytes; call within `drawing()`."""
    data = io.BytesIO()
    figure.savefig(data, format="png", dpi=_DPI, metadata={"Software": None})
    return data.getvalue()


def line_chart(series: Sequence[Series], x_label: str, y_label: str, size_in: tuple[float, float]) -> bytes:
    """Curves over a common axis, from zero up; a legend where there is more than one."""
    with drawing():
        figure = Figure(figsize=size_in, layout="constrained")
        axes = figure.add_subplot()
        for one in series:
            marker = "o" if len(one.x) <= 40 else None
            axes.plot(one.x, one.y, one.line, label=one.label, color=one.colour, lw=2, marker=marker, markersize=4)
        axes.set(xlabel=x_label, ylabel=y_label)
        axes.set_ylim(bottom=0)
        axes.margins(x=0.01)
        axes.grid(axis="y", color="#e4e4df", lw=0.8)
        axes.set_axisbelow(True)
        if len(series) > 1:
            axes.legend(loc="best")
        return png(figure)


def difference_maps(maps: Mapping[str, FloatArray], label: str) -> bytes:
    """Images [H, W] under their titles side by side on one colour scale, with its bar."""
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


def shared_top(maps: Sequence[FloatArray]) -> float:
    """A common upper end for colour scales: the 99.5th percentile of all, rounded up to 0.05."""
    high = float(np.percentile(np.concatenate([values.ravel() for values in maps]), 99.5))
    return max(float(np.ceil(high / 0.05)) * 0.05, 0.05)


def _beside(axes: Axes) -> Axes:
    """Where a colour bar as tall as `axes` stands."""
    return axes.inset_axes((1.03, 0.0, 0.035, 1.0))


def _bare(axes: Axes) -> None:
    axes.set_xticks([])
    axes.set_yticks([])
    for side in axes.spines.values():
        side.set_visible(False)
