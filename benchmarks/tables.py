"""The results as Markdown: bars first, then everything."""

from collections.abc import Iterable, Sequence
from typing import Any

from benchmarks import planning
from benchmarks.bars import Bar, Results, bars, reference_seconds, seconds
from benchmarks.growth import picked
from benchmarks.peers import WHERE

_MET = {True: "yes", False: "**no**", None: "–"}
_INTRODUCTION = """\
Written by `make bench`; do not edit. Random strokes of 20 to 60 px with radii of 1.5 to 5 px on square canvases,
float32. Times are wall times of `render_strokes` as a user calls it through PyTorch's autograd, medians of several
runs after compiling; backward means the gradients of everything, the canvas's too. One thread unless another number is
given. Every case runs in a process of its own. The bars are measured by the fastest run, which is what the work takes
when the machine does nothing else; its speed changes by half from minute to minute, as the medians below show."""
_REFERENCE = """\
The dense reference in PyTorch evaluates every segment at every pixel, stroke after stroke: its time and memory are
linear in strokes. What stands in italics is the straight line through 5, 10 and 20 strokes, not measured. Ours: the
same inputs."""
_LIMIT = """\
*Evaluated* are the pairs of pixel and segment that culling lets through; *with ink* are those with D < R, counted by
trying every segment at every pixel. The renderer looks at columns in blocks of 16: lanes that run over a segment's end
are not counted as evaluated, but their time is.

*Ours* is the time of `render` and `render_backward`, called directly, over evaluated pairs: with culling, allocation
and composition. *Loop* does coverage, composition and all gradients of as many pairs, which lie ready side by side in
the processor's cache, without a branch or a look-up; the compiler made {packed} packed instructions of it. In one way
it does more than the renderer, which needs composition and gradients only where a pair is the *winner* of its pixel.
*Ours over least work* compares with the loops when they too do only that, and so is the stricter measure. *From memory*
is the loop over data that does not fit the cache ({bytes} bytes a pair)."""

_PLANNER = """\
400 strokes for each photograph on 315 × 210 px, beside plain Adam from random starts with the best of three
learning rates, and beside the same with constant rates; seconds of one thread. *Told* is the former with what execution
may take from a stroke drawn at each iteration, as ours has it. `python -m benchmarks.planner` measures more pictures
and a second seed."""


def page(results: Results) -> str:
    """The whole file."""
    sections = [
        "# Benchmarks",
        _INTRODUCTION,
        machine_line(results["machine"]),
        "## Bars",
        bar_table([*bars(results), *planning.bars(results["planner"], results["plan"])]),
        f"Peers' figures were measured on other machines: {WHERE}. The bars in seconds are for that kind of machine.",
        "## Beside the dense reference",
        _REFERENCE,
        _reference_table(results),
        "## Distance to the machine's limit",
        _LIMIT.format(
            packed=results["distance"][0]["packed_instructions"], bytes=results["distance"][0]["bytes_per_pair"]
        ),
        _distance_table(results),
        "## Growth",
        "Exponents of time, forward + backward on one thread: least squares in log-log over all sizes, and over the "
        "three largest, where fixed costs flatten it least.",
        _growth_table(results["growth"]),
        "## On a GPU",
        _gpu(results["gpu"]),
        "## The planner",
        _PLANNER,
        planning.table(results["planner"]),
        "## All cases",
        "Peak memory is what the process held at most during forward + backward, beyond inputs and libraries. "
        "In brackets the fastest run.",
        _case_table(results["cases"]),
        "## Others",
        f"Forward + backward as measured on other machines ({WHERE}); italics: extrapolated.",
        _peer_table(results["peers"]),
    ]
    return "\n\n".join(sections) + "\n"


def bar_table(rows: Sequence[Bar]) -> str:
    """The first table."""
    return markdown(("", "bar", "measured", "met?"), [(row.what, row.bar, row.measured, _MET[row.met]) for row in rows])


