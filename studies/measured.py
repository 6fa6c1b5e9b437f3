"""The diagnosis of photographed robot strokes, as a page: `python -m studies.measured`.

Reads `frida_strokes/*.parquet` in the folder that PENTIMENTO_MEASURED names; diagnoses each into
`data/studies/measured/<set>/` unless that has a verdict already; writes `docs/measured_strokes.md` and two figures.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq

from pentimento.contracts.errors import ConfigError
from pentimento.diagnosis.strokes.write import write_diagnosis

FIGURES_OF = ("brush_2022a", "sharpie_short")
DOCS = Path("docs")

_HEAD = """\
# The diagnosis of measured strokes

Written by `python -m studies.measured`; do not edit. The strokes were recorded by the authors of FRIDA and
Spline-FRIDA and are not part of this repository. Errors are of test strokes that took no part in search or
confirmation: mean squared, sRGB, over whole windows. No set repeats an action, so **the noise floor is unknown**, and
gains are shares of the whole error. ± is a standard error that takes each action as one witness. A *rival* is a cause
that removes at least 95 % as much error in the named one's place.

| set | strokes | established | suspected | error: base → extended | removed (95 %) | what still depends on what |
|---|---|---|---|---|---|---|
"""


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(prog="python -m studies.measured", description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("data/studies/measured"))
    args = parser.parse_args()
    folder = os.environ.get("PENTIMENTO_MEASURED")
    if not folder:
        raise ConfigError("PENTIMENTO_MEASURED names no folder; it must hold frida_strokes/*.parquet.")
    rows = []
    for path in sorted(Path(folder, "frida_strokes").glob("*.parquet")):
        out = args.out / path.stem
        if not (out / "verdict.json").exists():
            print(f"{path.stem} …", flush=True)
            write_diagnosis(pq.read_table(path), out, 0, log=lambda line: None)
        rows.append((path.stem, json.loads((out / "verdict.json").read_text())))
    for name in FIGURES_OF:
        target = DOCS / "measured"
        target.mkdir(parents=True, exist_ok=True)
        shutil.copy(args.out / name / "figures" / "strokes.png", target / f"{name}.png")
    (DOCS / "measured_strokes.md").write_text(page(rows))


def page(verdicts: list[tuple[str, dict[str, Any]]]) -> str:
    """The file, from each set's name and verdict."""
    lines = [_row(name, verdict) for name, verdict in verdicts]
    named = {name: {e["cause"] for e in v["established"]} for name, v in verdicts}
    pens = [name for name in named if name.startswith(("marker", "sharpie"))]
    brushes = [name for name in named if name not in pens]
    lag = [name for name in brushes if "bristle_lag" in named[name]]
    scale = [name for name in brushes if "path_scale" in named[name]]
    clear = [name for name in pens if not named[name] & {"bristle_lag", "path_scale"}]
    return (
        _HEAD
        + "\n".join(lines)
        + f"""

**Brushes and pens.** Of {len(brushes)} sets of brushes, `bristle_lag` is established on {len(lag)} ({_list(lag)}) and
`path_scale` on {len(scale)} ({_list(scale)}): ink falls short of its command and cuts corners. Pens are the negative
control, for a hard tip does not trail: neither is established on {len(clear)} of {len(pens)} sets ({_list(clear)}).

**What these tables cannot decide.** Strokes are recorded relative to their own start: nothing that depends on the place
on the canvas (`canvas_tilt`, `lens_distortion`, `vignetting`, `illumination_gradient`) or on how a stroke is turned
there (`path_offset`, `backlash`, `orientation_width`) can be seen, and of `path_scale` one factor only. There are no
times: neither `latency` nor any effect of speed can be distinguished from `bristle_lag`, which is therefore named for
what it is in space and not for its reason. Nothing crosses paint. Nothing is repeated, so it is unknown how much of
what is left is noise.

**What would settle it.** `next_actions.parquet` of each set: strongly bent strokes of different lengths, on which a
trailing patch cuts the corner and a shrunken path does not; and the same strokes at several speeds, several times.

Strokes of `{FIGURES_OF[0]}` that took no part (command, photograph, base, extended model, errors):

![{FIGURES_OF[0]}](measured/{FIGURES_OF[0]}.png)

and of `{FIGURES_OF[1]}`:

![{FIGURES_OF[1]}](measured/{FIGURES_OF[1]}.png)
"""
    )


def _row(name: str, verdict: dict[str, Any]) -> str:
    established = "; ".join(_entry(e) for e in verdict["established"]) or "–"
    removed = "; ".join(
        f"{e['gain']:.0%} ({e['gain_ci'][0]:.0%} to {e['gain_ci'][1]:.0%})" for e in verdict["established"]
    )
    left = "; ".join(f"{u['mode']} on {u['covariate']}" for u in verdict["unexplained"][:3]) or "nothing"
    error = f"{verdict['mse']['base']:.4f} → {verdict['mse']['extended']:.4f}"
    suspected = ", ".join(f"`{e['cause']}`" for e in verdict["suspected"]) or "–"
    return f"| {name} | {verdict['rows']} | {established} | {suspected} | {error} | {removed or '–'} | {left} |"


def _entry(entry: dict[str, Any]) -> str:
    numbers = ", ".join(f"{k} {v['value']:.3g} ± {v['se']:.1g}" for k, v in entry["parameters"].items() if v["se"] > 0)
    rivals = f"; rivals {', '.join(entry['rivals'])}" if entry["rivals"] else ""
    return f"`{entry['cause']}` ({numbers}{rivals})"


def _list(names: list[str]) -> str:
    return ", ".join(names) or "none"


if __name__ == "__main__":
    main()
