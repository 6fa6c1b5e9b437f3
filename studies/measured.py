"""The diagnosis of recorded strokes, as a page: `python -m studies.measured`.

Reads `frida_strokes/*.parquet` and, by writer, `wacom_ballpoint_strokes.parquet` in the folder that PENTIMENTO_MEASURED
names. Each set is diagnosed into `data/studies/measured/<set>/`, and again on shares of its actions, unless the results
are there already. Writes `docs/measured_strokes.md` and two figures.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from pentimento.contracts.atomic import atomic_write
from pentimento.contracts.errors import ConfigError
from pentimento.diagnosis.diagnose import diagnose
from pentimento.diagnosis.strokes.measured import load_measured
from pentimento.diagnosis.strokes.problem import stroke_problem
from pentimento.diagnosis.strokes.quarantine import usable_rows
from pentimento.diagnosis.strokes.write import write_diagnosis
from pentimento.dynamics.strokes.mechanisms import VOCABULARY
from pentimento.dynamics.strokes.registration import register

FIGURES_OF = ("brush_2022a", "sharpie_short")
DOCS = Path("docs")
RESAMPLINGS = 5
KEPT = 0.8
"""Share of the actions in a resampling."""

_HEAD = """\
# The diagnosis of measured strokes

Written by `python -m studies.measured`; do not edit. The strokes were recorded by the authors of FRIDA and
Spline-FRIDA and are not part of this repository. Errors are mean squared, sRGB, over whole windows, on the test split,
which is not used in search or confirmation. No set repeats an action, so **the noise floor is unknown**, and *removed*
is a fraction of the whole error, with its 95 % interval. ± is a standard error, clustered by action. A *rival* is an
alternative cause that removes at least 95 % as much error in place of the named one. The counts after a cause are the
random subsamples of 80 % of the actions (of five) in which it is established, and in which it is established or
suspected. The last column lists the residual modes that still depend on a covariate.

| set | strokes | established | suspected | error: base → extended | removed (95 %) | remaining structure |
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
    for name, table in sets_in(Path(folder)).items():
        out = args.out / name
        if not (out / "verdict.json").exists():
            print(f"{name} …", flush=True)
            write_diagnosis(table, out, 0, log=lambda line: None)
        verdict = json.loads((out / "verdict.json").read_text())
        rows.append((name, verdict | {"resampled": [resampled(table, out, draw) for draw in range(RESAMPLINGS)]}))
    for name in FIGURES_OF:
        target = DOCS / "measured"
        target.mkdir(parents=True, exist_ok=True)
        shutil.copy(args.out / name / "figures" / "strokes.png", target / f"{name}.png")
    (DOCS / "measured_strokes.md").write_text(page(rows))


def sets_in(folder: Path) -> dict[str, pa.Table]:
    """Strokes by the name of the set. The ballpoint's were written by people, and are registered."""
    tables = {path.stem: pq.read_table(path) for path in sorted((folder / "frida_strokes").glob("*.parquet"))}
    pen = pq.read_table(folder / "wacom_ballpoint_strokes.parquet")
    for writer in sorted(set(pen["session"].to_pylist())):
        strokes = usable_rows(pen.filter(pc.equal(pen["session"], writer))).table
        tables[f"ballpoint_{writer}"] = register(strokes).table
    return tables


def resampled(table: pa.Table, out: Path, draw: int) -> dict[str, list[str]]:
    """Established and suspected causes of a share of the actions; kept in ``out``."""
    file = out / f"resampled_{draw}.json"
    if not file.exists():
        action = np.array(table["action_id"].to_pylist())
        actions = np.random.default_rng([draw, 61]).permutation(np.unique(action))
        kept = np.isin(action, actions[: round(KEPT * len(actions))])
        strokes = load_measured(usable_rows(table.filter(pa.array(kept))).table)
        found = diagnose(stroke_problem(strokes, VOCABULARY, draw), seed=draw, log=lambda line: None)
        parts = {"established": found.established, "suspected": found.suspected}
        names = {status: [finding.cause for finding in findings] for status, findings in parts.items()}
        atomic_write(file, json.dumps(names).encode())
    known: dict[str, list[str]] = json.loads(file.read_text())
    return known


