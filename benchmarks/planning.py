"""The targets of the planner, measured on fewer pictures than ``benchmarks.planner`` uses: some minutes."""

from typing import Any

from benchmarks import planner
from benchmarks.bars import Bar
from benchmarks.peers import FRIDA_PLAN_S

PICTURES, SEEDS = planner.PICTURES[:6], (1,)
_BASELINES = (
    ("adam", "plain Adam", "executed_lower_by"),
    ("adam_told", "plain Adam with execution noise", "executed_lower_than_noise_aware_adam_by"),
)


def measure_planner(pictures: tuple[str, ...]) -> dict[str, Any]:
    """Rows of the pictures, and the summary that the targets refer to."""
    rows = planner.measure_all(pictures, SEEDS)
    return {"rows": rows, "summary": planner.summary(rows)}


def bars(measured: dict[str, Any], plans: list[dict[str, Any]]) -> list[Bar]:
    """Rows of the first table; ``plans`` as by ``measure_plan``."""
    summary, rows = measured["summary"], [row["paints"] for row in measured["rows"]]
    gaps = {who: sorted(row[who]["gap"] for row in rows)[len(rows) // 2] for who in ("adam", "adam_told", "ours")}
    names = {"thesis": "as in the thesis", "ours": "ours: error-guided, with relocation, 12 paints"}
    found = [
        Bar(
            f"a plan of 400 strokes × 400 iterations, 256² ({names[plan['way']]})", "≤ 8 s",
            f"{plan['s']:.1f} s (FRIDA about 40 min, {FRIDA_PLAN_S / plan['s']:.0f} × as long)", plan["s"] <= 8,
        )
        for plan in plans
    ]  # fmt: skip
    return [
        *found,
        *_against("plain Adam from random starts, constant rates", summary, "constant_", len(rows)),
        *_against(
            "plain Adam from random starts, best rate of each photograph, cosine schedule", summary, "", len(rows)
        ),
        *(
            Bar(
                f"painting executed in the studio: lower error than {name}",
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
            f"time to the loss of {who}, after 400 iterations", "≤ 1/5 of its time",
            f"{_share(speedup)} (median of {pictures} photographs)", speedup >= 5,
        ),
        Bar(f"loss at equal time: below {who}", "≥ 20 % lower", f"{100 * lower:.0f} % (median)", lower >= 0.2),
    ]  # fmt: skip


def _share(speedup: float) -> str:
    return f"1/{speedup:.1f}" if speedup > 0 else "never reached"


def table(measured: dict[str, Any]) -> str:
    """One row a picture."""
    return planner.table(measured["rows"])
