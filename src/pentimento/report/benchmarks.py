"""The report's section on rendering speed, with published renderers (docs/benchmarks.md has all cases)."""

from __future__ import annotations

import json
from dataclasses import dataclass
from itertools import cycle
from pathlib import Path
from typing import Any

from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pentimento.contracts.errors import ContractError
from pentimento.report.figures import BLUE, OCHRE, drawing, png
from pentimento.report.html import Album
from pentimento.report.templates import render
from pentimento.report.wording import decimal

POINTS = 32
"""Of the paths in the chart."""
_SHADES = ("#1f6f8b", "#58a0b8", "#9cc7d5")
_PEER_COLOURS = (OCHRE, "#8a4a9c", "#4f7d3a", "#a0522d", "#66665f")
_MARKERS = "sD^vP"


@dataclass(frozen=True)
class Timing:
    """Seconds of forward + backward for a number of strokes."""

    strokes: int
    s: float
    extrapolated: bool = False


@dataclass(frozen=True)
class BenchmarkInputs:
    """Results of ``make bench`` on one thread, and published timings of other renderers."""

    cpu: str
    ours: dict[int, list[Timing]]
    """By the canvas's width in px: medians for paths of POINTS points."""
    reference: list[Timing]
    """The dense reference at 256²."""
    peers: dict[str, list[Timing]]


def read_benchmarks(path: Path) -> BenchmarkInputs:
    """Read ``docs/benchmarks.json``.

    Raises:
        ContractError: it is missing or does not hold what it should.
    """
    try:
        results: dict[str, Any] = json.loads(path.read_bytes())
        ours: dict[int, list[Timing]] = {}
        for case in results["cases"]:
            if (case["points"], case["threads"], case["kind"]) == (POINTS, 1, "plain"):
                ours.setdefault(case["size_px"], []).append(_timing(case))
        reference = [_timing(c) for c in results["reference"] if (c["points"], c["size_px"]) == (POINTS, 256)]
        peers = {
            f"{peer['name']}, {peer['canvas']}": [
                Timing(p["strokes"], p["s"], p["extrapolated"]) for p in peer["points"]
            ]
            for peer in results["peers"]
        }
        cpu = results["machine"]["cpu"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ContractError(f"{path} is not a file of benchmarks ({error}); run `make bench`.") from error
    if not ours or not peers:
        raise ContractError(f"{path} holds no times of {POINTS}-point paths, or none of others; run `make bench`.")
    return BenchmarkInputs(cpu, ours, reference, peers)


def benchmark_section(inputs: BenchmarkInputs, album: Album) -> Markup:
    """HTML of the section; its picture goes into the album."""
    return render(
        "report/benchmarks.html",
        album=album,
        inputs=inputs,
        comparison=comparison(inputs),
        chart=draw_times(inputs),
        sizes=", ".join(f"{size} px" for size in inputs.ours),
        points=POINTS,
    )


def comparison(inputs: BenchmarkInputs) -> str:
    """A sentence that compares both renderers at the max number of strokes measured for both."""
    size = min(inputs.ours)
    name, theirs = next(iter(inputs.peers.items()))
    common = {t.strokes: t.s for t in inputs.ours[size]}
    known = [t for t in theirs if t.strokes in common and not t.extrapolated]
    if not known:
        return f"No common case was measured with {name}."
    other = max(known, key=lambda timing: timing.strokes)
    own = common[other.strokes]
    factor = f"{round(other.s / own):d} times less" if other.s > own else f"{decimal(own / other.s)} times more"
    return (
        f"{other.strokes} strokes on {size}² pixels and all of their gradients take {decimal(1000 * own)} ms, "
        f"{factor} than the {decimal(other.s)} s of {name.partition(',')[0]}."
    )


def draw_times(inputs: BenchmarkInputs) -> bytes:
    """PNG: seconds against strokes, both axes logarithmic."""
    with drawing():
        figure = Figure(figsize=(8.6, 5.2), layout="constrained")
        axes = figure.add_subplot()
        for (size, timings), colour in zip(sorted(inputs.ours.items()), cycle(_SHADES), strict=False):
            _draw(axes, timings, f"Pentimento, {size}²", colour=colour, marker="o")
        if inputs.reference:
            _draw(axes, inputs.reference, "dense reference, 256²", colour=BLUE, marker="x", line=":")
        for (name, timings), colour, marker in zip(
            inputs.peers.items(), cycle(_PEER_COLOURS), cycle(_MARKERS), strict=False
        ):
            _draw(axes, timings, name, colour=colour, marker=marker, line="--")
        axes.set(xscale="log", yscale="log", xlabel="strokes", ylabel="forward + backward / s")
        counts = sorted({timing.strokes for timings in inputs.ours.values() for timing in timings})
        axes.set_xticks(counts, [str(count) for count in counts])
        axes.minorticks_off()
        axes.grid(color="#e4e4df", lw=0.8)
        axes.set_axisbelow(True)
        figure.legend(loc="outside right upper", fontsize=9.5)
        return png(figure)


def _draw(axes: Axes, timings: list[Timing], label: str, *, colour: str, marker: str, line: str = "-") -> None:
    """A curve with markers, which are open where extrapolated."""
    x, y = [t.strokes for t in timings], [t.s for t in timings]
    axes.plot(x, y, line, color=colour, lw=1.6, marker=marker, markersize=6, label=label)
    guessed = [t for t in timings if t.extrapolated]
    axes.plot(
        [t.strokes for t in guessed], [t.s for t in guessed], marker, color=colour, markersize=6, mfc="white", zorder=3
    )


def _timing(case: dict[str, Any]) -> Timing:
    return Timing(int(case["strokes"]), float(case["forward_backward"]["median_s"]))
