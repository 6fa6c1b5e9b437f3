"""What a dask cluster costs, and whether its bytes are those of one process: `python -m studies.cluster`.

The same shards of co-paintings are painted by plain processes and by the workers of a cluster, as many of them, each
one thread; everything is painted once before the clock runs. What the cluster takes beyond the plain processes is its
overhead: what cores take from each other is in both. They take turns, and each is judged by its fastest, for the speed
of a shared machine changes by more than the overhead from one minute to the next.

A line for each number of workers goes to the screen, and all of them to `--out`, from which `python -m
pipelines.plan_scale` takes the overhead. Exit status 1 where any byte differs.
"""

from __future__ import annotations

import argparse
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
from pipelines._config import load_section
from pipelines._io import write_json
from pipelines._review.rates import CLUSTER
from pipelines.synthesize_copaintings import SynthesizeCopaintings
from studies.kills import ROOT, prepare

SETTING = "marker"


def main() -> int:
    """Command line; the exit status."""
    parser = argparse.ArgumentParser(prog="python -m studies.cluster", description=__doc__)
    parser.add_argument("--scenes", type=int, default=48, help="a shard each")
    parser.add_argument("--workers", type=int, nargs="+", default=[1, 2, 4])
    parser.add_argument("--turns", type=int, default=5, help="of each")
    parser.add_argument("--out", type=Path, default=CLUSTER)
    given = parser.parse_args()
    expected, same, measured = None, True, []
    with tempfile.TemporaryDirectory() as temporary:
        jobs = shards(Path(temporary), given.scenes)
        for workers in given.workers:
            with (
                ProcessPoolExecutor(workers, multiprocessing.get_context("spawn")) as plain,
                LocalCluster(n_workers=workers, threads_per_worker=1, dashboard_address=None) as cluster,
                Client(cluster) as client,
            ):
                executors = {"plain": plain, "cluster": client.get_executor(pure=False)}
                made = [list(executor.map(paint_shard, jobs)) for executor in executors.values()]  # loads and compiles
                seconds: dict[str, list[float]] = {name: [] for name in executors}
                for _ in range(given.turns):
                    for name, executor in executors.items():
                        taken, bytes_ = painted(jobs, executor)
                        seconds[name].append(taken)
                        made.append(bytes_)
            expected = expected or made[0]
            alike = all(each == expected for each in made)
            same &= alike
            plain_s, cluster_s = (min(seconds[name]) for name in executors)
            print(
                f"{workers} workers: {plain_s:.1f} s of plain processes, {cluster_s:.1f} s of the cluster's "
                f"({cluster_s / plain_s - 1:+.1%}), {'the same bytes' if alike else 'OTHER BYTES'}",
                flush=True,
            )
            measured.append({"workers": workers, "plain_s": plain_s, "cluster_s": cluster_s})
    told = {"scenes": given.scenes, "finished": time.strftime("%Y-%m-%d %H:%M:%S"), "measured": measured}
    write_json(given.out, told)
    return 0 if same else 1


def shards(folder: Path, count: int) -> list[Job]:
    """One scene each, in the setting of params.yaml, with untrained models below ``folder``."""
    prepare(folder)
    config = load_section(ROOT / "params.yaml", "synthesize_copaintings", SynthesizeCopaintings)
    rows: list[dict[str, Any]] = scenes.example_table(count).to_pylist()
    models = (folder / f"models/stroke_{SETTING}/weights", folder / "semantics")
    return [Job(SETTING, config.settings[SETTING], config.partials, *models, [row]) for row in rows]


def painted(jobs: Sequence[Job], executor: Executor) -> tuple[float, list[bytes]]:
    """Seconds of painting all shards, and their bytes in the shards' order."""
    began = time.perf_counter()
    contents = list(executor.map(paint_shard, jobs))
    return time.perf_counter() - began, contents


if __name__ == "__main__":
    sys.exit(main())
