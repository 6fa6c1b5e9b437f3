"""The planner's bars, from a part of what ``benchmarks.planner`` can measure: minutes, not a quarter of an hour."""

from typing import Any

from benchmarks import planner
from benchmarks.bars import Bar
from benchmarks.peers import FRIDA_PLAN_S

PICTURES, SEEDS = planner.PICTURES[:6], (1,)
_BASELINES = (
    ("adam", "plain Adam", "executed_lower_by"),
    ("adam_told", "plain Adam told what execution may take", "executed_lower_than_noise_aware_adam_by"),
)


def measure_planner(pictures: tuple[str, ...]) -> dict[str, Any]:
    """Rows of the pictures, and what the bars are about."""
    rows = planner.measure_all(pictures, SEEDS)
    return {"rows": rows, "summary": planner.summary(rows)}


def bars(measured: dict[str, Any], plans: list[dict[str, Any]]) -> list[Bar]:
    """Rows of the first table; ``plans`` as by ``measure_plan``."""
    summary, rows = measured["summary"], [row["paints"] for row in measured["rows"]]
    gaps = {who: sorted(row[who]["gap"] for row in rows)[len(rows) // 2] for who in ("adam", "adam_told", "ours")}
    names = {"thesis": "the thesis's way", "ours": "ours: error-guided, relocating, in 12 paints"}
    found = [
        Bar(
            f"a plan of 400 strokes × 400 iterations, 256² ({names[plan['way']]})", "≤ 8 s",
            f"{plan['s']:.1f} s (FRIDA about 40 min: {FRIDA_PLAN_S / plan['s']:.0f} × as long)", plan["s"] <= 8,
        )
        for plan in plans
    ]  # fmt: skip
    return [
        *found,
        *_against("plain Adam from random starts (constant rates)", summary, "constant_", len(rows)),
        *_against("the same with the best of its rates for each photograph and a cosine", summary, "", len(rows)),
        *(
            Bar(
                f"the better plan is the better painting, executed in the studio, beside {name}",
                f"{len(rows)} of {len(rows)}",
                f"{better} of {len(rows)}; error {100 * summary[lower]:.0f} % lower (median); "
                f"gap between painting and plan {gaps['ours']:.4f}, Adam's {gaps[who]:.4f}",
                better == len(rows),
            )
            for who, name, lower in _BASELINES
            for better in [sum(row["ours"]["executed"] < row[who]["executed"] for row in rows)]
        ),
    ]


def _against(who: str, summary: dict[str, float], which: str, pictures: int) -> list[Bar]:
    speedup, lower = summary[f"{which}speedup"], summary[f"{which}lower_by"]
    return [
        Bar(
            f"to the loss of {who} after 400 iterations", "≤ 1/5 of its time",
            f"{_share(speedup)} (median of {pictures} photographs)", speedup >= 5,
        ),
        Bar(f"loss at equal time, {who}", "≥ 20 % lower", f"{100 * lower:.0f} % (median)", lower >= 0.2),
    ]  # fmt: skip


def _share(speedup: float) -> str:
    return f"1/{speedup:.1f}" if speedup > 0 else "never reached"


def table(measured: dict[str, Any]) -> str:
    """One row a picture."""
    return planner.table(measured["rows"])
