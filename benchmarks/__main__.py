"""The stroke renderer, forward and backward with all gradients, beside the dense reference: seconds, one thread.

Strokes are 20 to 60 px long with radii of 1.5 to 5 px. The reference evaluates every segment at every pixel and is
timed once, up to 20 strokes; more would take minutes and say the same.
"""

import statistics
import time
from collections.abc import Callable
from functools import partial

import numpy as np
import torch

from pentimento.stroke_dynamics.autograd import render_strokes
from pentimento.stroke_dynamics.reference import render_reference

CASES = ((20, 32, 256), (100, 32, 256), (400, 32, 256), (400, 4, 256), (4000, 32, 1024))
DENSE_UP_TO = 20


def main() -> None:
    """Print the table."""
    torch.set_num_threads(1)
    _seconds(partial(_forward_backward, render_strokes, _scene(2, 4, 32)), 1)  # compile
    print("| strokes | points | canvas | ours s | dense reference s | ratio |\n|---|---|---|---|---|---|")
    for strokes, points, size in CASES:
        scene = _scene(strokes, points, size)
        ours = _seconds(partial(_forward_backward, render_strokes, scene), 9)
        dense, ratio = "–", "–"
        if strokes <= DENSE_UP_TO:
            seconds = _seconds(partial(_forward_backward, _dense, scene), 1)
            dense, ratio = f"{seconds:.2f}", f"{seconds / ours:.0f}"
        print(f"| {strokes} | {points} | {size}² | {ours:.4f} | {dense} | {ratio} |", flush=True)


def _scene(strokes: int, points: int, size: int) -> list[torch.Tensor]:
    rng = np.random.default_rng(strokes)
    length, heading = rng.uniform(20, 60, (strokes, 1)), rng.uniform(-np.pi, np.pi, (strokes, 1))
    t = np.linspace(0, 1, points)
    along, across = length * t, length * rng.uniform(-0.3, 0.3, (strokes, 1)) * 4 * t * (1 - t)
    x = np.cos(heading) * along - np.sin(heading) * across + rng.uniform(0, size, (strokes, 1))
    y = np.sin(heading) * along + np.cos(heading) * across + rng.uniform(0, size, (strokes, 1))
    arrays = (
        np.stack([x, y], axis=-1)[None],
        np.repeat(rng.uniform(1.5, 5, (1, strokes, 1)), points, axis=2),
        np.ones((1, strokes, points)),
        np.full((1, strokes, points), 0.3),
        rng.uniform(0, 1, (1, strokes, 3)),
        np.ones((1, size, size, 3)),
    )
    return [torch.tensor(array, dtype=torch.float32, requires_grad=True) for array in arrays]


def _dense(*inputs: torch.Tensor) -> torch.Tensor:
    return render_reference(*(tensor[0] for tensor in inputs))


def _forward_backward(renderer: Callable[..., torch.Tensor], scene: list[torch.Tensor]) -> None:
    torch.autograd.grad(renderer(*scene).square().sum(), scene)


def _seconds(call: Callable[[], None], runs: int) -> float:
    """Median wall time of a call."""
    times = []
    for _ in range(runs):
        started = time.perf_counter()
        call()
        times.append(time.perf_counter() - started)
    return statistics.median(times)


if __name__ == "__main__":
    main()
