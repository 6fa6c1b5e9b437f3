"""Process rows in batches, on one or more threads."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from functools import cache
from typing import Any, TypeVar

from threadpoolctl import ThreadpoolController  # type: ignore[import-untyped]

from pentimento.render.threads import in_threads

_R = TypeVar("_R")


def in_batches(function: Callable[[slice], _R], rows: int, rows_at_once: int, threads: int = 1) -> list[_R]:
    """The results for batches of rows, in order; bitwise the same for any number of threads.

    Args:
        function: gets the slice of rows. With several threads it must not call ``in_batches`` itself, which would
            deadlock.
        rows: in all.
        rows_at_once: rows a batch.
        threads: more than one pays only for work on whole arrays that releases the interpreter lock.
    """

    def of(some: slice) -> _R:
        with one_openmp_thread():
            return function(some)

    batches = [slice(start, start + rows_at_once) for start in range(0, rows, rows_at_once)]
    return in_threads(of, batches, threads)


def one_openmp_thread() -> AbstractContextManager[Any]:
    """Limit OpenMP to one thread for the calling thread.

    OpenMP threads on busy cores wait for each other far longer than they work. OpenMP counts for each thread
    separately, and Numba sets the number when it starts its own, so the limit is set where work starts.
    """
    return _pools().limit(limits=1, user_api="openmp")


@cache
def _pools() -> ThreadpoolController:
    return ThreadpoolController()
