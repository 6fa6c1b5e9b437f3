"""Whether any killed stage leaves half an output or ends with other bytes: `python -m studies.kills_everywhere`.

In a copy of a pipeline that is up to date (``--pipeline``, by default what `make repro PROFILE=smoke` leaves) every
stage is run again, once in peace and then killed with SIGKILL at random moments from its start to its end. After each
kill its outputs must be gone or whole; in the end it is left to finish, and its outputs must have the bytes of those
in the pipeline, with nothing left beside them. That the run in peace has them, too, is what "two forced runs" means.

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
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pentimento.contracts.errors import PentimentoError
from pipelines._io import end_with_parent
from pipelines._params import read_yaml
from studies.kills import contents, differing


@dataclass(frozen=True)
class Stage:
    """A stage of the pipeline, as dvc.lock has it."""

    name: str
    command: tuple[str, ...]
    outs: tuple[str, ...]


def main() -> int:
    """Command line; the exit status."""
    parser = argparse.ArgumentParser(prog="python -m studies.kills_everywhere", description=__doc__)
    parser.add_argument("--pipeline", type=Path, default=Path(".profiles/smoke"), help="a folder that is up to date")
    parser.add_argument("--times", type=int, default=200, help="kills of all stages together")
    parser.add_argument("--seed", type=int, default=0, help="of the moments")
    parser.add_argument("--out", type=Path, default=Path("data/studies/kills_everywhere.txt"))
    given = parser.parse_args()
    stages = stages_of(read_yaml(given.pipeline / "dvc.lock"))
    given.out.parent.mkdir(parents=True, exist_ok=True)
    rng, differences, runs = np.random.default_rng(given.seed), list[str](), 0
    with tempfile.TemporaryDirectory() as temporary, given.out.open("w", encoding="utf-8") as file:

        def say(line: str) -> None:
            print(line, flush=True)
            print(line, file=file, flush=True)

        folder = Path(temporary) / "pipeline"
        shutil.copytree(given.pipeline, folder, ignore=shutil.ignore_patterns(".dvc", ".git", ".pentimento", ".venv"))
        for stage, times in zip(stages, shares(given.times, len(stages)), strict=True):
            found, whole_s = kill_again_and_again(stage, given.pipeline, folder, times, rng)
            differences += [f"{stage.name}: {difference}" for difference in found]
            runs += times
            said = "; ".join(found) or "every byte is the same"
            say(f"{stage.name}: {whole_s:.1f} s, killed {times} times; {said}")
        say(f"{len(stages)} stages, {runs} kills, {len(differences)} differences.")
    return 1 if differences else 0


def stages_of(lock: dict[str, Any]) -> list[Stage]:
    """The stages of a dvc.lock."""
    return [
        Stage(name, tuple(shlex.split(stage["cmd"])), tuple(out["path"] for out in stage["outs"]))
        for name, stage in lock["stages"].items()
    ]


def shares(total: int, parts: int) -> list[int]:
    """The total in parts that differ by one at most, the larger ones first."""
    return [total // parts + (part < total % parts) for part in range(parts)]


def kill_again_and_again(
    stage: Stage, pipeline: Path, folder: Path, times: int, rng: np.random.Generator
) -> tuple[list[str], float]:
    """Run the stage in the folder, in peace, then killed so often, then to its end; what differed, and its seconds."""
    whole_s = execute(stage, folder, None)
    found = [f"in peace, {difference}" for difference in compared(stage, pipeline, folder)]
    for kill in range(1, times + 1):
        execute(stage, folder, float(rng.uniform(0, whole_s)))
        there = [out for out in stage.outs if (folder / out).exists()]
        found += [
            f"after kill {kill}, {difference}"
            for out in there
            for difference in differing(pipeline / out, folder / out)
        ]
    execute(stage, folder, None)
    found += [f"in the end, {difference}" for difference in compared(stage, pipeline, folder)]
    beside = {file.name for out in stage.outs for file in (folder / out).parent.glob(".*.tmp")}
    return found + [f"{name} is left over" for name in sorted(beside)], whole_s


def compared(stage: Stage, pipeline: Path, folder: Path) -> list[str]:
    """What is not the same in the stage's outputs, all of which must be there."""
    return [
        f"{out}: {difference}"
        for out in stage.outs
        for difference in (differing(pipeline / out, folder / out) if contents(folder / out) else ["it is missing"])
    ]


def execute(stage: Stage, folder: Path, kill_at_s: float | None) -> float:
    """Remove the stage's outputs as DVC does, run it, kill it and what it started after so many seconds; its seconds.

    Raises:
        PentimentoError: it failed by itself.
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
            said = log.read().decode(errors="replace")[-2000:]
            raise PentimentoError(f"{stage.name} failed by itself ({status}): {said}")
    return time.perf_counter() - began


if __name__ == "__main__":
    sys.exit(main())
