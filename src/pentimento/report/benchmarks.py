"""The report's section on speed: what the renderer takes, beside the published ones (docs/benchmarks.md has it all)."""

from __future__ import annotations

import json
from dataclasses import dataclass
from html import escape
from itertools import cycle
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pentimento.contracts.errors import ContractError
from pentimento.report.figures import BLUE, OCHRE, drawing, png
from pentimento.report.html import Album
from pentimento.report.wording import decimal

POINTS = 32
"""Of the paths whose times are drawn."""
_SHADES = ("#1f6f8b", "#58a0b8", "#9cc7d5")
_PEER_COLOURS = (OCHRE, "#8a4a9c", "#4f7d3a", "#a0522d", "#66665f")
_MARKERS = "sD^vP"


@dataclass(frozen=True)
class Timing:
    """Forward + backward of some strokes."""

    strokes: int
    s: float
    extrapolated: bool = False


@dataclass(frozen=True)
class BenchmarkInputs:
    """What ``make bench`` measured on one thread, and what others are known to take."""

    cpu: str
    ours: dict[int, list[Timing]]
    """By the canvas's width in px: paths of POINTS points, medians."""
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


def benchmark_section(inputs: BenchmarkInputs, album: Album) -> str:
    """HTML of the section; its picture goes into the album."""
    plot = album.plot(
        "renderer_time.png",
        draw_times(inputs),
        "Seconds against number of strokes, both logarithmic: Pentimento’s renderer on canvases of "
        f"{', '.join(f'{size} px' for size in inputs.ours)}, the dense reference, and others’ renderers.",
        f"One image and all of its gradients, forward + backward, on one thread. <b>Filled circles</b>: Pentimento, "
        f"paths of {POINTS} points, on {escape(inputs.cpu)}. <b>Crosses</b>: the dense reference of the same formula, "
        "there too. <b>The rest</b>: others’ renderers as published or measured elsewhere, on another machine; open "
        "where extrapolated.",
    )
    return f"""<section id="speed">
<h2>What rendering costs</h2>
<p>{comparison(inputs)} A planner renders hundreds of times for one picture, so this is what its speed hangs on;
<code>docs/benchmarks.md</code> has every case.</p>
{plot}
</section>"""


def comparison(inputs: BenchmarkInputs) -> str:
    """The largest number of strokes that both we and the first peer rendered, as a sentence that is true either way."""
    size = min(inputs.ours)
    name, theirs = next(iter(inputs.peers.items()))
    common = {t.strokes: t.s for t in inputs.ours[size]}
    known = [t for t in theirs if t.strokes in common and not t.extrapolated]
    if not known:
        return f"Nothing in common was measured with {escape(name)}."
    other = max(known, key=lambda timing: timing.strokes)
    own = common[other.strokes]
    factor = f"{round(other.s / own):d} times less" if other.s > own else f"{decimal(own / other.s)} times more"
    return (
        f"{other.strokes} strokes on {size}² pixels and all of their gradients take {decimal(1000 * own)} ms, "
        f"{factor} than the {decimal(other.s)} s of {escape(name.partition(',')[0])}."
    )


def draw_times(inputs: BenchmarkInputs) -> bytes:
    """PNG: seconds against strokes, both axes logarithmic."""
    with drawing():
        figure = Figure(figsize=(8.6, 5.2), layout="constrained")
        axes = figure.add_subplot()
        for (size, timings), colour in zip(sorted(inputs.ours.items()), cycle(_SHADES), strict=False):
            _draw(axes, timings, f"Pentimento, {size}²", colour, "o")
        if inputs.reference:
            _draw(axes, inputs.reference, "dense reference, 256²", BLUE, "x", ":")
        for (name, timings), colour, marker in zip(
            inputs.peers.items(), cycle(_PEER_COLOURS), cycle(_MARKERS), strict=False
        ):
            _draw(axes, timings, name, colour, marker, "--")
        axes.set(xscale="log", yscale="log", xlabel="strokes", ylabel="forward + backward / s")
        counts = sorted({timing.strokes for timings in inputs.ours.values() for timing in timings})
        axes.set_xticks(counts, [str(count) for count in counts])
        axes.minorticks_off()
        axes.grid(color="#e4e4df", lw=0.8)
        axes.set_axisbelow(True)
        figure.legend(loc="outside right upper", fontsize=9.5)
        return png(figure)


def _draw(axes: Axes, timings: list[Timing], label: str, colour: str, marker: str, line: str = "-") -> None:
    """A curve with its marks; marks of what was not measured are open."""
    x, y = [t.strokes for t in timings], [t.s for t in timings]
    axes.plot(x, y, line, color=colour, lw=1.6, marker=marker, markersize=6, label=label)
    guessed = [t for t in timings if t.extrapolated]
    axes.plot(
        [t.strokes for t in guessed], [t.s for t in guessed], marker, color=colour, markersize=6, mfc="white", zorder=3
    )


def _timing(case: dict[str, Any]) -> Timing:
    return Timing(int(case["strokes"]), float(case["forward_backward"]["median_s"]))
