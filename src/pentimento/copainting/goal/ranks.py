"""Several processes on this machine for one training: ranks that a Lightning trainer in each of them joins.

Lightning can start processes, but not as a stage needs it: `ddp` runs the whole stage again in each of them, and
`ddp_spawn` logs nothing during training and leaves its processes running when the stage is terminated.
"""

from __future__ import annotations

import multiprocessing
import os
import socket
import sys
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import Any, Final

import torch
from torch.distributed import TCPStore  # type: ignore[attr-defined]
from torch.multiprocessing.spawn import ProcessExitedException, spawn

from pentimento.contracts.errors import PentimentoError

Log = Callable[[str, float, int], None]

_LOOK_EVERY_S: Final = 0.1
_HERE: Final = "127.0.0.1"
_LOOPBACK: Final = "lo0" if sys.platform == "darwin" else "lo"


def run_ranks(job: Callable[..., None], arguments: tuple[Any, ...], number: int, log: Log) -> None:
    """Call `job(rank, *arguments, log)` in each of `number` new processes, and `log` in this one with what they log.

    A trainer with `devices=number` in the job finds the others. Together they use as many PyTorch threads as this
    process would. All of them end if one fails or is killed, or if this process is interrupted or ends.

    Raises:
        PentimentoError: a rank was killed.
        torch.multiprocessing.ProcessRaisedException: a rank raised; it has the traceback.
    """
    reader, writer = multiprocessing.get_context("spawn").Pipe(duplex=False)
    threads = max(1, torch.get_num_threads() // number)
    # They meet at a store of this process, while it is there; one that PyTorch opens itself listens on every network.
    listener = socket.create_server((_HERE, 0))
    port = listener.getsockname()[1]
    store = TCPStore(_HERE, port, is_master=True, wait_for_workers=False, master_listen_fd=listener.detach())
    settings = (store.port, threads, torch.get_deterministic_debug_mode())
    with reader, writer:
        given = (job, arguments, settings, writer)
        ranks = spawn(_rank, given, number, join=False, daemon=True)  # type: ignore[no-untyped-call]
        try:
            ended = False
            while not ended:
                ended = ranks.join(_LOOK_EVERY_S)
                while reader.poll():
                    log(*reader.recv())
        except ProcessExitedException as error:
            raise PentimentoError(
                f"The training stopped because {error.msg}, perhaps for want of memory; take a smaller batch, then run "
                "again: what was trained up to the last checkpoint is kept."
            ) from error
        finally:
            for process in ranks.processes:
                process.kill()
                process.join()


def _rank(
    rank: int,
    job: Callable[..., None],
    arguments: tuple[Any, ...],
    settings: tuple[int, int, int],
    writer: Connection,
) -> None:
    parent = multiprocessing.parent_process()
    if parent is None or not parent.is_alive():  # it died while this process was starting; later, PyTorch notices
        return
    port, threads, determinism = settings
    # By these, Lightning knows that it need not start processes, and where they meet; it keeps to the threads.
    os.environ.update(
        LOCAL_RANK=str(rank),
        NODE_RANK="0",
        MASTER_ADDR=_HERE,
        MASTER_PORT=str(port),
        TORCHELASTIC_USE_AGENT_STORE="True",  # that port is listened to already
        GLOO_SOCKET_IFNAME=_LOOPBACK,
        OMP_NUM_THREADS=str(threads),
    )
    torch.set_num_threads(threads)
    torch.set_deterministic_debug_mode(determinism)
    job(rank, *arguments, lambda *logged: writer.send(logged))
