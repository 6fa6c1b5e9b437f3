"""Rows a few at a time: what is done to each has no need of the others."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from functools import cache
from typing import Any, TypeVar

from threadpoolctl import ThreadpoolController  # type: ignore[import-untyped]

from pentimento.render.threads import in_threads

_R = TypeVar("_R")


def in_batches(function: Callable[[slice], _R], rows: int, rows_at_once: int, threads: int = 1) -> list[_R]:
    """The results for a few of so many rows at a time, in their order; the same for any number of threads, bit by bit.

    Of more than one, the function must not come back here: it would wait for the threads that it holds.

    Args:
        threads: more than one only for work on whole arrays; where most is said in Python, they wait for each other.
    """

    def of(some: slice) -> _R:
        with one_openmp_thread():
            return function(some)

    batches = [slice(start, start + rows_at_once) for start in range(0, rows, rows_at_once)]
    return in_threads(of, batches, threads)


def one_openmp_thread() -> AbstractContextManager[Any]:
    """Inside, what the calling thread starts is not shared out any further by OpenMP, whose threads wait for each other
    a hundred times as long on busy cores as they work.

    It is said where work starts and not once for a diagnosis, for OpenMP counts for each thread by itself, and Numba
    sets its number when it starts its own.
    """
    return _pools().limit(limits=1, user_api="openmp")


@cache
def _pools() -> ThreadpoolController:
    return ThreadpoolController()
