"""What the figures were measured on: processor, memory, libraries; neither host names nor paths."""

import os
import platform
from importlib.metadata import version
from pathlib import Path
from typing import Any

import torch

_LIBRARIES = ("numpy", "numba", "llvmlite", "torch")


def describe() -> dict[str, Any]:
    """The machine as far as it matters to speed."""
    return {
        "cpu": _cpu(),
        "cores": len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count(),
        "memory_gb": round(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") / 1e9),
        "gpu": torch.cuda.get_device_name() if torch.cuda.is_available() else None,
        "python": platform.python_version(),
        "libraries": {name: version(name).partition("+")[0] for name in _LIBRARIES},
    }


def _cpu() -> str:
    """Name, family and model: virtual machines often hide the number on the box."""
    file = Path("/proc/cpuinfo")
    if not file.is_file():
        return platform.processor() or platform.machine()
    lines = (line.partition(":") for line in file.read_text().splitlines())
    facts: dict[str, str] = {}
    for key, _, value in lines:
        facts.setdefault(key.strip(), value.strip())
    name = facts.get("model name", platform.machine())
    if "model" not in facts:
        return name
    vectors = (
        "AVX-512" if "avx512f" in facts.get("flags", "") else "AVX2" if "avx2" in facts.get("flags", "") else "SSE"
    )
    return f"{name}, family {facts['cpu family']} model {facts['model']}, {vectors}"
