"""Worker processes, scratch folders and keyed generators: the result of a job depends on its inputs alone."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context
from pathlib import Path
from typing import Any, TypeVar

import torch

from pentimento.bundle.sampler import seed_for

R = TypeVar("R")
Submit = Callable[..., "Future[Any]"]


@contextmanager
def worker_pool(workers: int, start: Callable[[], None]) -> Iterator[Submit]:
    """Yield `submit(function, *arguments) -> Future`; with one worker, the function runs at once in this process.

    Each new process calls `start` first and uses one PyTorch thread. If the block raises, jobs that have not started
    are cancelled.
    """
    if workers == 1:
        yield _at_once
        return
    # Not forked: PyTorch's and numba's threads of this process would be missing in the copies.
    pool = ProcessPoolExecutor(workers, mp_context=get_context("spawn"), initializer=_start, initargs=(start,))
    try:
        yield pool.submit
        pool.shutdown()
    except BaseException:
        pool.shutdown(cancel_futures=True)
        raise


def gather(futures: Iterable[Future[R]]) -> list[R]:
    """The results in the order of the futures; the first failure is raised."""
    return [future.result() for future in futures]


def _start(start: Callable[[], None]) -> None:
    start()
    torch.set_num_threads(1)
    torch.set_deterministic_debug_mode("error")


def _at_once(function: Callable[..., R], *arguments: Any) -> Future[R]:
    future: Future[R] = Future()
    future.set_result(function(*arguments))
    return future


def scratch_folder(root: Path, name: str, params: Mapping[str, Any], digests: Mapping[str, str]) -> Path:
    """The folder of job `name` for these settings and input digests; every other combination has another folder."""
    key = hashlib.sha256(json.dumps([params, digests], sort_keys=True, default=str).encode()).hexdigest()
    return root / name / key[:16]


def generator_for(*key: int) -> torch.Generator:
    """PyTorch's generator for a key such as (seed, step); equal to `bundle.torch_noise` for the same key."""
    return torch.Generator().manual_seed(seed_for(*key))
