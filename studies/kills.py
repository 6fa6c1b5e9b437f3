"""Whether a stage that is killed again and again ends with the bytes of one that never was: `python -m studies.kills`.

A small synthesis of co-paintings and a small fine-tuning of the goal planner, of about the sizes of
profiles/smoke.yaml, each run once in peace. Then each is started, killed with SIGKILL at a random moment of its work,
and started again by the same command, until it was killed as often as wanted. Whenever it comes to its end, its output
is compared, removed, and made from nothing; in the end it is left to finish and compared once more. Scenes are examples
and models untrained: what is tested is that nothing is lost, not what is painted.

A line for each kill and each end goes to the screen and to ``--out``. Exit status 1 where any byte differs.
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
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from ruamel.yaml import YAML

from pentimento.contracts import copaintings, scenes
from pentimento.contracts.errors import PentimentoError
from pentimento.contracts.tables import write_table
from pentimento.copainting.goal.planner import build_goal_planner, save_goal_planner, text_encoder_of
from pentimento.copainting.goal.vae import build_vae
from pentimento.dynamics.strokes.extended import base_model, model_files
from pentimento.dynamics.strokes.traj2stroke import Traj2StrokeParameters
from pentimento.semantics.encoder import Encoder, new_model
from pentimento.semantics.tokenizer import learn_tokenizer
from pipelines._config import load_section
from pipelines._io import end_with_parent
from pipelines._params import merge, read_yaml
from pipelines.pretrain_goal_planner import PretrainGoalPlanner
from pipelines.train_semantics import TrainSemantics

ROOT = Path(__file__).resolve().parents[1]
CHANGED = {
    "synthesize_copaintings": {"workers": 1, "scenes": {"train": 24, "val": 4, "test": 4}, "scenes_per_shard": 1},
    "finetune_goal_planner": {
        "threads": 1,
        "training": {"steps": 40, "batch": 8, "checkpoint_every": 2},
        "sampling": {"image_guidance": [1.0], "text_guidance": [5.0, 1.0]},
    },
}
"""Over the profile: one core, seconds of work, most of it between the first and the last place to go on from."""
_LOOK_S = 0.01
Say = Callable[[str], None]


@dataclass(frozen=True)
class Stage:
    """A stage that is killed."""

    name: str
    arguments: tuple[str, ...]
    kept: str
    """Where, in the working folder, it keeps what is done: a pattern of files."""

    def command(self, out: str) -> list[str]:
        """The same one each time."""
        return [sys.executable, "-m", f"pipelines.{self.name}", *self.arguments, "--out", out]


STAGES = (
    Stage(
        "synthesize_copaintings",
        ("--setting", "marker", "--tools", "marker", "--scenes", "scenes", "--models", "models",
         "--semantics", "semantics"),
        ".pentimento/synthesis/*/*/part-*.parquet",
    ),
    Stage(
        "finetune_goal_planner",
        ("--setting", "marker", "--copaintings", "copaintings", "--base", "base"),
        ".pentimento/training/finetune_goal_planner@*/*/step-*.ckpt",
    ),
)  # fmt: skip


@dataclass(frozen=True)
class Ended:
    """An execution that was not killed before it ended."""

    work_s: float
    """From when the stage had read its settings and opened its output folder until that was complete, in place."""


@dataclass(frozen=True)
class Killed:
    """An execution that was killed."""

    after_s: float
    """Seconds into its work."""
    kept: tuple[str, ...]
    """Files it can go on from."""


def main() -> int:
    """Command line; the exit status."""
    parser = argparse.ArgumentParser(prog="python -m studies.kills", description=__doc__)
    parser.add_argument("--times", type=int, default=20, help="kills of each stage")
    parser.add_argument("--seed", type=int, default=0, help="of the moments")
    parser.add_argument("--out", type=Path, default=Path("data/studies/kills.txt"))
    given = parser.parse_args()
    given.out.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder, given.out.open("w", encoding="utf-8") as file:

        def say(line: str) -> None:
            print(line, flush=True)
            print(line, file=file, flush=True)

        prepare(Path(folder))
        with ThreadPoolExecutor(len(STAGES)) as side_by_side:
            series = [
                side_by_side.submit(kill_again_and_again, stage, Path(folder), given.times, [given.seed, number], say)
                for number, stage in enumerate(STAGES)
            ]
        differences = [difference for one in series for difference in one.result()]
        say(verdict(given.times, differences))
    return 1 if differences else 0


def prepare(folder: Path) -> None:
    """Write params.yaml and what the stages read: example scenes and co-paintings, untrained models."""
    params = merge(
        read_yaml(ROOT / "params.yaml"), read_yaml(ROOT / "profiles/smoke.yaml"), Path("profiles/smoke.yaml")
    )
    YAML(typ="safe").dump(merge(params, CHANGED, Path("studies/kills.py")), folder / "params.yaml")
    semantics = load_section(folder / "params.yaml", "train_semantics", TrainSemantics)
    pretrain = load_section(folder / "params.yaml", "pretrain_goal_planner", PretrainGoalPlanner)
    write_table(folder / "scenes", scenes.example_table(40), scenes.CONTRACT, "# Card")
    write_table(folder / "copaintings", copaintings.example_table(20), copaintings.CONTRACT, "# Card")
    weights = folder / "models/stroke_marker/weights"
    weights.mkdir(parents=True)
    strokes = base_model(Traj2StrokeParameters((1.0, 1.0), (0.0, 0.0), 1.0, 1e-3, 0.06, 0.95))
    for name, content in model_files(strokes).items():
        (weights / name).write_text(json.dumps(content))
    captions = sorted(set(scenes.example_table(40)["caption"].to_pylist()))
    tokenizer = learn_tokenizer(captions, semantics.merges, semantics.caption_tokens)
    encoder = Encoder(new_model(semantics.encoders["main"].shape, tokenizer, 0), tokenizer)
    (folder / "semantics").mkdir()
    encoder.save(folder / "semantics")
    vae = build_vae(pretrain.vae, semantics.side_px).eval().requires_grad_(False)
    save_goal_planner(
        build_goal_planner(pretrain.shape, vae, text_encoder_of(encoder.model), tokenizer=tokenizer, seed=0),
        folder / "base",
    )


def kill_again_and_again(stage: Stage, folder: Path, times: int, seed: list[int], say: Say) -> list[str]:
    """Kill the stage so often, and say so; what differed, as sentences, at any of its ends."""
    whole, out = f"whole_{stage.name}", f"killed_{stage.name}"
    first = execute(stage, folder, whole, None)
    if not isinstance(first, Ended):
        raise AssertionError("nobody killed it")
    say(f"{stage.name}: never killed, {first.work_s:.1f} s of work")
    rng, kills, differences = np.random.default_rng(seed), 0, list[str]()
    while True:
        last = kills == times
        result = execute(stage, folder, out, None if last else moment(rng, first.work_s))
        if isinstance(result, Killed):
            kills += 1
            say(f"{stage.name}: kill {kills}, {result.after_s:.2f} s into its work; kept {kept(result, folder / out)}")
        if (folder / out).exists():  # also where it was killed between the output's change of name and its end
            found = differing(folder / whole, folder / out)
            differences += [f"{stage.name}, after {kills} kills: {difference}" for difference in found]
            say(f"{stage.name}: ended after {kills} kills; {'; '.join(found) or 'every byte is that of the whole run'}")
            shutil.rmtree(folder / out)  # as DVC does before a stage
            if last and isinstance(result, Ended):
                return differences
        elif isinstance(result, Ended):
            raise PentimentoError(f"{stage.name} ended well but wrote no {out}; look at what it does with --out.")


def kept(killed: Killed, out: Path) -> str:
    """What a kill left, in words."""
    parts = f"{len(killed.kept)} to go on from, the last {killed.kept[-1]}" if killed.kept else "nothing to go on from"
    return f"{parts}; its output was in place already" if out.exists() else parts


def moment(rng: np.random.Generator, work_s: float) -> float:
    """Seconds into the work, any of them as likely as any other."""
    return float(rng.uniform(0, work_s))


def execute(stage: Stage, folder: Path, out: str, kill_at_s: float | None) -> Ended | Killed:
    """Run the stage in the folder; kill it so many seconds into its work, if it works for as long.

    Raises:
        PentimentoError: it failed by itself.
    """
    environment = os.environ | {
        "PYTHONPATH": f"{ROOT}{os.pathsep}{ROOT / 'src'}", "HF_HUB_DISABLE_PROGRESS_BARS": "1",
        "MLFLOW_TRACKING_URI": f"sqlite:///{folder / stage.name}.db",
    }  # fmt: skip
    before = set(folder.glob(f".{out}.*.tmp"))
    log = folder / f"{stage.name}.log"
    with log.open("wb") as file:
        process = subprocess.Popen(
            stage.command(out), cwd=folder, env=environment, stdout=file, stderr=file, preexec_fn=end_with_parent
        )
    try:
        while process.poll() is None and not set(folder.glob(f".{out}.*.tmp")) - before:
            time.sleep(_LOOK_S)
        began, made_s = time.perf_counter(), None
        while process.poll() is None:
            now_s = time.perf_counter() - began
            if kill_at_s is not None and now_s >= kill_at_s:
                process.kill()
                process.wait()
                return Killed(now_s, tuple(sorted(path.name for path in folder.glob(stage.kept))))
            if made_s is None and (folder / out).exists():
                made_s = now_s
            time.sleep(_LOOK_S)
    finally:
        process.kill()
        process.wait()
    if process.returncode != 0:
        raise PentimentoError(
            f"{stage.name} failed by itself ({process.returncode}): {log.read_text(errors='replace')[-2000:]}"
        )
    return Ended(time.perf_counter() - began if made_s is None else made_s)


def differing(one: Path, other: Path) -> list[str]:
    """What is not the same in two folders, file by file, as sentences; none where all bytes are."""
    first, second = contents(one), contents(other)
    found = [f"{name} is missing" for name in sorted(first.keys() - second.keys())]
    found += [f"{name} should not be there" for name in sorted(second.keys() - first.keys())]
    return found + [f"{name} differs" for name in sorted(first.keys() & second.keys()) if first[name] != second[name]]


def contents(folder: Path) -> dict[str, bytes]:
    """All files below a folder."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def verdict(times: int, differences: list[str]) -> str:
    """The last line."""
    if differences:
        return f"After {times} kills of each stage something differs: {'; '.join(differences)}."
    names = " and ".join(stage.name for stage in STAGES)
    return f"{names} were killed {times} times each: every end has the bytes of a run that was never killed."


if __name__ == "__main__":
    sys.exit(main())
