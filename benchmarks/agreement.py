"""Whether the fast renderer and the dense reference say the same, on the strokes that are timed."""

from typing import Any

import torch

from benchmarks.scenes import Case, as_painting, image_gradient, strokes_and_canvas
from pentimento.dynamics.strokes.autograd import render_strokes
from pentimento.dynamics.strokes.reference import render_reference

NAMES = ("points", "radius", "density", "softness", "colour", "canvas")


def measure_agreement(case: Case) -> dict[str, Any]:
    """Largest difference of the images; for each gradient the norm of the difference over the norm.

    Ours computes in float32, the reference in float64.
    """
    torch.set_num_threads(1)
    inputs = strokes_and_canvas(case)
    ours = [tensor.clone().requires_grad_() for tensor in inputs]
    exact = [tensor[0].double().requires_grad_() for tensor in inputs]
    pull = image_gradient(case, inputs[5])
    image, truth = render_strokes(*as_painting(*ours)), render_reference(*as_painting(*exact))
    gradients = torch.autograd.grad(image, ours, pull)
    true_gradients = torch.autograd.grad(truth, exact, pull[0].double())
    pairs = zip(NAMES, gradients, true_gradients, strict=True)
    return {
        "strokes": case.strokes,
        "points": case.points,
        "size_px": case.size_px,
        "values": float((image[0] - truth).abs().max().detach()),
        "gradients": {name: float((g[0] - true).norm() / true.norm()) for name, g, true in pairs},
    }
