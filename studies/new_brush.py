"""What a brush that nobody trained on takes, from `pentimento new` to a painting: `python -m studies.new_brush`.

For each seed a brush is drawn: its size, bundle and paint, the arm, the sheet, the camera, and a strength for every
effect that a dipped round brush can have. It is set up in a copy of a pipeline that is up to date (``--pipeline``),
which gets only its tool file, and painted with by the commands of docs/new_brush.md. The error of
its painting stands beside that of the brush it follows, which was developed for, and beside a blank sheet's.

A table goes to the screen and to ``--out``. Exit status 1 where a brush misses a bar.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from pentimento.contracts.errors import PentimentoError
from pentimento.studio.strokes.world import Effects, World, load_world
from pipelines._io import end_with_parent, write_json
from studies.blind.strokes.worlds import CAUSES, misshapen, with_nuisances, without_effects

NAME, LIKE, SETTING = "drawn_brush", "round_brush", "colour"
STAGES = ("collect_strokes", "train_stroke_dynamics", "diagnose_gap", "paint")
SECONDS, WORSE = 600.0, 0.2
"""Bars: time from `pentimento new` to the painting, and by how much its error may exceed the other brush's."""


@dataclass(frozen=True)
class Painted:
    """What came of a drawn brush. Errors are those of the paint stage, after replanning."""

    seed: int
    size: float
    """Of the brush that it follows."""
    seconds: float
    causes: tuple[str, ...]
    """By which its model was extended."""
    error: float
    usual: float
    """The brush that it follows, in its own world."""
    blank: float

    @property
    def met(self) -> bool:
        """Whether it is within both bars."""
        return self.seconds <= SECONDS and self.error <= (1 + WORSE) * self.usual


def main() -> int:
    """Command line; the exit status."""
    parser = argparse.ArgumentParser(prog="python -m studies.new_brush", description=__doc__)
    parser.add_argument("--pipeline", type=Path, default=Path(), help="a folder that is up to date")
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3], help="a brush each")
    parser.add_argument("--out", type=Path, default=Path("data/studies/new_brush.json"))
    args = parser.parse_args()
    brushes = []
    for seed in args.seeds:
        with tempfile.TemporaryDirectory() as temporary:
            brushes.append(paint_with(seed, args.pipeline.resolve(), Path(temporary) / "pipeline"))
        print(line(brushes[-1]), flush=True)
    args.out.parent.mkdir(parents=True, exist_ok=True)
    write_json(args.out, {"brushes": [asdict(brush) for brush in brushes]})
    return 0 if all(brush.met for brush in brushes) else 1


def line(brush: Painted) -> str:
    """A row of the table in docs/new_brush.md."""
    return (
        f"| {brush.seed} | {brush.size:.2f} | {brush.seconds / 60:.1f} min | {', '.join(brush.causes) or 'none'} "
        f"| {brush.error:.4f} | {brush.error / brush.usual - 1:+.0%} | {brush.blank:.4f} |"
    )


def drawn_brush(seed: int) -> tuple[World, float]:
    """The hidden truth of a brush, and its size beside the brush that it follows."""
    rng = np.random.default_rng([seed, 2])
    size = float(rng.uniform(0.8, 1.25))
    strengths = {field.name: 0.0 for field in fields(Effects)}
    strengths |= {cause: float(rng.uniform(0.0, 0.8)) for cause in CAUSES[LIKE]}
    world = misshapen(with_nuisances(without_effects(load_world(LIKE)), rng), rng)
    tool = world.tool
    tool = replace(
        tool,
        name=NAME,
        half_width_m=tool.half_width_m * size,
        half_thickness_m=tool.half_thickness_m * size,
        bristle_radius_m=tool.bristle_radius_m * size,
        dome_m=tool.dome_m * size,
        capacity_m2=tool.capacity_m2 * size**2,
    )
    return replace(world, tool=tool, effects=Effects(**strengths)), size


def world_text(world: World) -> str:
    """A world file that says everything."""
    lines = []
    for section, values in asdict(world).items():
        lines += [f"[{section}]", *(f"{key} = {json.dumps(value)}" for key, value in values.items()), ""]
    return "\n".join(lines)


def tool_text(followed: str, size: float) -> str:
    """What a ruler says of a brush so much larger than the one whose tool file is args."""
    changed = {
        f'name = "{LIKE}"': f'name = "{NAME}"',
        'nominal_width = "7 mm"': f'nominal_width = "{7 * size:.1f} mm"',
        '["0.3 mm", "4 mm"]': f'["0.3 mm", "{4 * size:.1f} mm"]',
    }
    for before, after in changed.items():
        if before not in followed:
            raise PentimentoError(f"The tool file of {LIKE} no longer says {before}; correct tool_text in this study.")
        followed = followed.replace(before, after)
    return followed


def paint_with(seed: int, pipeline: Path, folder: Path) -> Painted:
    """Set the brush up in a copy of the pipeline in ``folder``, teach it, and paint."""
    world, size = drawn_brush(seed)
    usual = _metrics(pipeline / f"data/paintings/{SETTING}")["error"]
    unneeded = shutil.ignore_patterns(".git", ".venv", ".profiles", ".pentimento", "cache", "tmp", "data", "mlflow*")
    shutil.copytree(pipeline, folder, ignore=unneeded)
    (folder / ".dvc/config.local").write_text("[core]\n    no_scm = true\n")
    tool, hidden = folder.with_name("tool.toml"), folder.with_name("hidden.toml")
    tool.write_text(tool_text((folder / f"src/pentimento/robots/tools/{LIKE}.toml").read_text(), size))
    hidden.write_text(world_text(world))
    began = time.perf_counter()
    new = ["pentimento.cli.main", "new", "tool", NAME, "--like", LIKE, "--tool-file", str(tool), "--world", str(hidden)]
    _run(new, folder)
    _run(["dvc", "repro", "-s", *(f"{stage}@{NAME}" for stage in STAGES)], folder)
    seconds = time.perf_counter() - began
    error = _metrics(folder / f"data/paintings/{NAME}")["error"]
    verdict = json.loads((folder / f"data/gap/{NAME}/verdict.json").read_text())
    causes = tuple(cause["cause"] for cause in verdict["established"])
    return Painted(
        seed, size, seconds, causes, error["with_replanning"], usual["with_replanning"], error["blank"]
    )  # fmt: skip


def _metrics(folder: Path) -> dict[str, Any]:
    try:
        metrics: dict[str, Any] = json.loads((folder / "metrics.json").read_text())
    except FileNotFoundError:
        raise PentimentoError(f"There is no painting in {folder}; run `make repro` first.") from None
    return metrics


def _run(module: list[str], folder: Path) -> None:
    """Run a module of Python in the folder, with the folder's code.

    Raises PentimentoError with what it said last, where it fails.
    """
    environment = os.environ | {
        "PYTHONPATH": f"{folder}{os.pathsep}{folder / 'src'}",
        "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
        "MLFLOW_TRACKING_URI": f"sqlite:///{folder / 'mlflow.db'}",
    }
    ran = subprocess.run(
        [sys.executable, "-m", *module], cwd=folder, env=environment, capture_output=True, text=True, check=False,
        preexec_fn=end_with_parent,
    )  # fmt: skip
    if ran.returncode != 0:
        said = (ran.stdout + ran.stderr)[-2000:]
        raise PentimentoError(f"`python -m {' '.join(module)}` failed ({ran.returncode}): {said}")


if __name__ == "__main__":
    sys.exit(main())