def page(verdicts: list[tuple[str, dict[str, Any]]]) -> str:
    """The file, from each set's name and verdict."""
    lines = [_row(name, verdict) for name, verdict in verdicts]
    named = {name: {e["cause"] for e in v["established"]} for name, v in verdicts}
    pens = [name for name in named if name.startswith(("ballpoint", "marker", "sharpie"))]
    brushes = [name for name in named if name not in pens]
    lag = [name for name in brushes if "bristle_lag" in named[name]]
    scale = [name for name in brushes if "path_scale" in named[name]]
    clear = [name for name in pens if not named[name] & {"bristle_lag", "path_scale"}]
    return (
        _HEAD
        + "\n".join(lines)
        + f"""

**Brushes and pens.** Of {len(brushes)} sets of brushes, `bristle_lag` is established on {len(lag)} ({_list(lag)}) and
`path_scale` on {len(scale)} ({_list(scale)}): the mark is shorter than its command and cuts corners. Pens are the
negative control, because a hard tip does not trail: neither cause is established on
{len(clear)} of {len(pens)} sets ({_list(clear)}).

**What these tables cannot decide.** Strokes are recorded relative to their own start. Causes that depend on the place
on the canvas (`canvas_tilt`, `lens_distortion`, `vignetting`, `illumination_gradient`) or on the orientation of a
stroke (`path_offset`, `backlash`, `orientation_width`) are therefore not observable, and `path_scale` has one factor
for both axes. There are no times, so neither `latency` nor any effect of speed can be distinguished from `bristle_lag`:
the name states the effect in space, not its physical origin. No stroke crosses paint. No action is repeated, so the
noise in the remaining error is unknown.

The three ballpoint sets were written by people at three tempos, and have times, pressure and tilt. Each of their
strokes was registered to its ink by up to half a millimetre, so they cannot show what displaces a stroke.

**What to record next.** `next_actions.parquet` of each set: strongly bent strokes of different lengths, on which a
trailing contact patch cuts the corner and a scaled path does not; and the same strokes at several speeds, repeated.

Test strokes of `{FIGURES_OF[0]}` (command, photograph, base, extended model, errors):

![{FIGURES_OF[0]}](measured/{FIGURES_OF[0]}.png)

and of `{FIGURES_OF[1]}`:

![{FIGURES_OF[1]}](measured/{FIGURES_OF[1]}.png)
"""
    )


def _row(name: str, verdict: dict[str, Any]) -> str:
    established = "; ".join(_entry(e) + _again(e["cause"], verdict["resampled"]) for e in verdict["established"]) or "–"
    removed = "; ".join(
        f"{e['gain']:.0%} ({e['gain_ci'][0]:.0%} to {e['gain_ci'][1]:.0%})" for e in verdict["established"]
    )
    left = "; ".join(f"{u['mode']} on {u['covariate']}" for u in verdict["unexplained"][:3]) or "nothing"
    error = f"{verdict['mse']['base']:.4f} → {verdict['mse']['extended']:.4f}"
    suspected = ", ".join(f"`{e['cause']}`{_again(e['cause'], verdict['resampled'])}" for e in verdict["suspected"])
    suspected = suspected or "–"
    return f"| {name} | {verdict['rows']} | {established} | {suspected} | {error} | {removed or '–'} | {left} |"


def _entry(entry: dict[str, Any]) -> str:
    numbers = ", ".join(f"{k} {v['value']:.3g} ± {v['se']:.1g}" for k, v in entry["parameters"].items() if v["se"] > 0)
    rivals = f"; rivals {', '.join(entry['rivals'])}" if entry["rivals"] else ""
    return f"`{entry['cause']}` ({numbers}{rivals})"


def _again(cause: str, draws: list[dict[str, list[str]]]) -> str:
    """In how many resamplings a cause is established, and in how many at least suspected."""
    sure = sum(cause in draw["established"] for draw in draws)
    named = sum(cause in draw["established"] + draw["suspected"] for draw in draws)
    return f" {sure}, {named} of {len(draws)}"


def _list(names: list[str]) -> str:
    return ", ".join(names) or "none"


if __name__ == "__main__":
    main()
