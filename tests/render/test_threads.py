"""Work shared out among threads: in order, and at once."""

from threading import Barrier

import pytest

from pentimento.render.threads import in_threads


@pytest.mark.parametrize("threads", [1, 3])
def test_results_are_in_the_order_of_the_items(threads: int) -> None:
    assert in_threads(lambda item: item**2, range(20), threads) == [item**2 for item in range(20)]


def test_as_many_as_there_are_threads_are_at_work_at_once() -> None:
    both = Barrier(2, timeout=30)  # which one alone never passes
    assert sorted(in_threads(lambda _: both.wait(), range(2), 2)) == [0, 1]


def test_what_fails_in_a_thread_fails_here() -> None:
    with pytest.raises(ZeroDivisionError):
        in_threads(lambda item: 1 // item, [1, 0], 2)
