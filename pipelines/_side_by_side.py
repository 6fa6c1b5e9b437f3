"""Runs two stages at a time: `dvc repro` alone runs one after the other, and many stages use one core.

DVC itself runs each stage (`dvc repro --single-item`) as soon as its inputs are there. Of the stages that are ready,
the one with the longest chain of dependent stages comes first.
"""

import json
import os
import re
import signal
import threading
import time
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from subprocess import PIPE, STDOUT
from typing import IO, cast

from pipelines._dvc import Process, ask_dvc, run_dvc, send, signals_passed_on, start_dvc

AT_ONCE = 2
Reads = Mapping[str, frozenset[str]]
"""By stage: the stages whose outputs it reads."""
_POLL_S = 0.1
_EDGE = re.compile(r'^\s*"([^"]+)" -> "([^"]+)";$', re.MULTILINE)


def bring_up_to_date(folder: Path) -> int:
    """Run the out-of-date stages of the pipeline in `folder`; return DVC's exit status, 130 or 143 after a signal."""
    stages = out_of_date(json.loads(ask_dvc(["status", "--json"], folder) or "{}"), ask_dvc(["dag", "--dot"], folder))
    # Where nothing is to be done or the pipeline is invalid (a cycle, an unreadable file), DVC reports it.
    return _run_all(stages, folder) if stages else run_dvc(["repro"], folder)


def out_of_date(changed: Mapping[str, object], dot: str) -> Reads:
    """Return the stages of the folder's own dvc.yaml that must run, and which of them each one reads.

    Stages of dvc.yaml files in other folders, which DVC lists as `file:stage`, belong to other pipelines.

    Parameters
    ----------
    changed
        The changes of each stage that is out of date by itself (`dvc status --json`).
    dot
        The graph of the pipeline (`dvc dag --dot`), with edges from a stage to those that read it.
    """
    edges = _EDGE.findall(dot)
    found, new = set[str](), {name for name in changed if ":" not in name}
    while new:
        found |= new
        new = {reader for stage, reader in edges if stage in found} - found
    return {name: frozenset(stage for stage, reader in edges if reader == name and stage in found) for name in found}


def in_order(reads: Reads) -> list[str]:
    """Sort stages by the length of their longest chain of dependent stages, then by name."""

    @cache
    def below(name: str) -> int:
        return max((1 + below(reader) for reader, read in reads.items() if name in read), default=0)

    return sorted(reads, key=lambda name: (-below(name), name))


def _run_all(reads: Reads, folder: Path) -> int:
    """Run the stages, `AT_ONCE` at a time, until all are done or one has failed; then the others are stopped."""
    os.environ["OMP_WAIT_POLICY"] = "PASSIVE"  # threads that spin while they wait take the other stage's core
    os.environ["PYTHONUNBUFFERED"] = "1"  # or the output of a stage arrives in one piece when it ends
    waiting, done, running = in_order(reads), set[str](), dict[str, Process]()
    readers: list[threading.Thread] = []
    status = 0
    with signals_passed_on(running.values()) as received:
        while (waiting or running) and status == 0 and not received:
            ready = [name for name in waiting if reads[name] <= done]
            for name in ready[: AT_ONCE - len(running)]:
                arguments = ["--wait-for-lock", "repro", "--single-item", name]
                running[name] = start_dvc(arguments, folder, stdout=PIPE, stderr=STDOUT)
                readers.append(_forwarding(running[name], name))
                waiting.remove(name)
            time.sleep(_POLL_S)
            for name in [name for name, process in running.items() if process.poll() is not None]:
                status = abs(running.pop(name).returncode) or status
                done.add(name)
        if not received:  # else the signal was forwarded
            send(running.values(), signal.SIGTERM)
        for process in running.values():
            process.wait()
    for reader in readers:
        reader.join()
    return 128 + received[0] if received else status


def _forwarding(process: Process, name: str) -> threading.Thread:
    """Print the output of a stage, each line after the stage's name."""

    def forward() -> None:
        with cast(IO[bytes], process.stdout) as lines:
            for line in lines:
                print(f"{name} | {line.decode(errors='replace')}", end="", flush=True)

    thread = threading.Thread(target=forward)
    thread.start()
    return thread
