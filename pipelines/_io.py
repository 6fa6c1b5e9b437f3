"""Outputs of stages that are complete or absent, and failures as one sentence."""

import argparse
import ctypes
import json
import math
import multiprocessing
import os
import shutil
import signal
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Any, NoReturn

import numpy as np

from pentimento.contracts.atomic import atomic_folder, atomic_write, check_place
from pentimento.contracts.errors import PentimentoError
from pentimento.contracts.output import escape_unknown_letters

FAILED = 1
INTERRUPTED = 130  # 128 + SIGINT, as shells count
TERMINATED = 143  # 128 + SIGTERM
_PR_SET_PDEATHSIG = 1  # <linux/prctl.h>


@contextmanager
def output_folder(path: Path) -> Iterator[Path]:
    """Yield an empty folder that is renamed to `path` when the block ends, and removed when it raises.

    It is created beside `path`, so that renaming is atomic. Folders that a killed execution left there are removed
    first (DVC runs a stage once at a time). Raises `ConfigError` for the folder in which the stage runs, and those
    around it.
    """
    check_place(path)
    for abandoned in path.parent.glob(f".{path.name}.*.tmp"):
        shutil.rmtree(abandoned)
    try:
        with atomic_folder(path) as folder:
            yield folder
    except OSError as error:
        error.filename = error.filename or str(path)  # the error of a full disk has no path
        raise


def write_json(path: Path, value: Any) -> None:
    """Write `value` (mappings, sequences, numpy arrays and scalars) as deterministic JSON.

    Keys are sorted, and floats keep 9 significant digits, because further ones depend on the order of addition.
    Raises `PentimentoError` for a number that is not finite.
    """
    text = json.dumps(_plain(value, path.name), indent=2, sort_keys=True, ensure_ascii=False)
    atomic_write(path, (text + "\n").encode())


def verdict_metrics(path: Path, unit: str = "") -> dict[str, Any]:
    """Return the numbers of a verdict.json, errors with `unit` after their names; unknown ones are left out."""
    verdict = json.loads(path.read_text(encoding="utf-8"))
    mse = {f"{name}{unit}": verdict["mse"][name] for name in ("base", "extended", "floor")}
    metrics: dict[str, Any] = {
        "mse": {name: value for name, value in mse.items() if value is not None},
        "established": len(verdict["established"]),
        "suspected": len(verdict["suspected"]),
        "unexplained": len(verdict["unexplained"]),
    }
    if verdict["gap_closed"]["test"] is not None:
        metrics["gap_closed"] = verdict["gap_closed"]["test"]
    return metrics


def stage_main(main: Callable[[argparse.Namespace], None], parser: argparse.ArgumentParser) -> NoReturn:
    """Run a stage from the command line and exit: 0 done, 1 failed, 2 usage, 130 interrupted."""
    signal.signal(signal.SIGTERM, _terminate)  # scratch is removed on SIGTERM as it is on Ctrl-C
    end_with_parent()
    escape_unknown_letters()
    arguments = parser.parse_args()
    try:
        main(arguments)
    except (PentimentoError, OSError, MemoryError) as error:
        print(f"{parser.prog}: {failure_sentence(error)}", file=sys.stderr)
        sys.exit(FAILED)
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)
    sys.exit(0)


def single_threaded() -> None:
    """Let PyTorch compute on one thread, so that outputs do not depend on the number of cores.

    Sums then have one order. It costs no time: the tensors are small, and the renderer is not PyTorch's.
    """
    import torch

    torch.set_num_threads(1)
    torch.set_deterministic_debug_mode("error")  # use_deterministic_algorithms would load a compiler for seconds


def failure_sentence(error: BaseException) -> str:
    """Describe an error in one line: what, where, and for errors of the operating system what to do."""
    if isinstance(error, MemoryError):
        return f"memory is exhausted ({error}); use a coarser resolution (pixels_per_m) or fewer strokes."
    if not isinstance(error, OSError):
        return " ".join(str(error).split()) or type(error).__name__
    where = f" {error.filename}" if error.filename else ""
    match error:
        case FileNotFoundError():
            return f"cannot find{where}; run `make repro`, which creates missing outputs, or correct the path."
        case PermissionError():
            return f"no permission for{where}; change the owner or the mode of that place."
        case _ if error.errno is not None:
            what = os.strerror(error.errno) + (f" at{where}" if where else "")
            return f"{what}; nothing half-written was left. Correct it and run again."
        case _:
            return " ".join(str(error).split()) or type(error).__name__


def end_with_parent() -> None:
    """Receive SIGTERM when the parent process dies (on Linux), so that `kill -9` leaves no orphan."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
        parent = multiprocessing.parent_process()
        if parent is not None and not parent.is_alive():  # it died while this process was starting
            signal.raise_signal(signal.SIGTERM)


def _terminate(_number: int, _frame: FrameType | None) -> NoReturn:
    sys.exit(TERMINATED)


def _plain(value: Any, where: str) -> Any:
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {str(key): _plain(entry, f"{where}: {key}") for key, entry in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [_plain(entry, where) for entry in value]
    if isinstance(value, float):
        if not math.isfinite(value):
            raise PentimentoError(f"{where} is {value}, which is not a finite result; check what computed it.")
        return float(f"{value:.9g}")
    return value
