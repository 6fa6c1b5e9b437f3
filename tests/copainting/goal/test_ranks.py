"""Processes of one training: what they say arrives here, and none outlives a failure."""

import multiprocessing

import pytest
import torch
from torch.multiprocessing import ProcessRaisedException

from pentimento.contracts.errors import PentimentoError
from pentimento.copainting.goal.ranks import run_ranks
from tests.copainting.rank_jobs import fail_beside_others, tell_and_stay


def test_ranks_log_to_the_parent_and_end_on_its_interruption() -> None:
    torch.set_num_threads(5)
    told = {}

    def log(name: str, value: float, step: int) -> None:
        told[name] = value, step
        if len(told) == 2:
            raise KeyboardInterrupt

    try:
        with pytest.raises(KeyboardInterrupt):
            run_ranks(tell_and_stay, ("rank",), 2, log)
    finally:
        torch.set_num_threads(1)
    assert told == {"rank0": (2, 0), "rank1": (2, 1)}  # two of the five threads each: never more than there are
    assert not multiprocessing.active_children()


@pytest.mark.parametrize(
    ("killed", "error", "said"),
    [
        (False, ProcessRaisedException, "the second rank fails"),
        (True, PentimentoError, "process 1 .* SIGKILL, perhaps"),
    ],
)
def test_failing_rank_ends_all_ranks_and_raises(killed: bool, error: type[Exception], said: str) -> None:
    with pytest.raises(error, match=said):
        run_ranks(fail_beside_others, (killed,), 2, lambda *_: None)
    assert not multiprocessing.active_children()
