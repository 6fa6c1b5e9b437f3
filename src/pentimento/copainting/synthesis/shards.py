"""Shards of co-paintings, painted by any number of workers with the same bytes, and saved one by one.

A shard is a fixed range of scenes. One worker paints it in memory, and the calling process saves it atomically. A run
that was killed resumes with the missing shards.
"""

from __future__ import annotations

import importlib
import io
import multiprocessing
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import torch
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from pentimento.contracts.atomic import atomic_write
from pentimento.contracts.copaintings import CONTRACT
from pentimento.contracts.errors import ConfigError, PentimentoError
from pentimento.contracts.schema import arrow_schema
from pentimento.copainting.synthesis.painter import Painter, Setting, load_painter
from pentimento.copainting.synthesis.pairs import paint_scene
from pentimento.copainting.synthesis.partials import PartialsConfig

Log = Callable[[str, float, int], None]


@dataclass(frozen=True, eq=False)
class Job:
    """One shard with all inputs of a worker."""

    name: str
    """Of the setting."""
    setting: Setting
    partials: PartialsConfig
    stroke_model: Path
    semantics: Path
    scenes: Sequence[Mapping[str, Any]]
    """Rows of the ``scenes`` contract."""


def paint_shard(job: Job) -> bytes:
    """The rows of the shard in the `copaintings` contract, as a Parquet file."""
    torch.set_num_threads(1)  # sums come in one order, and workers share the machine's cores
    torch.set_deterministic_debug_mode("error")
    painter = _painter(job.name, job.setting, job.stroke_model, job.semantics)
    with threadpool_limits(1):  # k-means and linear algebra have threads of their own
        rows = [row for scene in job.scenes for row in paint_scene(scene, painter, job.partials)]
    content = io.BytesIO()
    pq.write_table(pa.Table.from_pylist(rows, schema=arrow_schema(CONTRACT)), content, compression="zstd")
    return content.getvalue()


@cache
def _painter(name: str, setting: Setting, stroke_model: Path, semantics: Path) -> Painter:
    return load_painter(name, setting, stroke_model, semantics)


def paint_shards(
    jobs: Sequence[Job],
    scratch: Path,
    *,
    workers: int,
    scheduler: str | None,
    in_each_worker: Callable[[], None],
    log: Log,
) -> list[Path]:
    """Paint all shards that `scratch` does not hold; return the files of all shards in order.

    Args:
        workers: processes; with 1, this process paints.
        scheduler: address of a dask scheduler (`tcp://host:8786`) whose workers paint instead. They must find
            the models at the same paths.
        in_each_worker: called first in each new process.
        log: `log("shards", count, count)` after each shard.

    Raises:
        PentimentoError: a worker was killed; finished shards are kept.
        ConfigError: a scheduler is given, but dask is not installed or the scheduler does not answer.
    """
    scratch.mkdir(parents=True, exist_ok=True)
    for unfinished in scratch.glob(".*.tmp"):  # of a write that was killed
        unfinished.unlink()
    files = [scratch / f"part-{number:05d}.parquet" for number in range(len(jobs))]
    missing = [number for number, file in enumerate(files) if not file.exists()]
    done = len(files) - len(missing)
    painted = (
        ((number, paint_shard(jobs[number])) for number in missing)
        if workers == 1 and scheduler is None
        else _by_workers([(number, jobs[number]) for number in missing], workers, scheduler, in_each_worker)
    )
    for number, content in painted:
        atomic_write(files[number], content)
        done += 1
        log("shards", done, done)
    return files


def _by_workers(
    jobs: Sequence[tuple[int, Job]], workers: int, scheduler: str | None, in_each_worker: Callable[[], None]
) -> Iterator[tuple[int, bytes]]:
    """Shards as they are finished; those not started are cancelled if the iteration stops early."""
    if not jobs:
        return
    with _executor(min(workers, len(jobs)), scheduler, in_each_worker) as executor:
        futures = {executor.submit(paint_shard, job): number for number, job in jobs}
        try:
            for future in as_completed(futures):
                yield futures.pop(future), future.result()
        except BrokenProcessPool as error:
            raise PentimentoError(
                "A worker was killed, probably because memory ran out. Run again with fewer workers; finished shards "
                "are kept."
            ) from error
        finally:
            for future in futures:
                future.cancel()


@contextmanager
def _executor(workers: int, scheduler: str | None, in_each_worker: Callable[[], None]) -> Iterator[Executor]:
    if scheduler is None:
        # Fresh processes: a fork of one with threads (PyTorch's, MLflow's) may hang.
        context = multiprocessing.get_context("spawn")
        with ProcessPoolExecutor(workers, mp_context=context, initializer=in_each_worker) as pool:
            yield pool
        return
    try:
        distributed: Any = importlib.import_module("dask.distributed")
    except ModuleNotFoundError as error:
        raise ConfigError(
            f"The scheduler {scheduler} needs dask: install pentimento[distributed], or set scheduler to null."
        ) from error
    try:
        client = distributed.Client(scheduler)
    except (OSError, ValueError) as error:  # TimeoutError is an OSError
        raise ConfigError(f"No dask scheduler answers at {scheduler} ({error}); start it or correct it.") from error
    with client:
        yield client.get_executor(pure=False)
