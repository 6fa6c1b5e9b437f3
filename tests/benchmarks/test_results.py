"""What is made of the measurements: growth, bars, tables; and the clock and the memory gauge themselves."""

import re
import sys
import time
from dataclasses import asdict
from mmap import mmap
from typing import Any

import numpy as np
import pytest

from benchmarks import memory, planning
from benchmarks.__main__ import rounded
from benchmarks.bars import bars
from benchmarks.cases import CASES, OTHER_CASES, REFERENCE_CASES
from benchmarks.clock import in_turns, repeated
from benchmarks.growth import exponent, exponents, extrapolated
from benchmarks.peers import PEERS
from benchmarks.scenes import Case, strokes_and_canvas
from benchmarks.tables import page

_PAINTED = {"loss": 0.01, "executed": 0.02, "gap": 0.01, "paint_changes": 30}
PLANNER: dict[str, Any] = {
    "rows": [
        {
            "picture": "one", "seed": 1, "adam": {"loss": 0.02, "seconds": 9.0}, "speedup": 6.0, "lower_by": 0.1,
            "reaches_seconds": 1.5, "long": {"loss_at_equal_time": 0.018},
            "constant": {"loss": 0.03, "seconds": 8.0}, "reaches_constant_seconds": 2.0, "constant_speedup": 4.0,
            "paints": {
                "adam": _PAINTED | {"executed": 0.03, "gap": 0.02}, "adam_told": _PAINTED | {"executed": 0.019},
                "ours": _PAINTED,
            },
        }
    ],
    "summary": {
        "speedup": 6.0, "lower_by": 0.1, "constant_speedup": 4.0, "constant_lower_by": 0.5, "executed_lower_by": 1 / 3,
        "executed_lower_than_noise_aware_adam_by": -0.05,
    },
}  # fmt: skip


def times(seconds: float) -> dict[str, Any]:
    return {"median_s": seconds, "minimum_s": 0.9 * seconds, "runs": 5}


def row(case: Case, seconds: float, peak_mb: float | None = 10.0) -> dict[str, Any]:
    return asdict(case) | {"forward": times(seconds / 2), "forward_backward": times(seconds), "peak_mb": peak_mb}


def results(per_stroke_s: float = 2e-5, peak_mb: float | None = 10.0) -> dict[str, Any]:
    """Made up: time in proportion to strokes and to the canvas's width, halved by a second thread."""
    cases = [
        row(case, per_stroke_s * case.strokes * case.size_px / 256 / case.threads, peak_mb)
        for case in [*CASES, *OTHER_CASES]
    ]
    distance = {
        "strokes": 400, "points": 32, "size_px": 256, "evaluations": 1300, "touched": 1000,
        "evaluations_per_touched": 1.3, "fragments": 300, "kernel_ns_per_pair": 9.0, "limit_ns_per_pair": 6.0,
        "limit_from_memory_ns_per_pair": 12.0, "times_limit": 1.5, "times_least_work": 2.5,
        "packed_instructions": 94, "bytes_per_pair": 160,
    }  # fmt: skip
    return {
        "machine": {
            "cpu": "made up", "cores": 2, "memory_gb": 8, "gpu": None, "python": "3.11", "libraries": {"numpy": "2"},
        },
        "peers": PEERS,
        "cases": cases,
        "growth": exponents(cases),
        "reference": [row(case, 0.1 * case.strokes) for case in REFERENCE_CASES],
        "agreement": [{"values": 1e-7, "gradients": {"points": 1e-6, "radius": 1e-5}}],
        "distance": [distance],
        "hooks": {"no_mechanism_over": 0.05, "idle_mechanism_over": 0.2},
        "plan": [{"way": "ours", "s": 9.0}],
        "planner": PLANNER,
        "gpu": {"missing": "No GPU was at hand.", "cases": []},
    }  # fmt: skip


def test_a_power_law_has_its_exponent_and_a_line_its_continuation() -> None:
    sizes = [20, 100, 400]
    assert exponent(sizes, [3 * n**1.25 for n in sizes]) == pytest.approx(1.25)
    assert extrapolated([5, 10, 20], [0.5 + 0.1 * n for n in (5, 10, 20)], 400) == pytest.approx(40.5)


def test_growth_is_found_in_strokes_and_in_pixels() -> None:
    found = results()["growth"]
    assert {r["in"] for r in found} == {"strokes", "pixels"}
    for r in found:
        assert r["exponent"] == pytest.approx(r["far"]) == pytest.approx(1.0 if r["in"] == "strokes" else 0.5)


