"""`make bench`: measure, print the tables, and write them to docs/benchmarks.md and docs/benchmarks.json."""

import json
import math
import sys
import time
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any, TypeVar

from benchmarks import agreement, cases, children, distance, gpu, growth, hooks, machine, peers, plan, planning, tables
from benchmarks.bars import Results
from benchmarks.scenes import Case

_C = TypeVar("_C")
DOCS = Path(__file__).resolve().parents[1] / "docs"
LIMIT_CASES = [Case(400, 32, 256), Case(400, 4, 256)]
AGREEMENT_CASES = [Case(8, 32, 256), Case(20, 4, 256)]


def main() -> None:
    """Measure everything; minutes."""
    with children.start() as pool:
        results = measure_all(pool)
    DOCS.mkdir(exist_ok=True)
    text = tables.page(results)
    (DOCS / "benchmarks.json").write_text(json.dumps(rounded(results), indent=1, ensure_ascii=False) + "\n")
    (DOCS / "benchmarks.md").write_text(text)
    print(text)


def measure_all(pool: ProcessPoolExecutor) -> Results:
    """Every section of the results, each measurement in its own process."""
    results: Results = {"machine": machine.describe(), "peers": peers.PEERS}
    results["hooks"] = children.measure(pool, hooks.measure_hooks, Case(400, 32, 256))
    results["distance"] = _each(pool, "distance to the limit", distance.measure_distance, LIMIT_CASES)
    results["cases"] = _each(pool, "renderer", cases.measure_ours, [*cases.CASES, *cases.OTHER_CASES])
    results["growth"] = growth.exponents(results["cases"])
    results["reference"] = _each(pool, "dense reference", cases.measure_reference, cases.REFERENCE_CASES)
    results["agreement"] = _each(pool, "agreement", agreement.measure_agreement, AGREEMENT_CASES)
    results["plan"] = _each(pool, "plan", plan.measure_plan, plan.WAYS)
    results["planner"] = children.measure(pool, planning.measure_planner, planning.PICTURES)
    missing = gpu.missing()
    results["gpu"] = {
        "missing": missing,
        "cases": _each(pool, "GPU", gpu.measure_gpu, gpu.CASES if missing is None else []),
    }
    return results


def _each(
    pool: ProcessPoolExecutor, what: str, function: Callable[[_C], dict[str, Any]], wanted: Iterable[_C]
) -> list[dict[str, Any]]:
    rows = []
    started = time.perf_counter()
    for case in wanted:
        rows.append(children.measure(pool, function, case))
        print(f"{time.perf_counter() - started:5.0f} s  {what}: {case}", file=sys.stderr, flush=True)
    return rows


def rounded(value: Any) -> Any:
    """With four significant digits, more than repeat from run to run; null for what never came about."""
    match value:
        case float() if not math.isfinite(value):
            return None
        case float():
            return float(f"{value:.4g}")
        case dict():
            return {key: rounded(entry) for key, entry in value.items()}
        case list():
            return [rounded(entry) for entry in value]
        case _:
            return value


if __name__ == "__main__":
    main()
