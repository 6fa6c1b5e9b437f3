"""The overhead of a dask cluster, and whether its output equals that of one process: `python -m studies.cluster`.

Plain processes and as many workers of a cluster, one thread each, synthesise the same shards of co-paintings; both
synthesise everything once before the measurement. They alternate, and the fastest run of each counts: the speed of a
shared machine changes by more than the overhead from one minute to the next. The overhead is the cluster's time beyond
that of the plain processes; the contention of the cores is in both.

A line for each number of workers goes to the screen, and all of them to `--out`, from which `python -m
pipelines.plan_scale` reads the overhead. Exit status 1 where any byte differs.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import sys
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from pathlib import Path
from typing import Any

from dask.distributed import Client, LocalCluster

from pentimento.contracts import scenes
from pentimento.copainting.synthesis.shards import Job, paint_shard
from pentimento.dynamics.strokes.extended import base_model, model_files
from pentimento.dynamics.strokes.traj2stroke import Traj2StrokeParameters
from pentimento.semantics.encoder import Encoder, new_model
from pentimento.semantics.tokenizer import learn_tokenizer
from pipelines._config import load_section
from pipelines._io import write_json
from pipelines._review.scale import CLUSTER
from pipelines.synthesize_copaintings import SynthesizeCopaintings
from pipelines.train_semantics import TrainSemantics

ROOT = Path(__file__).resolve().parents[1]
SETTING = "marker"


def main() -> int:
    """Command line; the exit status."""
    parser = argparse.ArgumentParser(prog="python -m studies.cluster", description=__doc__)
    parser.add_argument("--scenes", type=int, default=48, help="number of scenes, one a shard")
    parser.add_argument("--workers", type=int, nargs="+", default=[1, 2, 4])
    parser.add_argument("--turns", type=int, default=5, help="measurements of each")
    parser.add_argument("--out", type=Path, default=CLUSTER)
    args = parser.parse_args()
    expected, same, measured = None, True, []
    with tempfile.TemporaryDirectory() as temporary:
        jobs = shards(Path(temporary), args.scenes)
        for workers in args.workers:
            with (
                ProcessPoolExecutor(workers, multiprocessing.get_context("spawn")) as plain,
                LocalCluster(n_workers=workers, threads_per_worker=1, dashboard_address=None) as cluster,
                Client(cluster) as client,
            ):
                executors = {"plain": plain, "cluster": client.get_executor(pure=False)}
                outputs = [
                    list(executor.map(paint_shard, jobs)) for executor in executors.values()
                ]  # loads models and compiles
                seconds: dict[str, list[float]] = {name: [] for name in executors}
                for _ in range(args.turns):
                    for name, executor in executors.items():
                        elapsed_s, output = painted(jobs, executor)
                        seconds[name].append(elapsed_s)
                        outputs.append(output)
            expected = expected or outputs[0]
            equal = all(output == expected for output in outputs)
            same &= equal
            plain_s, cluster_s = (min(seconds[name]) for name in executors)
            print(
                f"{workers} workers: {plain_s:.1f} s of plain processes, {cluster_s:.1f} s of the cluster's "
                f"({cluster_s / plain_s - 1:+.1%}), {'the same bytes' if equal else 'DIFFERENT BYTES'}",
                flush=True,
            )
            measured.append({"workers": workers, "plain_s": plain_s, "cluster_s": cluster_s})
    result = {"scenes": args.scenes, "finished": time.strftime("%Y-%m-%d %H:%M:%S"), "measured": measured}
    write_json(args.out, result)
    return 0 if same else 1


def shards(folder: Path, count: int) -> list[Job]:
    """Shards of one scene each, in the setting of params.yaml, with untrained models below ``folder``."""
    _write_models(folder)
    config = load_section(ROOT / "params.yaml", "synthesize_copaintings", SynthesizeCopaintings)
    rows: list[dict[str, Any]] = scenes.example_table(count).to_pylist()
    models = (folder / f"models/stroke_{SETTING}/weights", folder / "semantics")
    return [Job(SETTING, config.settings[SETTING], config.partials, *models, [row]) for row in rows]


def _write_models(folder: Path) -> None:
    """Write an untrained stroke model and text–image encoder."""
    weights = folder / f"models/stroke_{SETTING}/weights"
    weights.mkdir(parents=True)
    strokes = base_model(Traj2StrokeParameters((1.0, 1.0), (0.0, 0.0), 1.0, 1e-3, 0.06, 0.95))
    for name, content in model_files(strokes).items():
        (weights / name).write_text(json.dumps(content))
    semantics = load_section(ROOT / "params.yaml", "train_semantics", TrainSemantics)
    captions = sorted(set(scenes.example_table(40)["caption"].to_pylist()))
    tokenizer = learn_tokenizer(captions, semantics.merges, semantics.caption_tokens)
    (folder / "semantics").mkdir()
    Encoder(new_model(semantics.encoders["main"].shape, tokenizer, 0), tokenizer).save(folder / "semantics")


def painted(jobs: Sequence[Job], executor: Executor) -> tuple[float, list[bytes]]:
    """Seconds of synthesising all shards, and their bytes in the shards' order."""
    began = time.perf_counter()
    contents = list(executor.map(paint_shard, jobs))
    return time.perf_counter() - began, contents


if __name__ == "__main__":
    sys.exit(main())
