"""Paint from the bundle with the lean runner, in the studio and in processes without PyTorch."""

import argparse
import json
import shutil
import subprocess
import sys
import tempfile
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from pentimento.contracts.errors import PentimentoError
from pentimento.contracts.ranges import at_least
from pipelines import _runner_process
from pipelines._config import load_section
from pipelines._io import output_folder, stage_main, write_json
from pipelines._tracking import tracked_run

PICTURES = ("goal.png", "plan.png", "canvas.png")
"""What is kept of a painting's folder: what was aimed at, what was foretold at first, what came of it."""


@dataclass(frozen=True)
class Performance:
    """One painting."""

    setting: str
    """Of the bundle."""
    words: str | None
    """What a person asks for, on a blank sheet; null: the photograph of the workshop's painting of this setting."""
    strokes: int

    def __post_init__(self) -> None:
        at_least(self, 1, "strokes")


@dataclass(frozen=True)
class RunBundle:
    """Section `run_bundle` of params.yaml."""

    seed: int
    """Of plans, goals and the studio."""
    paintings: dict[str, Performance]

    def __post_init__(self) -> None:
        at_least(self, 0, "seed")


def main(arguments: argparse.Namespace) -> None:
    """Write `--out`: a folder of pictures for each painting, and metrics.json."""
    config = load_section(Path("params.yaml"), "run_bundle", RunBundle)
    with (
        tracked_run("run_bundle", None, asdict(config), {"bundle": arguments.bundle}) as run,
        output_folder(arguments.out) as out,
    ):
        metrics = {
            name: _perform(performance, config.seed, arguments.bundle, arguments.paintings, out / name)
            for name, performance in config.paintings.items()
        }
        write_json(out / "metrics.json", metrics)
        run.log_metrics(metrics)
        for name in config.paintings:
            run.log_picture(out / name / "canvas.png")


def _perform(performance: Performance, seed: int, bundle: Path, paintings: Path, out: Path) -> dict[str, Any]:
    """Strokes and errors of one painting, whose pictures are in ``out`` then."""
    workshop = paintings / performance.setting
    command = [
        "--bundle", str(bundle), "--setting", performance.setting, "--strokes", str(performance.strokes),
        "--seed", str(seed),
    ]  # fmt: skip
    if performance.words is None:
        command += ["--picture", str(workshop / "photograph.png")]
    else:
        command += ["--words", performance.words]
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / "painting"
        done = subprocess.run(
            [sys.executable, "-m", _runner_process.__name__, *command, "--out", str(folder)],
            capture_output=True, text=True,
        )  # fmt: skip
        if done.returncode:
            raise PentimentoError(f"The runner failed in setting {performance.setting}: {done.stderr.strip()[-2000:]}")
        out.mkdir()
        for picture in PICTURES:
            shutil.copy(folder / picture, out / picture)
        found: dict[str, Any] = json.loads((folder / "painting.json").read_text())
    told: dict[str, Any] = asdict(performance) | {"strokes": found["strokes"], "error": found["error"]}
    if performance.words is None:
        own = json.loads((workshop / "metrics.json").read_text())
        told["workshop"] = {"strokes": own["strokes"], "error": own["error"]["with_replanning"]}
    return told


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="run_bundle", description=__doc__)
    parser.add_argument("--bundle", required=True, type=Path)
    parser.add_argument("--paintings", required=True, type=Path, help="the workshop's, one folder a setting")
    parser.add_argument("--out", required=True, type=Path)
    stage_main(main, parser)
