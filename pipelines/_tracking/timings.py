"""The duration of each stage item's last run, in `data/timings/` (untracked: times would change every hash)."""

import json
import time
from pathlib import Path

from pentimento.contracts.atomic import atomic_write
from pentimento.report.templates import render

TIMINGS = Path("data/timings")
COMPARISONS = Path("data/comparisons")
"""Of pages that `pipelines.compare` writes; DVC does not know them either."""


def write_timing(name: str, run_id: str, seconds: float) -> None:
    """Write the duration of `name` (a stage, or stage@item), and the page of all."""
    TIMINGS.mkdir(parents=True, exist_ok=True)
    finished = time.strftime("%Y-%m-%d %H:%M:%S")
    timing = {"stage": name, "seconds": round(seconds, 2), "finished": finished, "run_id": run_id}
    atomic_write(TIMINGS / f"{name}.json", (json.dumps(timing, indent=2) + "\n").encode())
    timings = [json.loads(file.read_text(encoding="utf-8")) for file in TIMINGS.glob("*.json")]
    timings.sort(key=lambda each: (each["finished"], each["stage"]))
    atomic_write(TIMINGS / "index.html", render("timings.html", timings=timings).encode())
