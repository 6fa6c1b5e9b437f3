"""The thread pool: order of results, concurrency and exceptions."""

from threading import Barrier

import pytest

from pentimento.render.threads import in_threads


@pytest.mark.parametrize("threads", [1, 3])
def test_in_threads_keeps_the_order(threads: int) -> None:
    assert in_threads(lambda item: item**2, range(20), threads) == [item**2 for item in range(20)]


def test_in_threads_runs_concurrently() -> None:
    both = Barrier(2, timeout=30)  # which one alone never passes
    assert sorted(in_threads(lambda _: both.wait(), range(2), 2)) == [0, 1]


def test_in_threads_propagates_exceptions() -> None:
    with pytest.raises(ZeroDivisionError):
        in_threads(lambda item: 1 // item, [1, 0], 2)