def markdown(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def machine_line(machine: dict[str, Any]) -> str:
    libraries = ", ".join(f"{name} {number}" for name, number in machine["libraries"].items())
    return (
        f"Machine: {machine['cpu']}; {machine['cores']} cores, {machine['memory_gb']} GB; "
        f"GPU: {machine['gpu'] or 'none'}. Python {machine['python']}, {libraries}."
    )


def _reference_table(results: Results) -> str:
    rows = []
    for row in results["reference"]:
        strokes, points, size = row["strokes"], row["points"], row["size_px"]
        dense = row["forward_backward"]["median_s"]
        known = picked(results["cases"], strokes=strokes, points=points, size_px=size, threads=1, kind="plain")
        ours = known[0]["forward_backward"]["median_s"] if known else None
        rows.append(
            (
                str(strokes), str(points), f"{size}²", f"{dense:.2f}", _mb(row["peak_mb"]),
                "–" if ours is None else f"{ours:.5f}", "–" if ours is None else f"{dense / ours:.0f}",
            )
        )  # fmt: skip
    for points in (4, 32):
        for strokes in (100, 400):
            ours, dense = seconds(results, strokes, points, 256), reference_seconds(results, points, strokes)
            cells = (str(strokes), str(points), "256²", f"*{dense:.1f}*", "–", f"{ours:.5f}", f"*{dense / ours:.0f}*")
            rows.append(cells)
    head = ("strokes", "points", "canvas", "dense reference s", "its peak MB", "ours s", "ratio")
    return markdown(head, rows)


def _distance_table(results: Results) -> str:
    head = (
        "strokes", "points", "evaluated", "with ink", "ratio", "winners", "ours ns/pair", "loop ns/pair", "ratio",
        "ours over least work", "from memory ns/pair",
    )  # fmt: skip
    rows = [
        (
            str(row["strokes"]), str(row["points"]), str(row["evaluations"]), str(row["touched"]),
            f"{row['evaluations_per_touched']:.2f}", str(row["fragments"]), f"{row['kernel_ns_per_pair']:.2f}",
            f"{row['limit_ns_per_pair']:.2f}", f"{row['times_limit']:.2f}", f"{row['times_least_work']:.2f}",
            f"{row['limit_from_memory_ns_per_pair']:.1f}",
        )
        for row in results["distance"]
    ]  # fmt: skip
    return markdown(head, rows)


def _growth_table(growth: list[dict[str, Any]]) -> str:
    rows = [
        (
            row["in"], str(row["points"]),
            f"{row['size_px']}²" if row["in"] == "strokes" else f"{row['strokes']} strokes",
            f"{row['exponent']:.2f}", f"{row['far']:.2f}",
        )
        for row in growth
    ]  # fmt: skip
    return markdown(("in", "points", "at", "exponent", "of the three largest"), rows)


def _case_table(cases: list[dict[str, Any]]) -> str:
    rows = [
        (
            str(row["strokes"]), str(row["points"]), f"{row['size_px']}²", str(row["threads"]), row["kind"],
            _both(row["forward"]), _both(row["forward_backward"]), _mb(row["peak_mb"]),
        )
        for row in cases
    ]  # fmt: skip
    head = ("strokes", "points", "canvas", "threads", "kind", "forward s", "forward + backward s", "peak MB")
    return markdown(head, rows)


def _gpu(gpu: dict[str, Any]) -> str:
    return str(gpu["missing"]) if gpu["missing"] is not None else gpu_table(gpu["cases"])


def gpu_table(cases: Sequence[dict[str, Any]]) -> str:
    """The rows of ``gpu.measure_gpu``, and what their columns mean."""
    rows = [
        (
            str(row["strokes"]), f"{row['size_px']}²", _both(row["forward"]), _both(row["forward_backward"]),
            _mb(row["peak_mb"]), f"{100 * row['bandwidth_share']:.2f} %",
        )
        for row in cases
    ]  # fmt: skip
    table = markdown(("strokes", "canvas", "forward s", "forward + backward s", "peak MB", "of bandwidth"), rows)
    return table + (
        "\n\n*Of bandwidth*: the time in which a plain copy on this device moves what any renderer must at least "
        "(canvas and image, their gradients, strokes and theirs), over the time taken."
    )


def _peer_table(peers: list[dict[str, Any]]) -> str:
    counts = sorted({point["strokes"] for peer in peers for point in peer["points"]})
    rows = []
    for peer in peers:
        known = {p["strokes"]: f"*{p['s']:g}*" if p["extrapolated"] else f"{p['s']:g}" for p in peer["points"]}
        rows.append((peer["name"], peer["canvas"], *(known.get(count, "–") for count in counts)))
    return markdown(("", "canvas", *(f"{count} strokes, s" for count in counts)), rows)


def _both(times: dict[str, Any]) -> str:
    return f"{times['median_s']:.5f} ({times['minimum_s']:.5f})"


def _mb(value: float | None) -> str:
    return "not measured" if value is None else f"{value:.1f}"
