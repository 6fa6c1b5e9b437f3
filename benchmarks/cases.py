"""The renderer and the dense reference as a user calls them: seconds forward, forward + backward, and peak memory."""

from collections.abc import Callable
from dataclasses import asdict, replace
from itertools import product
from typing import Any

import torch
from torch import Tensor

from benchmarks import memory
from benchmarks.clock import repeated
from benchmarks.scenes import Case, as_painting, image_gradient, strokes_and_canvas
from pentimento.dynamics.strokes.autograd import render_strokes
from pentimento.dynamics.strokes.reference import render_reference

STROKES, SIZES_PX, POINTS, THREADS = (20, 100, 400, 1000, 4000), (256, 512, 1024), (4, 32), (1, 2)
CASES = [Case(*numbers) for numbers in product(STROKES, POINTS, SIZES_PX, THREADS)]
"""The plain grid."""
OTHER_CASES = [Case(400, 32, 256, threads, kind) for kind in ("varying", "pickup") for threads in THREADS]
REFERENCE_CASES = [Case(strokes, points, 256) for points in POINTS for strokes in (5, 10, 20)] + [Case(20, 4, 512)]
"""The reference evaluates every segment at every pixel and remembers it; more of either needs minutes and gigabytes."""
_BUDGET_S, _REFERENCE_BUDGET_S = 0.5, 1.0
_MB = 1e6


def measure_ours(case: Case) -> dict[str, Any]:
    """One row of the table, measured in this process."""
    return _measure(case, _ours, _BUDGET_S, minimum=7)


def measure_reference(case: Case) -> dict[str, Any]:
    """The same of the dense reference."""
    return _measure(case, _reference, _REFERENCE_BUDGET_S, minimum=2)


def _ours(*inputs: Tensor) -> Tensor:
    return render_strokes(*as_painting(*inputs))


def _reference(*inputs: Tensor) -> Tensor:
    return render_reference(*as_painting(*(tensor[0] for tensor in inputs)))[None]


def _measure(case: Case, renderer: Callable[..., Tensor], budget_s: float, minimum: int) -> dict[str, Any]:
    torch.set_num_threads(case.threads)
    inputs = strokes_and_canvas(case)
    leaves = [tensor.clone().requires_grad_() for tensor in inputs]
    pull = image_gradient(case, inputs[5])

    def forward() -> None:
        with torch.no_grad():
            renderer(*inputs)

    def forward_backward() -> None:
        torch.autograd.grad(renderer(*leaves), leaves, pull)

    _warm(case, renderer)
    before = memory.forget_peak()
    forward_backward()
    peak_mb = None if before is None else (memory.peak() - before) / _MB
    backward = repeated(forward_backward, budget_s, minimum)
    return asdict(case) | {
        "forward": repeated(forward, budget_s, minimum)._asdict(),
        "forward_backward": backward._asdict(),
        "peak_mb": peak_mb,
    }


def _warm(case: Case, renderer: Callable[..., Tensor]) -> None:
    """Compile, and start threads: a stroke or two on a small canvas of the same kind."""
    few = replace(case, strokes=2, size_px=130)
    leaves = [tensor.requires_grad_() for tensor in strokes_and_canvas(few)]
    for _ in range(2):
        torch.autograd.grad(
            renderer(*leaves), leaves, image_gradient(few, leaves[5])
        )  # with one, autograd imports more
