"""What the five sites for mechanisms cost where no mechanism does anything."""

from functools import partial

import torch
from torch import Tensor

from benchmarks.clock import in_turns
from benchmarks.scenes import Case, as_painting, image_gradient, strokes_and_canvas
from pentimento.dynamics.strokes.autograd import render_strokes
from pentimento.dynamics.strokes.simulation import Mechanism, StrokeContext, View, simulate
from pentimento.dynamics.strokes.traj2stroke import Mark

_ROUNDS = 60


class _Idle(Mechanism):
    """Called at every site, and does nothing."""

    cause, site, quantities = "idle", "density", ()


def measure_hooks(case: Case) -> dict[str, float]:
    """Seconds, forward + backward, of the bare renderer, and of ``simulate`` without and with an idle mechanism.

    The base model is a mark that is given, so that only the sites are measured.
    """
    torch.set_num_threads(case.threads)
    points, radius, density, softness, color, canvas = strokes_and_canvas(case)
    pull = image_gradient(case, canvas)
    view = View(torch.tensor([[0.0, case.size_px]]), torch.ones(1))  # a pixel a metre
    points_m = torch.stack([points[..., 0] + 0.5, case.size_px - points[..., 1] - 0.5], dim=-1)
    leaves = [tensor.requires_grad_() for tensor in (points, radius, density, softness, color, canvas)]
    points_m.requires_grad_()
    in_metres = [points_m, *leaves[1:]]
    mark = Mark(points_m, radius, density, softness)
    context = StrokeContext(torch.zeros(1, case.strokes, case.points, 5), {})

    def bare() -> tuple[Tensor, ...]:
        return torch.autograd.grad(render_strokes(*as_painting(*leaves)), leaves, pull)

    def simulated(mechanisms: tuple[Mechanism, ...]) -> tuple[Tensor, ...]:
        image = simulate(lambda _: mark, mechanisms, context, color=color, canvas=canvas, view=view)
        return torch.autograd.grad(image, in_metres, pull)

    calls = [bare, partial(simulated, ()), partial(simulated, (_Idle(torch.zeros(0), {}),))]
    in_turns(calls, 3)
    plain, none, idle = in_turns(calls, _ROUNDS)
    return {
        "bare_s": plain.minimum_s,
        "no_mechanism_s": none.minimum_s,
        "idle_mechanism_s": idle.minimum_s,
        "no_mechanism_over": none.minimum_s / plain.minimum_s - 1,
        "idle_mechanism_over": idle.minimum_s / plain.minimum_s - 1,
    }
