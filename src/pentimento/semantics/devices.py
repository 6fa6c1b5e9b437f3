"""The device on which networks compute outside of training, its precision, and batches that fit into its memory.

The device belongs to a machine and not to an experiment, so it is no parameter: the environment variable
`PENTIMENTO_DEVICE` names it, for every process of the machine. Results of devices differ by rounding.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Callable
from functools import cache
from typing import Final, Literal, TypeVar

import torch

from pentimento.contracts.errors import ConfigError, PentimentoError

T = TypeVar("T")
Precision = Literal["32-true", "bf16-mixed", "16-mixed"]
"""Lightning's names: weights in float32, and products in float32, bfloat16 or float16."""

VARIABLE: Final = "PENTIMENTO_DEVICE"
_NAMES: Final = ("cpu", "cuda", "mps", "auto")
# Of cuBLAS, read at its start: without it PyTorch refuses products on a GPU where results must be reproducible.
_WORKSPACE: Final = ("CUBLAS_WORKSPACE_CONFIG", ":4096:8")


def chosen_device() -> torch.device:
    """The device named by `PENTIMENTO_DEVICE`: cpu, cuda, mps, or auto for the first of cuda, mps and cpu that exists.

    Without the variable it is the CPU.

    Raises:
        ConfigError: another name, or a device that PyTorch does not find.
    """
    name = os.environ.get(VARIABLE) or "cpu"
    if name not in _NAMES:
        raise ConfigError(f"{VARIABLE} is {name!r}; it must be one of {', '.join(_NAMES)}.")
    there = {"cuda": torch.cuda.is_available(), "mps": torch.backends.mps.is_available(), "cpu": True}
    if name == "auto":
        name = next(device for device, is_there in there.items() if is_there)
    if not there[name]:
        raise ConfigError(
            f"{VARIABLE} is {name!r}, but PyTorch finds no such device; set it to cpu or auto, or install PyTorch's "
            "build for this device."
        )
    if name == "cuda":
        os.environ.setdefault(*_WORKSPACE)
    return torch.device(name)


@cache
def precision_on(device: str, wanted: Precision) -> Precision:
    """The precision in which a type of device (`cpu`, `cuda`, …) computes where `wanted` is configured.

    It is `wanted`, except for bf16-mixed on a CPU without instructions for bfloat16: PyTorch would emulate them, and
    a convolution would take tens of times as long as in float32. Such a CPU computes in float32, which is more exact
    and needs more memory. The first call says so in the log. Bfloat16 of ARM's CPUs was not measured and is not used.
    """
    if device != "cpu" or wanted != "bf16-mixed" or torch.cpu._is_avx512_bf16_supported():
        return wanted
    logging.getLogger(__name__).warning(
        "bf16-mixed is computed in float32, because this processor has no instructions for bfloat16 (avx512_bf16)."
    )
    return "32-true"


def in_batches(function: Callable[[slice], T], count: int, batch: int) -> list[T]:
    """`function` of consecutive slices of `count` items, of at most `batch` items each; of an empty one for no items.

    Where a slice does not fit into the device's memory, it and those after it are halved.

    Raises:
        PentimentoError: a single item does not fit.
    """
    parts: list[T] = []
    at = 0
    while at < count or not parts:
        size = min(batch, count - at)
        try:
            parts.append(function(slice(at, at + size)))
        except torch.OutOfMemoryError as error:
            if size == 1:
                raise PentimentoError(
                    f"The device has too little memory for a single picture ({str(error).splitlines()[0]}); end other "
                    f"programs on it, take smaller pictures, or set {VARIABLE}=cpu."
                ) from error
            batch = size // 2
        else:
            at += size
            continue
        torch.cuda.empty_cache()  # after the error, whose traceback holds what did not fit
    return parts
