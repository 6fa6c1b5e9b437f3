"""Wall time of calls, one after the other or in turns."""

import statistics
import time
from collections.abc import Callable, Sequence
from typing import NamedTuple

Call = Callable[[], object]


class Times(NamedTuple):
    """Of several runs of one call, in seconds."""

    median_s: float
    minimum_s: float
    runs: int


def repeated(call: Call, budget_s: float, minimum: int = 5, most: int = 60) -> Times:
    """Run a call ``minimum`` times, and up to ``most`` while the budget lasts."""
    times: list[float] = []
    started = time.perf_counter()
    while len(times) < minimum or (len(times) < most and time.perf_counter() - started < budget_s):
        times.append(_once(call))
    return Times(statistics.median(times), min(times), len(times))


def in_turns(calls: Sequence[Call], rounds: int) -> list[Times]:
    """Time calls in rounds of one run each, so that other load on the machine affects all equally."""
    times = [[_once(call) for call in calls] for _ in range(rounds)]
    return [Times(statistics.median(of_one), min(of_one), rounds) for of_one in zip(*times, strict=True)]


def _once(call: Call) -> float:
    started = time.perf_counter()
    call()
    return time.perf_counter() - started
