"""The results as Markdown: targets first, then all measurements."""

from collections.abc import Iterable, Sequence
from typing import Any

from benchmarks import planning
from benchmarks.bars import Bar, Results, bars, reference_seconds, seconds
from benchmarks.growth import picked
from benchmarks.peers import WHERE

_MET = {True: "yes", False: "**no**", None: "–"}
_INTRODUCTION = """\
Written by `make bench`; do not edit. Inputs are random strokes of 20 to 60 px length with radii of 1.5 to 5 px on
square canvases, in float32. Times are wall times of `render_strokes` called through PyTorch's autograd: medians of
several runs after compilation. *Backward* computes the gradients of all inputs, including the canvas. One thread is
used unless stated otherwise. Every case runs in its own process. Targets are compared with the fastest run, which
is the least affected by other load. The speed of this machine changes by half from minute to minute, as the medians
below show."""
_REFERENCE = """\
The dense reference in PyTorch evaluates every segment at every pixel, stroke after stroke. Its time and memory grow
linearly with the number of strokes. Values in italics are extrapolated by the straight line through 5, 10 and 20
strokes. *Ours* is this renderer with the same inputs."""
_LIMIT = """\
*Evaluated* is the number of pairs of pixel and segment that remain after culling. *With ink* is the number of pairs
with D < R + ½, counted by testing every segment at every pixel. The renderer processes columns in blocks of 16. Lanes
beyond the end of a segment are not counted as evaluated, but their time is included.

*Ours* is the time of `render` and `render_backward`, called directly, per evaluated pair. It includes culling,
allocation and composition. *Loop* is the lower limit: a loop without branches and look-ups computes coverage,
composition and all gradients of as many pairs, whose data lie contiguously in the processor's cache. The compiler
made {packed} packed instructions of it. The loop computes composition and gradients of every pair; the renderer
needs them only where a pair is the *winner* of its pixel. *Ours over minimal work* divides by the time of loops
that also do this only for winners, and is therefore the stricter ratio. *From memory* is the loop over data that
exceed the cache ({bytes} bytes a pair)."""

_PLANNER = """\
Each photograph has 315 × 210 px and gets 400 strokes. The planner is compared with plain Adam from random starts:
with the best of three learning rates and a cosine schedule, and with constant rates. Times are seconds on one
thread. *Told* is Adam with the planner's model of execution noise: random thinning of strokes at each iteration.
`python -m benchmarks.planner` measures more pictures and a second seed."""


def page(results: Results) -> str:
    """The whole file."""
    sections = [
        "# Benchmarks",
        _INTRODUCTION,
        machine_line(results["machine"]),
        "## Targets",
        bar_table([*bars(results), *planning.bars(results["planner"], results["plan"])]),
        f"Peers' figures were measured on other machines: {WHERE}. The targets in seconds are for such a machine.",
        "## Compared with the dense reference",
        _REFERENCE,
        _reference_table(results),
        "## Compared with the machine's limit",
        _LIMIT.format(
            packed=results["distance"][0]["packed_instructions"], bytes=results["distance"][0]["bytes_per_pair"]
        ),
        _distance_table(results),
        "## Growth",
        "Exponents of the time of forward + backward on one thread: a least-squares fit in log-log over all sizes, and "
        "over the three largest, where fixed costs matter least.",
        _growth_table(results["growth"]),
        "## On a GPU",
        _gpu(results["gpu"]),
        "## The planner",
        _PLANNER,
        planning.table(results["planner"]),
        "## All cases",
        "Peak memory is the maximum of the process during forward + backward, without inputs and libraries. Times in "
        "brackets are those of the fastest run.",
        _case_table(results["cases"]),
        "## Other renderers",
        f"Forward + backward, measured on other machines ({WHERE}). Values in italics are extrapolated.",
        _peer_table(results["peers"]),
    ]
    return "\n\n".join(sections) + "\n"


def bar_table(rows: Sequence[Bar]) -> str:
    """The first table."""
    return markdown(
        ("", "target", "measured", "met?"), [(row.what, row.bar, row.measured, _MET[row.met]) for row in rows]
    )


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
    head = ("strokes", "points", "canvas", "dense reference s", "dense reference peak MB", "ours s", "ratio")
    return markdown(head, rows)


def _distance_table(results: Results) -> str:
    head = (
        "strokes", "points", "evaluated", "with ink", "ratio", "winners", "ours ns/pair", "loop ns/pair", "ratio",
        "ours over minimal work", "from memory ns/pair",
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
    return markdown(("size", "points", "fixed", "exponent", "exponent, three largest"), rows)


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
        "\n\n*Of bandwidth* is the time of a plain copy of the minimal data (canvas, image, strokes and their "
        "gradients) on this device, divided by the measured time."
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
