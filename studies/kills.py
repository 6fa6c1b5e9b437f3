"""Whether a killed stage leaves a partial output or ends with other bytes: `python -m studies.kills`.

In a copy of an up-to-date pipeline (``--pipeline``, by default the result of `make repro PROFILE=smoke`) every stage is
run again, first without interruption and then killed with SIGKILL at random times from its start to its end. After each
kill its outputs must be absent or complete. In the end it is left to finish: its outputs must equal those of the
pipeline byte for byte, with no other file beside them. The run without interruption also shows that forcing a stage
gives the same bytes.

A line for each stage goes to the screen and to ``--out``. Exit status 1 where anything differs.
"""

from __future__ import annotations

import argparse
import os
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pentimento.contracts.errors import PentimentoError
from pipelines._io import end_with_parent
from pipelines._params import read_yaml


@dataclass(frozen=True)
class Stage:
    """A stage of the pipeline as recorded in dvc.lock."""

    name: str
    command: tuple[str, ...]
    outs: tuple[str, ...]


def main() -> int:
    """Command line; the exit status."""
    parser = argparse.ArgumentParser(prog="python -m studies.kills", description=__doc__)
    parser.add_argument("--pipeline", type=Path, default=Path(".profiles/smoke"), help="with outputs up to date")
    parser.add_argument("--stages", nargs="+", metavar="STAGE", help="names as in dvc.lock; default: all")
    parser.add_argument("--times", type=int, default=200, help="kills of all stages together")
    parser.add_argument("--seed", type=int, default=0, help="of the times of the kills")
    parser.add_argument("--out", type=Path, default=Path("data/studies/kills.txt"))
    args = parser.parse_args()
    stages = stages_of(read_yaml(args.pipeline / "dvc.lock"), args.stages)
    args.out.parent.mkdir(parents=True, exist_ok=True)
    rng, differences, runs = np.random.default_rng(args.seed), list[str](), 0
    with tempfile.TemporaryDirectory() as temporary, args.out.open("w", encoding="utf-8") as file:

        def report(line: str) -> None:
            print(line, flush=True)
            print(line, file=file, flush=True)

        folder = Path(temporary) / "pipeline"
        shutil.copytree(args.pipeline, folder, ignore=shutil.ignore_patterns(".dvc", ".git", ".pentimento", ".venv"))
        for stage, times in zip(stages, split_evenly(args.times, len(stages)), strict=True):
            found, whole_s = kill_repeatedly(stage, args.pipeline, folder, times, rng)
            differences += [f"{stage.name}: {difference}" for difference in found]
            runs += times
            result = "; ".join(found) or "every byte is the same"
            report(f"{stage.name}: {whole_s:.1f} s, killed {times} times; {result}")
        report(f"{len(stages)} stages, {runs} kills, {len(differences)} differences.")
    return 1 if differences else 0


def stages_of(lock: dict[str, Any], names: Sequence[str] | None = None) -> list[Stage]:
    """The stages of a dvc.lock, all or those with these names.

    Raises:
        PentimentoError: there is no stage of a name.
    """
    known = list(lock["stages"])
    if unknown := set(names or ()) - set(known):
        raise PentimentoError(
            f"dvc.lock has no stage {', '.join(sorted(unknown))}; it has {', '.join(lock['stages'])}."
        )
    return [
        Stage(name, tuple(shlex.split(stage["cmd"])), tuple(out["path"] for out in stage["outs"]))
        for name, stage in lock["stages"].items()
        if names is None or name in names
    ]


def split_evenly(total: int, parts: int) -> list[int]:
    """Split the total into parts that differ by at most one, the larger ones first."""
    return [total // parts + (part < total % parts) for part in range(parts)]


def kill_repeatedly(
    stage: Stage, pipeline: Path, folder: Path, times: int, rng: np.random.Generator
) -> tuple[list[str], float]:
    """Run the stage in the folder: uninterrupted, then killed `times` times, then to its end.

    Returns the differences, as sentences, and the seconds of the uninterrupted run.
    """
    whole_s = execute(stage, folder, None)
    found = [f"without interruption, {difference}" for difference in compared(stage, pipeline, folder)]
    for kill in range(1, times + 1):
        execute(stage, folder, float(rng.uniform(0, whole_s)))
        present = [out for out in stage.outs if (folder / out).exists()]
        found += [
            f"after kill {kill}, {difference}"
            for out in present
            for difference in differing(pipeline / out, folder / out)
        ]
    execute(stage, folder, None)
    found += [f"in the end, {difference}" for difference in compared(stage, pipeline, folder)]
    beside = {file.name for out in stage.outs for file in (folder / out).parent.glob(".*.tmp")}
    return found + [f"{name} is left over" for name in sorted(beside)], whole_s


def compared(stage: Stage, pipeline: Path, folder: Path) -> list[str]:
    """The differences of the stage's outputs, all of which must exist."""
    return [
        f"{out}: {difference}"
        for out in stage.outs
        for difference in (differing(pipeline / out, folder / out) if contents(folder / out) else ["it is missing"])
    ]


def execute(stage: Stage, folder: Path, kill_at_s: float | None) -> float:
    """Remove the stage's outputs as DVC does, run it, kill it after `kill_at_s`, and return its seconds.

    Raises:
        PentimentoError: it failed without being killed.
    """
    for out in stage.outs:
        shutil.rmtree(folder / out, ignore_errors=True)
    command = [sys.executable if word == "python" else word for word in stage.command]
    environment = os.environ | {
        "PYTHONPATH": f"{folder}{os.pathsep}{folder / 'src'}",
        "MLFLOW_TRACKING_URI": f"sqlite:///{folder / 'mlflow.db'}",
    }
    began = time.perf_counter()
    with tempfile.TemporaryFile() as log:
        process = subprocess.Popen(
            command, cwd=folder, env=environment, stdout=log, stderr=log, preexec_fn=end_with_parent
        )
        try:
            status = process.wait(kill_at_s)
        except subprocess.TimeoutExpired:
            return time.perf_counter() - began
        finally:
            process.send_signal(signal.SIGKILL)
            process.wait()
        if status != 0:
            log.seek(0)
            output = log.read().decode(errors="replace")[-2000:]
            raise PentimentoError(f"{stage.name} failed without being killed ({status}): {output}")
    return time.perf_counter() - began


def differing(one: Path, other: Path) -> list[str]:
    """The differences of two folders, one sentence a file; empty where all bytes are equal."""
    first, second = contents(one), contents(other)
    found = [f"{name} is missing" for name in sorted(first.keys() - second.keys())]
    found += [f"{name} is not in the original" for name in sorted(second.keys() - first.keys())]
    return found + [f"{name} differs" for name in sorted(first.keys() & second.keys()) if first[name] != second[name]]


def contents(folder: Path) -> dict[str, bytes]:
    """All files below a folder."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


if __name__ == "__main__":
    sys.exit(main())
