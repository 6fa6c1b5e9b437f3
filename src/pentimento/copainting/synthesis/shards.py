"""Co-paintings in shards: made by any number of workers, kept one by one, the same bytes whoever made them.

A shard is a fixed run of scenes, painted by one worker in memory and kept by the process that asked for it, in one
step. What was killed goes on with the shards that are not there yet.
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
from pentimento.copainting.synthesis.pairs import Painter, Setting, load_painter, paint_scene
from pentimento.copainting.synthesis.partials import PartialsConfig

Log = Callable[[str, float, int], None]


@dataclass(frozen=True, eq=False)
class Job:
    """One shard: all that a worker must be told."""

    name: str
    """Of the setting."""
    setting: Setting
    partials: PartialsConfig
    stroke_model: Path
    semantics: Path
    scenes: Sequence[Mapping[str, Any]]
    """Rows of the ``scenes`` contract."""


def paint_shard(job: Job) -> bytes:
    """The shard's rows in the ``copaintings`` contract, as a Parquet file."""
    torch.set_num_threads(1)  # sums come in one order, and workers share the machine's cores
    torch.set_deterministic_debug_mode("error")
    painter = _painter(job.name, job.setting, job.stroke_model, job.semantics)
    with threadpool_limits(1):  # k-means and linear algebra have threads of their own
        rows = [row for scene in job.scenes for row in paint_scene(scene, painter, job.partials)]
    kept = io.BytesIO()
    pq.write_table(pa.Table.from_pylist(rows, schema=arrow_schema(CONTRACT)), kept, compression="zstd")
    return kept.getvalue()


@cache
def _painter(name: str, setting: Setting, stroke_model: Path, semantics: Path) -> Painter:
    return load_painter(name, setting, stroke_model, semantics)


def paint_shards(
    jobs: Sequence[Job],
    scratch: Path,
    workers: int,
    scheduler: str | None,
    in_each_worker: Callable[[], None],
    log: Log,
) -> list[Path]:
    """Paint all shards that ``scratch`` does not hold yet; return the files of all, in their order.

    Args:
        workers: processes; with 1, this one does the work.
        scheduler: address of a dask scheduler (``tcp://host:8786``), whose workers paint instead; each must find the
            models at the same paths.
        in_each_worker: called first in each new process.
        log: ``log("shards", how many there are, the same)`` after each.

    Raises:
        PentimentoError: a worker was killed; what it had finished stays.
        ConfigError: a scheduler is given, but dask is not installed.
    """
    scratch.mkdir(parents=True, exist_ok=True)
    for unfinished in scratch.glob(".*.tmp"):  # of a write that was killed
        unfinished.unlink()
    files = [scratch / f"part-{number:05d}.parquet" for number in range(len(jobs))]
    missing = [number for number, file in enumerate(files) if not file.exists()]
    there = len(files) - len(missing)
    made = (
        ((number, paint_shard(jobs[number])) for number in missing)
        if workers == 1 and scheduler is None
        else _elsewhere([(number, jobs[number]) for number in missing], workers, scheduler, in_each_worker)
    )
    for number, content in made:
        atomic_write(files[number], content)
        there += 1
        log("shards", there, there)
    return files


def _elsewhere(
    jobs: Sequence[tuple[int, Job]], workers: int, scheduler: str | None, in_each_worker: Callable[[], None]
) -> Iterator[tuple[int, bytes]]:
    """Shards as they are finished; those not begun are given up when this stops early."""
    if not jobs:
        return
    with _executor(min(workers, len(jobs)), scheduler, in_each_worker) as executor:
        futures = {executor.submit(paint_shard, job): number for number, job in jobs}
        try:
            for future in as_completed(futures):
                yield futures.pop(future), future.result()
        except BrokenProcessPool as error:
            raise PentimentoError(
                "A worker was killed, probably for want of memory. Run again with fewer workers: what is painted stays."
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
