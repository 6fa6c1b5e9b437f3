"""From free colours to paints that a person mixes: which they are, and which each stroke takes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.colour import linear_to_srgb, srgb_to_linear
from pentimento.contracts.errors import ConfigError
from pentimento.planning.config import PlannerConfig
from pentimento.planning.ordering import sweep_order, visible
from pentimento.planning.palette import PaletteChoice, cluster_palette, light_first, nearest_paint, picture_palette
from pentimento.planning.render_plan import coverages, render_and_back, render_plan
from pentimento.planning.scene import Scene, objective_for
from pentimento.planning.strokes import Strokes
from pentimento.robots.tools import Tool

Array = NDArray[np.float32]
FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_COVER_PX = 80
"""Width at which strokes are laid over each other to see which hides which."""


@dataclass(frozen=True, eq=False)
class Paints:
    """Which paint each stroke takes."""

    linear: Array
    """[K, 3] linear light; ``optimise`` moves it in place where the paints are the plan's own."""
    index: IntArray
    """[S]."""

    def srgb(self) -> FloatArray:
        """[K, 3]."""
        return np.clip(linear_to_srgb(self.linear.astype(np.float64)), 0.0, 1.0)

    def dipped(self, strokes: Strokes) -> Strokes:
        """The strokes in their paints."""
        return strokes.colored(self.linear[self.index])


def check_palette(choice: PaletteChoice, tool: Tool) -> None:
    """Whether the paints are for this tool.

    Raises:
        ConfigError: a tool with its own ink is to be dipped, or one without is not.
    """
    if (choice.source == "ink") != (tool.color_srgb is not None):
        brings = "its own ink: set palette.source to ink" if tool.color_srgb else "none: choose another palette.source"
        raise ConfigError(f"The palette's source is {choice.source}, but the {tool.name} brings {brings}.")


def choose_paints(strokes: Strokes, choice: PaletteChoice, seed: int) -> Paints:
    """The paints of ``choice``, and for each stroke the one nearest to its colour in L*a*b*."""
    colors = linear_to_srgb(strokes.color).astype(np.float64)
    match choice.source:
        case "plan":
            covered = (strokes.length_m * (1e-3 + strokes.press_m.mean(1))).astype(np.float64)
            palette, index = cluster_palette(colors, covered, choice.size or 1, seed)
        case "picture":
            palette = picture_palette(choice.picture or "", choice.size or 1, seed)
            index = nearest_paint(colors, palette)
        case "given":
            palette = light_first(np.array(choice.colors_srgb))
            index = nearest_paint(colors, palette)
        case "ink":
            raise AssertionError("A tool with its own ink takes no paints.")
    return Paints(srgb_to_linear(palette.astype(np.float32)), index)


def in_order(strokes: Strokes, paints: Paints, scene: Scene, config: PlannerConfig) -> tuple[Strokes, Paints]:
    """The strokes in the order of painting, the paints from light to dark; see ``ordering``."""
    palette = paints.srgb()
    light = light_first(palette)
    rank = np.array([int(np.flatnonzero((light == color).all(1))[0]) for color in palette])
    index = rank[paints.index]
    covers = coverages(strokes, scene, _COVER_PX)
    order = sweep_order(covers, light[index], index, config.sweeps)
    ordered = strokes.pick(order)
    ordered.inherited = None  # it was another order in which they inherited it
    return ordered, Paints(srgb_to_linear(light.astype(np.float32)), index[order])


def repaint(
    strokes: Strokes, paints: Paints, canvas: Array, scene: Scene, config: PlannerConfig
) -> tuple[Strokes, Paints]:
    """Strokes exchange their paint where the painting, not the stroke, gets better by it.

    What an exchange changes is foretold to second order from the objective's gradient and from how much of the stroke
    shows. The most promising are tried together, then half as many, and so on; what raises the objective is not done.
    """
    objective = objective_for(scene, config)
    palette, srgb = linear_to_srgb(paints.linear), linear_to_srgb(strokes.color)
    image, back = render_and_back(strokes, canvas, scene)
    before, of_image = objective(image)
    slope = back(of_image).color * _light_per_srgb(srgb)
    covers = coverages(strokes, scene, _COVER_PX)
    curvature = 2 / (3 * covers.shape[1]) * np.square(visible(covers)).sum(1)
    step = palette - srgb[:, None]
    change = (slope[:, None] * step).sum(-1) + 0.5 * curvature[:, None] * np.square(step).sum(-1)
    promise, wanted = change.min(1), change.argmin(1)
    candidates = np.argsort(promise, kind="stable")[: np.count_nonzero(promise < 0)]
    while len(candidates) > 0:
        index = paints.index.copy()
        index[candidates] = wanted[candidates]
        tried = Paints(paints.linear, index)
        if objective(render_plan(tried.dipped(strokes), canvas, scene))[0] < before:
            return tried.dipped(strokes), tried
        candidates = candidates[: len(candidates) // 2]
    return strokes, paints


def _light_per_srgb(srgb: Array) -> Array:
    """Slope of linear light over sRGB, elementwise."""
    return np.where(srgb <= 0.04045, 1 / 12.92, 2.4 / 1.055 * ((srgb + 0.055) / 1.055) ** 1.4).astype(srgb.dtype)
