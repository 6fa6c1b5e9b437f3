"""Paint and sculpt from the bundle with the lean runner, in the studio, in processes without PyTorch."""

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
from pentimento.contracts.images import write_png
from pentimento.contracts.ranges import at_least
from pentimento.control.checkpoint import load_sculpture
from pentimento.control.run_sculpture import HEIGHTS, SUMMARY
from pentimento.goals3d.shading import photograph
from pipelines import _runner_process
from pipelines._config import load_section
from pipelines._io import output_folder, stage_main, write_json
from pipelines._tracking import tracked_run

PICTURES = ("goal.png", "plan.png", "canvas.png")
"""Pictures that are kept of a painting: the goal, the first prediction, and the result."""
SCULPTURES = "sculptures.json"


@dataclass(frozen=True)
class Performance:
    """One painting."""

    setting: str
    """Of the bundle."""
    words: str | None
    """A prompt, on a blank sheet; null paints the photograph of the stage `paint` in this setting."""
    strokes: int

    def __post_init__(self) -> None:
        at_least(self, 1, "strokes")


@dataclass(frozen=True)
class Carving:
    """One sculpture."""

    material: str
    """Of the bundle's push models, and of the studio."""
    letter: str
    pushes: int
    """Maximum number."""

    def __post_init__(self) -> None:
        at_least(self, 1, "pushes")


@dataclass(frozen=True)
class RunBundle:
    """Section `run_bundle` of params.yaml."""

    seed: int
    """Of plans, goals and the studio."""
    paintings: dict[str, Performance]
    sculptures: dict[str, Carving]

    def __post_init__(self) -> None:
        at_least(self, 0, "seed")


def main(arguments: argparse.Namespace) -> None:
    """Write `--out`: a folder of pictures for each painting and sculpture, metrics.json and sculptures.json."""
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
        carved = {
            name: _carve(carving, config.seed, arguments.bundle, out / name)
            for name, carving in config.sculptures.items()
        }
        write_json(out / SCULPTURES, carved)
        run.log_metrics(metrics | carved)
        for name in config.paintings:
            run.log_picture(out / name / "canvas.png", name)
        for name in config.sculptures:
            run.log_picture(out / name / "result.png", name)


def _perform(performance: Performance, seed: int, bundle: Path, paintings: Path, out: Path) -> dict[str, Any]:
    """Paint; write the pictures into ``out`` and return strokes and errors."""
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
        _in_a_process([*command, "--out", str(folder)], f"setting {performance.setting}")
        out.mkdir()
        for picture in PICTURES:
            shutil.copy(folder / picture, out / picture)
        found: dict[str, Any] = json.loads((folder / "painting.json").read_text(encoding="utf-8"))
    metrics: dict[str, Any] = asdict(performance) | {"strokes": found["strokes"], "error": found["error"]}
    if performance.words is None:
        own = json.loads((workshop / "metrics.json").read_text(encoding="utf-8"))
        metrics["workshop"] = {"strokes": own["strokes"], "error": own["error"]["with_replanning"]}
    return metrics


def _carve(carving: Carving, seed: int, bundle: Path, out: Path) -> dict[str, Any]:
    """Sculpt; write the photographs into ``out`` and return pushes and errors."""
    command = [
        "--bundle", str(bundle), "--material", carving.material, "--letter", carving.letter,
        "--pushes", str(carving.pushes), "--seed", str(seed),
    ]  # fmt: skip
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / "sculpture"
        _in_a_process([*command, "--out", str(folder)], f"material {carving.material}")
        out.mkdir()
        state = load_sculpture(folder)
        first, last = state.progress.heights_m[0], state.progress.heights_m[-1]
        for name, height in zip(HEIGHTS, (first, state.goal_m, last), strict=True):
            write_png(out / f"{name}.png", photograph(height, state.progress.scan.window_m))
        found: dict[str, Any] = json.loads((folder / SUMMARY).read_text(encoding="utf-8"))
    return asdict(carving) | found


def _in_a_process(command: list[str], what: str) -> None:
    done = subprocess.run(
        [sys.executable, "-m", _runner_process.__name__, *command], capture_output=True, text=True
    )  # fmt: skip
    if done.returncode:
        raise PentimentoError(f"The runner failed in {what}: {done.stderr.strip()[-2000:]}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="run_bundle", description=__doc__)
    parser.add_argument("--bundle", required=True, type=Path)
    parser.add_argument("--paintings", required=True, type=Path, help="the workshop's, one folder a setting")
    parser.add_argument("--out", required=True, type=Path)
    stage_main(main, parser)
