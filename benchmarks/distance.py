"""How far the renderer is from the machine's limit: evaluations against ink, and time against a loop without branches.

All by one thread, forward + backward with all gradients, in turns with the loops of ``limit``.
"""

from functools import partial
from typing import Any

import numpy as np

from benchmarks.clock import in_turns
from benchmarks.limit import (
    BLOCK,
    FIELDS,
    forward_backward_pairs,
    forward_pairs,
    packed_instructions,
    random_pairs,
    touched_pairs,
)
from benchmarks.scenes import Case, as_painting, image_gradient, strokes_and_canvas
from pentimento.render import render, render_backward

CACHED_BLOCKS = 8
"""Of 40 kB each: read from and written to the second-level cache, as the renderer's own working set is."""
_ROUNDS = 30


def measure_distance(case: Case) -> dict[str, Any]:
    """Pairs and seconds of one case, and of the loops for as many pairs."""
    inputs = [tensor.numpy() for tensor in strokes_and_canvas(case)]
    pull = image_gradient(case, strokes_and_canvas(case)[5]).numpy()
    strokes, canvas = as_painting(*inputs)
    fragments = render(strokes, canvas)[1]
    pairs = sum(band.evaluations for band in fragments[0])
    inked = sum(int(band.start[-1]) for band in fragments[0])
    touched = touched_pairs(inputs[0][0], inputs[1][0], case.size_px, case.size_px)
    cached, streamed = random_pairs(CACHED_BLOCKS, 0), random_pairs(-(-pairs // BLOCK), 1)
    passes = -(-pairs // (CACHED_BLOCKS * BLOCK))

    def ours() -> None:
        render_backward(strokes, render(strokes, canvas)[1], pull)

    calls = [
        ours,
        partial(forward_backward_pairs, cached, passes),
        partial(forward_pairs, cached, passes),
        partial(forward_backward_pairs, streamed, 1),
    ]
    in_turns(calls, 2)
    kernel, both, forward, from_memory = (times.minimum_s for times in in_turns(calls, _ROUNDS))
    per_both = both / (passes * CACHED_BLOCKS * BLOCK)
    per_forward = forward / (passes * CACHED_BLOCKS * BLOCK)
    minimum = (pairs - inked) * per_forward + inked * per_both
    return {
        "strokes": case.strokes,
        "points": case.points,
        "size_px": case.size_px,
        "evaluations": pairs,
        "touched": touched,
        "evaluations_per_touched": pairs / touched,
        "fragments": inked,
        "kernel_s": kernel,
        "kernel_ns_per_pair": 1e9 * kernel / pairs,
        "limit_ns_per_pair": 1e9 * per_both,
        "limit_forward_ns_per_pair": 1e9 * per_forward,
        "limit_from_memory_ns_per_pair": 1e9 * from_memory / (len(streamed) * BLOCK),
        "times_limit": kernel / pairs / per_both,
        "times_least_work": kernel / minimum,
        "packed_instructions": packed_instructions(forward_backward_pairs),
        "bytes_per_pair": FIELDS * np.dtype(np.float32).itemsize,
    }
