"""What `pentimento doctor` looks at in any installation: Python, cores, memory, disk, GPU, browser, ports, extras."""

from __future__ import annotations

import importlib.metadata
import os
import re
import shutil
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

MIN_PYTHON: Final = (3, 11)
GIB: Final = 2**30
_MIN_CORES: Final = 2
_FEW_GIB: Final = {"memory": 4, "disk": 5}
"""Below it two stages at a time, or outputs and cache, may not fit."""
_MIN_DISK_GIB: Final = 1
_BROWSERS: Final = ("chromium", "chromium-browser", "google-chrome", "firefox")
_PORTS: Final = ("ttyUSB*", "ttyACM*")
REINSTALL_TORCH: Final = "pip install --force-reinstall --no-deps -c constraints.txt torch"
_EXTRA: Final = re.compile(r"^([\w.-]+).*extra == ['\"]([\w.-]+)['\"]")


@dataclass(frozen=True)
class Finding:
    """One line of the command."""

    state: Literal["ok", "note", "wrong"]
    """`note`: something is missing, and what needs it is said. `wrong`: `make repro` cannot run."""
    part: str
    text: str
    mend: str | None = None
    """A command."""


def computer(root: Path) -> list[Finding]:
    """Look at this computer; `root` is the folder whose disk counts."""
    return [_python(), _cores(), _memory(), disk(shutil.disk_usage(root).free, root), _gpu(), _browser(),
            ports(Path("/dev")), _extras()]  # fmt: skip


def _python() -> Finding:
    version = ".".join(map(str, sys.version_info[:3]))
    if sys.version_info[:2] < MIN_PYTHON:
        return Finding("wrong", "Python", f"{version}; 3.11 or later is needed.", "make env PYTHON=python3.11")
    return Finding("ok", "Python", f"{version}, {sys.executable}.")


def _cores() -> Finding:
    usable = len(os.sched_getaffinity(0))
    if usable < _MIN_CORES:
        return Finding("note", "cores", f"{usable}; the times in the documentation are of {_MIN_CORES}.")
    return Finding("ok", "cores", f"{usable}.")


def _memory() -> Finding:
    lines = dict(line.split(":", 1) for line in Path("/proc/meminfo").read_text(encoding="utf-8").splitlines())
    free = 1024 * int(lines["MemAvailable"].split()[0])
    limit = Path("/sys/fs/cgroup/memory.max")
    if limit.is_file() and (text := limit.read_text(encoding="utf-8").strip()).isdigit():  # of a container
        free = min(free, int(text))
    text = f"{free / GIB:.1f} GiB free."
    if free < _FEW_GIB["memory"] * GIB:
        return Finding("note", "memory", f"{text} Two stages at a time may not fit into it; end other programs.")
    return Finding("ok", "memory", text)


def disk(free: int, folder: Path) -> Finding:
    """Judge the free bytes of the disk that holds `folder`."""
    text = f"{free / GIB:.1f} GiB free at {folder}."
    if free >= _FEW_GIB["disk"] * GIB:
        return Finding("ok", "disk", text)
    mend = "dvc gc --workspace"
    if free < _MIN_DISK_GIB * GIB:
        return Finding("wrong", "disk", f"{text} Outputs would not fit; remove files, such as old outputs.", mend)
    return Finding("note", "disk", f"{text} That is little for outputs of several settings.", mend)


def _gpu() -> Finding:
    present = next(Path("/dev").glob("nvidia[0-9]*"), None)
    try:
        import torch
    except Exception:  # whatever a broken library raises; the line on PyTorch says it
        used = None
    else:
        used = torch.cuda.get_device_name() if torch.cuda.is_available() else None
    if used is not None:
        return Finding("ok", "GPU", f"{used}.")
    if present is not None:
        return Finding("note", "GPU", f"{present} is there, but PyTorch does not use it; install its CUDA build.",
                       REINSTALL_TORCH)  # fmt: skip
    return Finding("ok", "GPU", "none; none is needed.")


def _browser() -> Finding:
    found = next((path for name in _BROWSERS if (path := shutil.which(name))), None)
    if found is None:
        text = "none; pages (report, studio) have to be opened on another computer."
        return Finding("note", "browser", text, "sudo apt install chromium")
    return Finding("ok", "browser", f"{found}.")


def ports(devices: Path) -> Finding:
    """Look for serial ports in the folder of devices."""
    found = sorted(path for pattern in _PORTS for path in devices.glob(pattern))
    if not found:
        return Finding("ok", "serial ports", "none; a plotter would be /dev/ttyUSB0 or /dev/ttyACM0.")
    names = ", ".join(map(str, found))
    if closed := [path for path in found if not os.access(path, os.R_OK | os.W_OK)]:
        text = f"{', '.join(map(str, closed))} may not be opened by you."
        return Finding("note", "serial ports", text, f'sudo usermod -aG {closed[0].group()} "$USER", then log in again')
    if missing(["pyserial"]):
        return Finding("note", "serial ports", f"{names}; pyserial is missing (extra grbl).", install("grbl"))
    return Finding("ok", "serial ports", f"{names}.")


def _extras() -> Finding:
    """Name the extras whose packages are not all there."""
    lacking = {extra: names for extra, needed in extras() if (names := missing(needed))}
    lacking.pop("train", None)  # lines of their own
    apart = ""
    if lacking.pop("lerobot", None):
        apart = "lerobot needs an environment of its own (docs/on_a_robot.md, section 3)."
    if not lacking:
        return Finding("ok", "extras", f"all others are installed; {apart}" if apart else "all are installed.")
    listed = "; ".join(f"{extra} ({', '.join(names)})" for extra, names in lacking.items())
    return Finding("note", "extras", f"not installed, each only for what it is named after: {listed}. {apart}".rstrip(),
                   install(next(iter(lacking)) if len(lacking) == 1 else "NAME"))  # fmt: skip


def extras() -> Iterator[tuple[str, list[str]]]:
    """The package's extras, each with the distributions that it brings."""
    needed: dict[str, list[str]] = {}
    for requirement in importlib.metadata.requires("pentimento") or ():
        if match := _EXTRA.match(requirement):
            needed.setdefault(match[2], []).append(match[1])
    yield from needed.items()


def missing(distributions: Sequence[str]) -> list[str]:
    """Those of the distributions that are not installed."""
    return [name for name in distributions if version(name) is None]


def version(distribution: str) -> str | None:
    """Version of a distribution; None where it is not installed."""
    try:
        return importlib.metadata.version(distribution)
    except importlib.metadata.PackageNotFoundError:
        return None


def install(extra: str) -> str:
    """Command that installs an extra of the package, in a clone."""
    return f"pip install '.[{extra}]'"
