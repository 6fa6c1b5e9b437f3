"""Independent jobs on several processes; results do not depend on how many."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context
from typing import Any, TypeVar

import torch

R = TypeVar("R")
Submit = Callable[..., "Future[Any]"]


@contextmanager
def worker_pool(workers: int, start: Callable[[], None]) -> Iterator[Submit]:
    """Yield `submit(function, *arguments) -> Future`; with one worker, the function runs at once in this process.

    Jobs that have not begun are dropped when the block raises. Each new process calls `start` first; PyTorch computes
    on one thread there.
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
    """Results in the order of the futures; the first failure is raised."""
    return [future.result() for future in futures]


def _start(start: Callable[[], None]) -> None:
    start()
    torch.set_num_threads(1)
    torch.set_deterministic_debug_mode("error")


def _at_once(function: Callable[..., R], *arguments: Any) -> Future[R]:
    future: Future[R] = Future()
    future.set_result(function(*arguments))
    return future
