"""Measured rows a few at a time, shared out among threads: what is done to each has no need of the others."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, Self, TypeVar

from numba import get_num_threads

from pentimento.render.threads import in_threads


class Rows(Protocol):
    """Rows of a table as a gap finder has them."""

    def __len__(self) -> int: ...

    def pick(self, rows: slice) -> Self:
        """Some of them, without copying."""


_M = TypeVar("_M", bound=Rows)
_R = TypeVar("_R")


def in_batches(function: Callable[[_M], _R], measured: _M, rows_at_once: int) -> list[_R]:
    """The results for a few rows at a time, in their order; the same for any number of threads, bit by bit.

    The function must not come back here: it would wait for the threads that it holds.
    """
    starts = range(0, len(measured), rows_at_once)
    batches = [slice(start, start + rows_at_once) for start in starts]
    return in_threads(lambda rows: function(measured.pick(rows)), batches, get_num_threads())
