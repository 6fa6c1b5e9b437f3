"""Jobs of ranks, in a module of their own: each process imports it, and it must import fast."""

import os
import signal
import time
from typing import Any

import torch


def log_and_wait(rank: int, name: str, log: Any) -> None:
    """Log the number of threads, once from each rank, and never end."""
    log(f"{name}{rank}", torch.get_num_threads(), rank)
    time.sleep(3600)


def fail_on_rank_1(rank: int, killed: bool, _log: Any) -> None:
    """The second rank is killed, or raises; the first would wait for it for ever."""
    if rank == 1 and killed:
        os.kill(os.getpid(), signal.SIGKILL)
    if rank == 1:
        raise ValueError("the second rank fails")
    time.sleep(3600)
