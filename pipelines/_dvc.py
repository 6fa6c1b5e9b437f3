"""DVC as a child process, which ends with us and hears our signals."""

import os
import signal
import subprocess
import sys
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from pipelines._io import end_with_parent

Process = subprocess.Popen[bytes]


def start_dvc(arguments: list[str], folder: Path, **options: Any) -> Process:
    """Start DVC in `folder`, with the Python at work first in the path; `options` are of `subprocess.Popen`."""
    here = str(Path(sys.executable).parent)
    environment = os.environ | {"PATH": f"{here}{os.pathsep}{os.environ.get('PATH', os.defpath)}"}
    command = [sys.executable, "-m", "dvc", *arguments]
    return subprocess.Popen(
        command, cwd=folder, env=environment, preexec_fn=end_with_parent, process_group=0, **options
    )


@contextmanager
def signals_passed_on(processes: Collection[Process]) -> Iterator[list[int]]:
    """Pass Ctrl-C and SIGTERM on to what `start_dvc` started; yield the list of those that came."""
    received: list[int] = []

    def receive(number: int, _frame: object) -> None:
        received.append(number)
        send(processes, number)

    previous = {number: signal.signal(number, receive) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield received
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)


def send(processes: Collection[Process], number: int) -> None:
    """Send a signal to those that still run, and to the stages that they run."""
    for process in processes:
        if process.poll() is None:
            os.killpg(process.pid, number)


def run_dvc(arguments: list[str], folder: Path) -> int:
    """Run DVC in `folder` and return its exit status, 130 after Ctrl-C, 143 after SIGTERM."""
    process = start_dvc(arguments, folder)
    with signals_passed_on([process]) as received:
        status = process.wait()
    return 128 + received[0] if received else abs(status)


def ask_dvc(arguments: list[str], folder: Path) -> str:
    """Return what DVC prints, empty where it fails."""
    output, _ = start_dvc(arguments, folder, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL).communicate()
    return output.decode()
