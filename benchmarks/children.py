"""One measurement, one process: nothing that an earlier one left in memory is measured with it."""

import multiprocessing
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from typing import TypeVar

_R = TypeVar("_R")
PRELOADED = ["torch", "pentimento.dynamics.strokes.simulation", "pentimento.dynamics.strokes.reference"]


def start() -> ProcessPoolExecutor:
    """Where ``measure`` runs its functions: children of a process that has the libraries imported, a new one each.

    They all are of the caller's process group, one at a time.
    """
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(PRELOADED)
    return ProcessPoolExecutor(1, context, max_tasks_per_child=1)


def measure(children: ProcessPoolExecutor, function: Callable[..., _R], *arguments: object) -> _R:
    """What ``function`` returns in a process of its own."""
    return children.submit(function, *arguments).result()
