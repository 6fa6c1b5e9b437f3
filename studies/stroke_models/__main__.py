"""Compare stroke models: `python -m studies.stroke_models [--strokes TABLE] [--seeds N] --out DIR`.

Without `--strokes`: the studio's marker and round brush (datasets A and B), and photographed robot strokes where
PENTIMENTO_MEASURED names a folder that holds `frida_strokes/*.parquet`; `docs/stroke_models.md` is then written from
all that is there. With `--strokes`, a table in the strokes contract: the same models, or `--models`, on a new brush, in
`DIR/page.md`.
Each model's result is kept in DIR as it is done, and is not done again.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

import pyarrow as pa
import pyarrow.parquet as pq
import torch

from pentimento.contracts.atomic import atomic_write
from pentimento.contracts.strokes import CONTRACT
from pentimento.contracts.tables import read_table
from pentimento.diagnosis.strokes.quarantine import usable_rows
from pentimento.dynamics.strokes.samples import sampling_of
from studies.stroke_models import figures, page
from studies.stroke_models.candidates import ANALYTIC, NAMES
from studies.stroke_models.compare import Results, compare, read_results
from studies.stroke_models.measured import BRUSHES, PENS, held_out_of, parts
from studies.stroke_models.studio import TOOLS, record_datasets

Key = TypeVar("Key", int, str)

OF_A, OF_A_TEST, OF_B = 160, 50, 50
"""Strokes of A that are trained on, strokes of A that are not, and strokes of B (Figure 4.8 has 50)."""
SIZES = (10, 20, 40, 80, 160, 440)
CURVE_SEED = 1
CURVE_MODELS = ("polyline", "param2stroke", "cnn", "coordconv", "traj2stroke", "refined")
"""Without mechanisms: to find them takes more strokes than the curve's small tables have."""
DOCS = Path("docs/stroke_models.md")
PICTURES = Path("docs/stroke_models")


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(prog="python -m studies.stroke_models", description=__doc__)
    parser.add_argument("--strokes", type=Path, help="a table in the strokes contract, file or folder")
    parser.add_argument("--models", nargs="+", choices=tuple(NAMES), default=tuple(NAMES), help="with --strokes")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--out", type=Path, default=Path("data/studies/stroke_models"))
    parser.add_argument("--only", choices=("studio", "measured", "curve", "page"), help="one part, then the page")
    args = parser.parse_args()
    torch.set_num_threads(1)
    if args.strokes:
        own(args.strokes, args.seeds, args.out, args.models)
        return
    parts_of = {"studio": studio, "measured": measured, "curve": curve}
    for name, do in parts_of.items():
        if args.only in (None, name):
            do(args.out, args.seeds)
    write_page(args.out)


def own(strokes: Path, seeds: int, out: Path, models: Sequence[str]) -> None:
    """A team's own table at the resolution that its lines need: every seed holds out another quarter of its actions."""
    table = usable_rows(read_table(strokes, CONTRACT).table).table
    sampling = sampling_of(table, "auto", "auto")
    config = replace(ANALYTIC, pixels_per_m=sampling.pixels_per_m, margin_m=sampling.margin_m)
    found = []
    for seed in range(1, seeds + 1):
        training, held_out = held_out_of(table, seed - 1)
        found.append(compare(training, {"own": held_out}, replace(config, seed=seed), out / f"seed_{seed}", models))
    pictures = out / "figures"
    figures.strokes(out / "seed_1", "own", pictures / "strokes.png")
    text = page.own_table(found, strokes.name, table.num_rows)
    atomic_write(out / "page.md", text.encode())
    print(text)


def datasets(out: Path, tool: str, seed: int, of_a: int) -> tuple[pa.Table, dict[str, pa.Table]]:
    """``of_a`` training strokes, and the tests; recorded once."""
    files = {name: out / "strokes" / f"{tool}_{seed}_{of_a}_{name}.parquet" for name in ("a", "b")}
    if not all(file.exists() for file in files.values()):
        made = record_datasets(tool, seed, of_a + OF_A_TEST, OF_B)
        for name, table in (("a", made.a), ("b", made.b)):
            files[name].parent.mkdir(parents=True, exist_ok=True)
            pq.write_table(table, files[name])
    a, b = (pq.read_table(file) for file in files.values())
    return a.slice(0, of_a), {"A": a.slice(of_a), "B": b}


def studio(out: Path, seeds: int) -> None:
    """Table 5.2: trained on A, tested on other strokes of A and on B."""
    for seed in range(1, seeds + 1):
        for tool in TOOLS:
            compare(*datasets(out, tool, seed, OF_A), replace(ANALYTIC, seed=seed), out / f"{tool}_{seed}")


def curve(out: Path, seeds: int) -> None:
    """Errors by the number of training strokes, one seed."""
    for tool in TOOLS:
        training, tests = datasets(out, tool, CURVE_SEED, max(SIZES))
        for size in SIZES:
            config, folder = replace(ANALYTIC, seed=CURVE_SEED), out / "curve" / f"{tool}_{size}"
            compare(training.slice(0, size), tests, config, folder, CURVE_MODELS)


def measured(out: Path, seeds: int) -> None:
    """Photographed strokes: every seed holds out another quarter of each set."""
    folder = os.environ.get("PENTIMENTO_MEASURED")
    if not folder:
        print("PENTIMENTO_MEASURED names no folder: the photographed strokes are left out.")
        return
    for seed in range(1, seeds + 1):
        for name in (*BRUSHES, *PENS):
            training, tests = parts(Path(folder, "frida_strokes"), name, seed - 1)
            compare(training, tests, replace(ANALYTIC, seed=seed - 1), out / "measured" / f"{name}_{seed}")


def write_page(out: Path) -> None:
    """Everything that there is in ``out``, as a page with figures."""
    tables = {tool: _all(_numbered(out / tool)) for tool in TOOLS}
    sets = {name: list(_all(_numbered(out / "measured" / name)).values()) for name in (*BRUSHES, *PENS)}
    sets = {name: runs for name, runs in sets.items() if runs}
    curves = {tool: _all({size: out / "curve" / f"{tool}_{size}" for size in SIZES}) for tool in TOOLS}
    PICTURES.mkdir(parents=True, exist_ok=True)
    for tool in TOOLS:
        if tables[tool]:
            figures.strokes(out / f"{tool}_1", "B", PICTURES / f"{tool}.png")
    for name in sets:
        figures.strokes(out / "measured" / f"{name}_1", "own", PICTURES / f"{name}.png")
    if any(tables.values()):
        figures.errors(tables, PICTURES / "errors.png")
    if any(curves.values()):
        figures.curves(curves, PICTURES / "curve.png")
    atomic_write(DOCS, page.whole(tables, sets, curves).encode())


def _numbered(folder: Path) -> dict[int, Path]:
    return {number: folder.with_name(f"{folder.name}_{number}") for number in range(1, 100)}


def _all(folders: dict[Key, Path]) -> dict[Key, Results]:
    """Results of the folders that have any."""
    return {key: found for key, folder in folders.items() if (found := read_results(folder))}


if __name__ == "__main__":
    main()
