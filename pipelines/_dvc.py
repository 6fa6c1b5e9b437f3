"""DVC as a child process that ends with its parent and receives its signals, and a dvc.lock cut off by a crash."""

import fcntl
import os
import signal
import subprocess
import sys
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from pentimento.contracts.errors import ConfigError
from pipelines._io import end_with_parent
from pipelines._params import read_yaml

Process = subprocess.Popen[bytes]


def start_dvc(arguments: list[str], folder: Path, **options: Any) -> Process:
    """Start DVC in `folder`, with this Python first in the path; `options` go to `subprocess.Popen`."""
    here = str(Path(sys.executable).parent)
    environment = os.environ | {"PATH": f"{here}{os.pathsep}{os.environ.get('PATH', os.defpath)}"}
    command = [sys.executable, "-m", "dvc", *arguments]
    return subprocess.Popen(
        command, cwd=folder, env=environment, preexec_fn=end_with_parent, process_group=0, **options
    )


@contextmanager
def signals_passed_on(processes: Collection[Process]) -> Iterator[list[int]]:
    """Forward Ctrl-C and SIGTERM to processes of `start_dvc`; yield the list of the signals received so far."""
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
    """Send a signal to the processes that still run, and to the stages that they run."""
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


def put_aside_broken_lock(folder: Path) -> None:
    """Rename a dvc.lock in `folder` that DVC cannot read, and report it.

    DVC empties the file before it writes it, so that a power cut or `kill -9` can leave it incomplete. Without the
    file, DVC finds the stages' outputs in its cache.
    """
    from dvc.schema import COMPILED_LOCKFILE_SCHEMA
    from voluptuous import Invalid

    file, lock = folder / "dvc.lock", folder / ".dvc/tmp/lock"
    if not file.is_file() or not lock.is_file():  # no DVC ever ran here
        return
    with lock.open(encoding="utf-8") as held:
        fcntl.flock(held, fcntl.LOCK_SH)  # another DVC may be writing it
        try:
            COMPILED_LOCKFILE_SCHEMA(read_yaml(file))
        except (ConfigError, Invalid) as error:
            aside = file.with_name("dvc.lock.broken")
            os.replace(file, aside)
            print(
                f"make repro: {file} cannot be read ({error}) and was renamed to {aside.name}. The outputs of its "
                "stages are taken from DVC's cache.",
                file=sys.stderr,
            )
