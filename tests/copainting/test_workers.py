"""Jobs on processes."""

import math

import pytest

from pentimento.copainting.workers import gather, worker_pool


@pytest.mark.parametrize("workers", [1, 2])
def test_results_come_in_order_from_any_number_of_processes(workers: int) -> None:
    with worker_pool(workers, int) as submit:
        assert gather([submit(math.factorial, n) for n in range(8)]) == [math.factorial(n) for n in range(8)]


@pytest.mark.parametrize("workers", [1, 2])
def test_a_failure_comes_through(workers: int) -> None:
    with pytest.raises(ValueError), worker_pool(workers, int) as submit:
        gather([submit(math.sqrt, -1.0)])
