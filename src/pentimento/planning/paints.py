"""From free colours to paints that a person mixes: which they are, and which each stroke takes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pentimento.contracts.errors import ConfigError
from pentimento.planning.config import PlannerConfig
from pentimento.planning.ordering import sweep_order, visible
from pentimento.planning.palette import PaletteChoice, cluster_palette, light_first, nearest_paint, picture_palette
from pentimento.planning.scene import Scene, coverages, objective_for, render_plan
from pentimento.planning.strokes import StrokeTensors
from pentimento.robots.tools import Tool
from pentimento.stroke_dynamics.photometry import linear_to_srgb, srgb_to_linear

FloatArray = NDArray[np.float64]

_COVER_PX = 80
"""Width at which strokes are laid over each other to see which hides which."""


@dataclass(frozen=True)
class Paints:
    """Which paint each stroke takes."""

    linear: Tensor
    """[K, 3] linear light; a leaf that ``optimise`` moves in place where the paints are the plan's own."""
    index: Tensor
    """[S]."""

    def srgb(self) -> FloatArray:
        """[K, 3]."""
        return linear_to_srgb(self.linear.detach().double()).clamp(0.0, 1.0).numpy()

    def dipped(self, strokes: StrokeTensors) -> StrokeTensors:
        """The strokes in their paints."""
        return strokes.colored(self.linear.detach()[self.index])


def check_palette(choice: PaletteChoice, tool: Tool) -> None:
    """Whether the paints are for this tool.

    Raises:
        ConfigError: a tool with its own ink is to be dipped, or one without is not.
    """
    if (choice.source == "ink") != (tool.color_srgb is not None):
        brings = "its own ink: set palette.source to ink" if tool.color_srgb else "none: choose another palette.source"
        raise ConfigError(f"The palette's source is {choice.source}, but the {tool.name} brings {brings}.")


def choose_paints(strokes: StrokeTensors, choice: PaletteChoice, seed: int) -> Paints:
    """The paints of ``choice``, and for each stroke the one nearest to its colour in L*a*b*."""
    colors = linear_to_srgb(strokes.color).double().numpy()
    match choice.source:
        case "plan":
            covered = (strokes.length_m * (1e-3 + strokes.press_m.mean(1))).numpy()
            palette, index = cluster_palette(colors, covered, choice.size or 1, seed)
        case "picture":
            palette = picture_palette(choice.picture or "", choice.size or 1, seed)
            index = nearest_paint(colors, palette)
        case "given":
            palette = light_first(np.array(choice.colors_srgb))
            index = nearest_paint(colors, palette)
        case "ink":
            raise AssertionError("A tool with its own ink takes no paints.")
    return Paints(srgb_to_linear(torch.tensor(palette, dtype=torch.float32)), torch.from_numpy(index))


def in_order(
    strokes: StrokeTensors, paints: Paints, scene: Scene, config: PlannerConfig
) -> tuple[StrokeTensors, Paints]:
    """The strokes in the order of painting, the paints from light to dark; see ``ordering``."""
    palette = paints.srgb()
    light = light_first(palette)
    rank = np.array([int(np.flatnonzero((light == color).all(1))[0]) for color in palette])
    index = rank[paints.index.numpy()]
    covers = coverages(strokes, scene, config.path_points, _COVER_PX)
    order = torch.from_numpy(sweep_order(covers, light[index], index, config.sweeps))
    light_linear = srgb_to_linear(torch.tensor(light, dtype=torch.float32))
    ordered = strokes.pick(order)
    ordered.inherited = None  # it was another order in which they inherited it
    return ordered, Paints(light_linear, torch.from_numpy(index)[order])


def repaint(
    strokes: StrokeTensors, paints: Paints, canvas: Tensor, scene: Scene, config: PlannerConfig
) -> tuple[StrokeTensors, Paints]:
    """Strokes exchange their paint where the painting, not the stroke, gets better by it.

    What an exchange changes is foretold to second order from the objective's gradient and from how much of the stroke
    shows. The most promising are tried together, then half as many, and so on; what raises the objective is not done.
    """
    objective = objective_for(scene, config)
    palette = linear_to_srgb(paints.linear.detach())
    srgb = linear_to_srgb(strokes.color).requires_grad_(True)
    loss = objective(render_plan(strokes.colored(srgb_to_linear(srgb)), canvas, scene, config.path_points))
    (slope,) = torch.autograd.grad(loss, srgb)
    covers = coverages(strokes, scene, config.path_points, _COVER_PX)
    curvature = 2 / (3 * covers.shape[1]) * torch.from_numpy(np.square(visible(covers)).sum(1)).float()
    step = palette - srgb.detach()[:, None]
    change = (slope[:, None] * step).sum(-1) + 0.5 * curvature[:, None] * step.square().sum(-1)
    promise, wanted = change.min(1)
    candidates = torch.argsort(promise)[: int((promise < 0).sum())]
    while len(candidates) > 0:
        index = paints.index.clone()
        index[candidates] = wanted[candidates]
        tried = Paints(paints.linear, index)
        with torch.no_grad():
            now = objective(render_plan(tried.dipped(strokes), canvas, scene, config.path_points))
        if float(now) < float(loss.detach()):
            return tried.dipped(strokes), tried
        candidates = candidates[: len(candidates) // 2]
    return strokes, paints