def test_bars_tell_what_is_met_from_what_is_not_and_from_what_is_unknown() -> None:
    met = {bar.what: bar.met for bar in bars(results())}
    assert met["400 strokes × 32 points, 256²"] is True and met["… speed-up by a second thread"] is True
    assert met["overhead of mechanism sites, without a mechanism"] is True
    assert met["overhead of mechanism sites, with an inactive one"] is False
    slow = {bar.what: bar for bar in bars(results(per_stroke_s=4e-5, peak_mb=None))}
    assert slow["400 strokes × 32 points, 256²"].met is False
    assert slow["… speed-up over the dense reference"].measured.startswith("2500 ×")
    unknown = slow["peak memory over baseline, 400 strokes × 32 points, 256²"]
    assert unknown.met is None and unknown.measured == "not measured"


def test_planner_bars_are_evaluated_one_by_one() -> None:
    plan, *against, painted, told = planning.bars(PLANNER, [{"way": "ours", "s": 9.0}])
    assert [bar.met for bar in (plan, *against, painted, told)] == [False, False, True, True, False, True, False]
    never = PLANNER | {"summary": PLANNER["summary"] | {"constant_speedup": 0.0}}
    assert planning.bars(never, [])[0].measured.startswith("never reached")
    assert "267 × as long" in plan.measured and painted.measured.startswith("1 of 1")
    assert told.measured.startswith("0 of 1; error -5 % lower")


def test_the_page_names_machine_and_every_case_and_its_tables_are_even() -> None:
    text = page(results())
    assert "made up; 2 cores, 8 GB" in text and "No GPU was at hand." in text
    assert text.count("| plain |") == len(CASES) and text.count("| pickup |") == 2
    for table in re.findall(r"(?:^\|.*\n)+", text, re.MULTILINE):
        assert len({line.count("|") for line in table.splitlines()}) == 1


def test_a_gpu_s_rows_stand_where_there_is_one() -> None:
    gpu_row = row(Case(400, 32, 512), 0.001) | {"bandwidth_share": 0.031}
    assert "| 400 | 512² |" in page(results() | {"gpu": {"missing": None, "cases": [gpu_row]}})
    assert "3.10 %" in page(results() | {"gpu": {"missing": None, "cases": [gpu_row]}})


def test_numbers_keep_four_digits_and_words_stay() -> None:
    assert rounded({"a": [1.23456e-3, 7], "b": "x", "c": float("inf")}) == {"a": [1.235e-3, 7], "b": "x", "c": None}


def test_strokes_are_as_long_and_wide_as_they_are_said_to_be() -> None:
    points, radius, _, _, _, canvas = strokes_and_canvas(Case(200, 32, 256))
    chord = (points[0, :, -1] - points[0, :, 0]).norm(dim=-1)
    assert chord.min() >= 20 and chord.max() <= 60 and chord.max() > 55
    assert radius.min() >= 1.5 and radius.max() <= 5 and canvas.shape == (1, 256, 256, 3)
    assert len(strokes_and_canvas(Case(3, 4, 64, kind="pickup"))) == 7


def test_the_clock_takes_turns_and_keeps_to_its_budget() -> None:
    order: list[str] = []
    slow, fast = in_turns([lambda: (order.append("a"), time.sleep(0.004)), lambda: order.append("b")], 4)
    assert order == ["a", "b"] * 4
    assert slow.minimum_s >= 0.004 > fast.minimum_s and slow.runs == 4
    assert repeated(lambda: time.sleep(0.01), budget_s=0.0, minimum=3).runs == 3
    assert repeated(lambda: None, budget_s=1.0, most=9).runs == 9


@pytest.mark.skipif(sys.platform != "linux", reason="Linux counts a process's peak memory")
def test_the_gauge_sees_memory_that_was_held_and_let_go() -> None:
    """Memory straight from the system: an allocator may give out what earlier tests let go and it never gave back."""
    before = memory.forget_peak()
    if before is None:
        pytest.skip("this system does not let a process reset its peak")
    with mmap(-1, 60_000_000) as held:
        np.frombuffer(held, np.uint8)[:] = 1
    assert 55e6 < memory.peak() - before < 80e6
    after = memory.forget_peak()
    assert after is not None and memory.peak() - after < 20e6
