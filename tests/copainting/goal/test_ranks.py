"""Logging, interruption and failure of the processes of one training."""

import multiprocessing

import pytest
import torch
from torch.multiprocessing import ProcessRaisedException

from pentimento.contracts.errors import PentimentoError
from pentimento.copainting.goal.ranks import run_ranks
from tests.copainting.rank_jobs import fail_on_rank_1, log_and_wait


def test_ranks_log_to_the_parent_and_end_on_its_interruption() -> None:
    torch.set_num_threads(5)
    logged = {}

    def log(name: str, value: float, step: int) -> None:
        logged[name] = value, step
        if len(logged) == 2:
            raise KeyboardInterrupt

    try:
        with pytest.raises(KeyboardInterrupt):
            run_ranks(log_and_wait, ("rank",), 2, log)
    finally:
        torch.set_num_threads(1)
    assert logged == {"rank0": (2, 0), "rank1": (2, 1)}  # two of the five threads each: never more than there are
    assert not multiprocessing.active_children()


@pytest.mark.parametrize(
    ("killed", "error", "message"),
    [
        (False, ProcessRaisedException, "the second rank fails"),
        (True, PentimentoError, "process 1 .* SIGKILL, perhaps"),
    ],
)
def test_failing_rank_ends_all_ranks_and_raises(killed: bool, error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        run_ranks(fail_on_rank_1, (killed,), 2, lambda *_: None)
    assert not multiprocessing.active_children()
