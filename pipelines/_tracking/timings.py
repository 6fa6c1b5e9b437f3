"""How long each stage item took the last time, in `data/timings/` (untracked: times would change every hash)."""

import json
import time
from html import escape
from pathlib import Path
from typing import Any

from pentimento.contracts.atomic import atomic_write

TIMINGS = Path("data/timings")


def write_timing(name: str, run_id: str, seconds: float) -> None:
    """Keep what `name` (a stage, or stage@item) took, and the page of all."""
    TIMINGS.mkdir(parents=True, exist_ok=True)
    finished = time.strftime("%Y-%m-%d %H:%M:%S")
    timing = {"stage": name, "seconds": round(seconds, 2), "finished": finished, "run_id": run_id}
    atomic_write(TIMINGS / f"{name}.json", (json.dumps(timing, indent=2) + "\n").encode())
    timings = [json.loads(file.read_text()) for file in TIMINGS.glob("*.json")]
    atomic_write(TIMINGS / "index.html", _timings_page(timings).encode())


def _timings_page(timings: list[dict[str, Any]]) -> str:
    """Return a page with the latest execution of each stage item, as a table that needs nothing else."""
    rows = "\n".join(
        f"<tr><td>{escape(t['stage'])}<td class=n>{t['seconds']:.1f}<td>{t['finished']}<td>{t['run_id']}"
        for t in sorted(timings, key=lambda t: (t["finished"], t["stage"]))
    )
    total = sum(t["seconds"] for t in timings)
    return f"""<!doctype html><html lang=en><meta charset=utf-8><title>Timings</title>
<style>body{{font:15px/1.5 system-ui,sans-serif;color:#333;margin:0}} table{{border-collapse:collapse}}
td,th{{padding:.2em 1.2em .2em 0;text-align:left;border-bottom:1px solid #ddd}} .n{{text-align:right}}</style>
<table><tr><th>stage<th class=n>seconds<th>finished<th>MLflow run
{rows}
<tr><th>together<th class=n>{total:.1f}<th><th></table></html>
"""
