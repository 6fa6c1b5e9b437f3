"""Gradient descent through the stroke renderer (thesis 4.3.5, Figure 4.5)."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from pentimento.planning.config import Log, PlannerConfig, Slack
from pentimento.planning.paints import Paints
from pentimento.planning.scene import Mishap, Scene, expected_mishap, inherit, mishaps, objective_for, render_plan
from pentimento.planning.strokes import StrokeTensors

_BETAS = (0.85, 0.97)
"""Adam's memory: runs are a few to tens of iterations long; with the usual .999 the start of each run rules all of
it."""


def optimise(
    strokes: StrokeTensors,
    canvas: Tensor,
    scene: Scene,
    config: PlannerConfig,
    iterations: int,
    free_color: bool,
    rate: float,
    log: Log,
    first_iteration: int,
    last_rate: float = 0.0,
    paints: Paints | None = None,
) -> None:
    """Move the strokes, in place, down the objective, always within what tool and canvas allow.

    They end where the objective was least on the way, so never worse than they started. Where the plan leaves room for
    mishaps, each iteration sees others, and start and end are compared under the expected ones. ``rate`` is a share of
    the learning rates; it falls to ``last_rate`` along half a cosine. With ``paints``, it is they whose colours are
    free: strokes of one paint share one colour. ``log("objective", value, iteration)`` is called at every iteration.
    """
    rates = config.learning_rates
    groups = [
        (strokes.middle_m, rates.middle_m),
        (strokes.theta_rad, rates.theta_rad),
        (strokes.length_m, rates.length_m),
        (strokes.bend_m, rates.bend_m),
        (strokes.press_m, rates.press_m),
    ]
    if free_color:
        groups.append((strokes.color if paints is None else paints.linear, rates.color))
    objective = objective_for(scene, config)
    strokes.inherited = inherit(strokes, scene, config.path_points)
    for tensor, _ in groups:
        tensor.requires_grad_(True)
    optimiser = torch.optim.Adam(
        [{"params": [tensor], "lr": step} for tensor, step in groups], betas=_BETAS, fused=True
    )
    rng = torch.Generator().manual_seed(1000 * config.seed + first_iteration)
    least, best, kept_paints = float("inf"), strokes.pick(slice(None)), None
    for iteration in range(iterations + 1):
        optimiser.zero_grad()
        if paints is not None:
            strokes.color = paints.linear[paints.index]
        mishap = _mishap(iteration in (0, iterations), len(strokes), config.slack, rng)
        loss = objective(render_plan(strokes, canvas, scene, config.path_points, mishap))
        value = float(loss.detach())
        if value < least and (not config.slack.any() or iteration in (0, iterations)):
            least, best = value, strokes.pick(slice(None))
            kept_paints = None if paints is None else paints.linear.detach().clone()
        if iteration == iterations:
            break
        share = half_cosine(iteration, iterations, rate, last_rate)
        for group, (_, step) in zip(optimiser.param_groups, groups, strict=True):
            group["lr"] = share * step
        loss.backward()  # type: ignore[no-untyped-call]
        optimiser.step()
        if paints is not None:
            strokes.color = strokes.color.detach()
            paints.linear.data.clamp_(0.0, 1.0)
        strokes.keep_within(scene.tool, scene.canvas_size_m, config.edge_m)
        log("objective", value, first_iteration + iteration)
    for tensor, _ in groups:
        tensor.requires_grad_(False)
    if paints is not None and kept_paints is not None:
        paints.linear.copy_(kept_paints)
        strokes.color = best.color
    for tensor, kept in zip(strokes.tensors(), best.tensors(), strict=True):
        tensor.copy_(kept)


def _mishap(judged: bool, strokes: int, slack: Slack, rng: torch.Generator) -> Mishap | None:
    if not slack.any():
        return None
    return expected_mishap(strokes, slack) if judged else mishaps(strokes, slack, rng)


def half_cosine(iteration: int, iterations: int, first: float, last: float) -> float:
    """From ``first`` at iteration 0 to ``last`` at ``iterations``, level at both ends."""
    return float(last + (first - last) * 0.5 * (1 + np.cos(np.pi * iteration / iterations)))
