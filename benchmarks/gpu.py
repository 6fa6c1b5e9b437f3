"""The Triton kernel where a GPU is at hand: seconds, memory, and how near it is to moving only what it must."""

import time
from dataclasses import asdict
from importlib.util import find_spec
from itertools import product
from typing import Any

import torch

from benchmarks.clock import repeated
from benchmarks.scenes import Case, as_painting, image_gradient, strokes_and_canvas
from pentimento.dynamics.strokes.autograd import render_strokes

CASES = [Case(strokes, 32, size) for strokes, size in product((400, 4000), (512, 1024))]
_COPIED_BYTES = 1 << 29
_BUDGET_S = 1.0
_MB = 1e6


def missing() -> str | None:
    """Why nothing can be measured here, as a sentence; None where it can."""
    if not torch.cuda.is_available():
        return "No GPU was at hand, so the Triton kernel was not measured."
    if find_spec("triton") is None:
        return "A GPU was at hand but Triton is not installed, so its kernel was not measured."
    return None


def measure_gpu(case: Case) -> dict[str, Any]:
    """One row of the table, measured in this process.

    ``bandwidth_share`` is the time in which the memory could move what any renderer must at least (canvas in, image
    out, the image's gradient in, the canvas's out, strokes in and their gradients out), over the time taken.
    """
    inputs = [tensor.cuda() for tensor in strokes_and_canvas(case)]
    pull = image_gradient(case, inputs[5].cpu()).cuda()
    leaves = [tensor.clone().requires_grad_() for tensor in inputs]

    def forward() -> None:
        with torch.no_grad():
            render_strokes(*as_painting(*inputs))
        torch.cuda.synchronize()

    def forward_backward() -> None:
        torch.autograd.grad(render_strokes(*as_painting(*leaves)), leaves, pull)
        torch.cuda.synchronize()

    forward(), forward_backward()  # compile
    torch.cuda.reset_peak_memory_stats()
    before = torch.cuda.memory_allocated()
    times = repeated(forward_backward, _BUDGET_S)
    at_least = 2 * sum(tensor.nbytes for tensor in inputs) + 2 * inputs[5].nbytes
    return asdict(case) | {
        "forward": repeated(forward, _BUDGET_S)._asdict(),
        "forward_backward": times._asdict(),
        "peak_mb": (torch.cuda.max_memory_allocated() - before) / _MB,
        "bandwidth_share": at_least / (bandwidth_bytes_s() * times.median_s),
    }


def bandwidth_bytes_s() -> float:
    """Bytes read and written a second by a plain copy on the device."""
    source = torch.zeros(_COPIED_BYTES, dtype=torch.uint8, device="cuda")
    target = torch.empty_like(source)
    fastest = float("inf")
    for _ in range(10):
        torch.cuda.synchronize()
        started = time.perf_counter()
        target.copy_(source)
        torch.cuda.synchronize()
        fastest = min(fastest, time.perf_counter() - started)
    return 2 * _COPIED_BYTES / fastest
