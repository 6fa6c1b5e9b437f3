"""The targets of the renderer, each with its measurement."""

from collections.abc import Callable
from typing import Any, NamedTuple

from benchmarks.growth import extrapolated, picked
from benchmarks.peers import FRIDA_MB, FRIDA_S, SPLINE_FRIDA_MB, SPLINE_FRIDA_S

Results = dict[str, Any]


class Bar(NamedTuple):
    """One row of the first table."""

    what: str
    bar: str
    measured: str
    met: bool | None
    """None: not measured here."""


def bars(results: Results) -> list[Bar]:
    """The renderer's rows, in the order in which they were asked for; the planner's are in ``planning``."""
    return [
        *_time_bars(results),
        *_memory_and_growth(results),
        *_agreement(results),
        *_limit(results),
        *_hooks(results),
    ]


def seconds(results: Results, strokes: int, points: int, size_px: int, threads: int = 1) -> float:
    """Forward + backward of a plain case: the fastest run, what it takes when nothing else is running."""
    return float(_case(results, strokes, points, size_px, threads)["forward_backward"]["minimum_s"])


def reference_seconds(results: Results, points: int, strokes: int) -> float:
    """Of the dense reference at 256²: the straight line through what was measured."""
    rows = picked(results["reference"], points=points, size_px=256)
    return extrapolated(
        [row["strokes"] for row in rows], [row["forward_backward"]["minimum_s"] for row in rows], strokes
    )


def _case(results: Results, strokes: int, points: int, size_px: int, threads: int) -> dict[str, Any]:
    [row] = picked(
        results["cases"], strokes=strokes, points=points, size_px=size_px, threads=threads, kind="plain"
    )  # fmt: skip
    return row


def _at_most(what: str, value: float, bar: float, say: Callable[[float], str], more: str = "") -> Bar:
    return Bar(what, f"≤ {say(bar)}", say(value) + more, value <= bar)


def _at_least(what: str, value: float, bar: float, say: Callable[[float], str], more: str = "") -> Bar:
    return Bar(what, f"≥ {say(bar)}", say(value) + more, value >= bar)


def _s(value: float) -> str:
    return f"{value:.5f} s" if value < 1 else f"{value:.1f} s"


def _times(value: float) -> str:
    return f"{value:.3g} ×" if value < 1000 else f"{value:.0f} ×"


def _time_bars(results: Results) -> list[Bar]:
    ours = seconds(results, 400, 32, 256)
    peers = f" ({FRIDA_S / ours:.0f} × faster than FRIDA, about {SPLINE_FRIDA_S / ours:.0f} × faster than Spline-FRIDA)"
    dense = reference_seconds(results, 32, 400)
    [at_20] = picked(results["reference"], points=32, size_px=256, strokes=20)
    more = f" (extrapolated: {dense:.0f} s; at 20 strokes, measured: "
    more += f"{at_20['forward_backward']['minimum_s'] / seconds(results, 20, 32, 256):.0f} ×)"
    return [
        _at_most("400 strokes × 32 points, 256²", ours, 0.012, _s, peers),
        _at_least("… speed-up over the dense reference", dense / ours, 1000, _times, more),
        _at_least("… speed-up by a second thread", ours / seconds(results, 400, 32, 256, 2), 1.7, _times),
        _at_most("20 strokes × 32 points, 256²", seconds(results, 20, 32, 256), 0.0008, _s),
        _at_most("100 strokes × 32 points, 256²", seconds(results, 100, 32, 256), 0.004, _s),
        _at_most("400 strokes × 4 points, 256²", seconds(results, 400, 4, 256), 0.006, _s),
        _at_most("4000 strokes × 32 points, 1024²", seconds(results, 4000, 32, 1024), 0.15, _s),
    ]


def _memory_and_growth(results: Results) -> list[Bar]:
    peak = _case(results, 400, 32, 256, 1)["peak_mb"]
    what, bar = "peak memory over baseline, 400 strokes × 32 points, 256²", 40.0
    if peak is None:
        memory = Bar(what, f"≤ {bar:.0f} MB", "not measured", None)
    else:
        peers = f" (FRIDA {FRIDA_MB} MB, Spline-FRIDA about {SPLINE_FRIDA_MB} MB)"
        memory = _at_most(what, peak, bar, "{:.1f} MB".format, peers)
    rows = picked(results["growth"], **{"in": "strokes"})
    fit, far = max(row["exponent"] for row in rows), max(row["far"] for row in rows)
    more = f" (largest fit over 400 to 4000 strokes; over 20 to 4000: {fit:.2f})"
    return [memory, _at_most("exponent of the time over the number of strokes", far, 1.1, "{:.2f}".format, more)]


def _agreement(results: Results) -> list[Bar]:
    rows = results["agreement"]
    gradients = [(value, name) for row in rows for name, value in row["gradients"].items()]
    worst, name = max(gradients)
    return [
        _at_most(
            "maximum difference from the reference: values", max(r["values"] for r in rows), 1e-5, "{:.1e}".format
        ),
        _at_most("… gradients, norm of the difference over the norm", worst, 1e-4, "{:.1e}".format, f" ({name})"),
    ]


def _limit(results: Results) -> list[Bar]:
    found = []
    for row in results["distance"]:
        name = f"{row['strokes']} strokes × {row['points']} points, {row['size_px']}²"
        kernel, limit = row["kernel_ns_per_pair"], row["limit_ns_per_pair"]
        more = f" ({kernel:.1f} ns and {limit:.1f} ns)"
        found += [
            _at_most(
                f"time per pair over that of a loop without branches, {name}", row["times_limit"], 2.0, _times, more
            ),
            _at_most(f"evaluated pairs over pairs with ink, {name}", row["evaluations_per_touched"], 1.5, _times),
        ]
    return found


def _hooks(results: Results) -> list[Bar]:
    hooks = results["hooks"]
    return [
        _at_most(f"overhead of mechanism sites, {what}", 100 * hooks[key], 10.0, "{:.1f} %".format)
        for what, key in (("without a mechanism", "no_mechanism_over"), ("with an inactive one", "idle_mechanism_over"))
    ]
