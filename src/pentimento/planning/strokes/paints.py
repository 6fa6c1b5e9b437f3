"""From free colours to paints that a person mixes: which paints, which paint each stroke takes, and in which order.

The strokes of a plan overlap in the order in which they were optimised, coarse below fine. Sorting them from light to
dark (thesis 4.3.5) changes the picture wherever a lighter stroke lay over a darker one. Here the brush goes through the
paints from light to dark several times (sweeps). A stroke waits for those under it: in the same sweep if their paint is
its own or lighter, until the next sweep if it is darker. Where this needs more sweeps than allowed, the overlaps that
show least are ignored.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.colour import linear_to_srgb, srgb_to_lab, srgb_to_linear
from pentimento.contracts.errors import ConfigError
from pentimento.planning.strokes.config import PlanConfig
from pentimento.planning.strokes.palette import (
    PaletteChoice,
    light_first,
    nearest_paint,
    picture_palette,
    salient_palette,
)
from pentimento.planning.strokes.paths import PlannedPaths
from pentimento.planning.strokes.render_plan import coverages, render_and_back, render_plan
from pentimento.planning.strokes.scene import Scene, objective_for
from pentimento.render.coverage import compiled
from pentimento.robots.tools import Tool

Array = NDArray[np.float32]
FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Mask = NDArray[np.bool_]
S = TypeVar("S", bound=PlannedPaths)

_COVER_PX = 80
"""Width of the picture in which overlaps of strokes are measured."""
DARKEST = 0.01
"""Linear light of the darkest paint: a black acrylic reflects about a hundredth of the light at its surface."""
_HIDDEN = 1e-3
"""Weight of a hidden stroke's colour, as a share of the mean: it has a paint, and no say in which paints there are."""


@dataclass(frozen=True, eq=False)
class Paints:
    """Which paint each stroke takes."""

    linear: Array
    """[K, 3] linear light. ``optimise`` moves it in place where the palette comes from the plan."""
    index: IntArray
    """[S]."""
    fixed: Mask
    """[K] whether ``optimise`` leaves a paint as it is. Its few strokes could not keep a salient colour: other
    strokes that take the paint would pull it towards their own.
    """

    def srgb(self) -> FloatArray:
        """[K, 3]."""
        return np.clip(linear_to_srgb(self.linear.astype(np.float64)), 0.0, 1.0)

    def dipped(self, strokes: S) -> S:
        """The strokes in the colours of their paints."""
        return strokes.colored(self.linear[self.index])


def check_palette(choice: PaletteChoice, tool: Tool) -> None:
    """Check that the palette fits the tool.

    Raises:
        ConfigError: the palette has paints and the tool its own ink, or neither has any.
    """
    if (choice.source == "ink") != (tool.color_srgb is not None):
        brings = "its own ink: set palette.source to ink" if tool.color_srgb else "none: choose another palette.source"
        raise ConfigError(f"The palette's source is {choice.source}, but the {tool.name} brings {brings}.")


def choose_paints(strokes: PlannedPaths, scene: Scene, choice: PaletteChoice, seed: int) -> Paints:
    """The paints of ``choice``, and for each stroke the one nearest to its colour in L*a*b*."""
    colors, fixed = linear_to_srgb(strokes.color).astype(np.float64), None
    match choice.source:
        case "plan":
            seen = visible(coverages(strokes, scene, _COVER_PX)).sum(1)
            palette, index, fixed = salient_palette(colors, seen + _HIDDEN * seen.mean(), choice.size or 1, seed)
        case "picture":
            palette = picture_palette(choice.picture or "", choice.size or 1, seed)
            index = nearest_paint(colors, palette)
        case "given":
            palette = light_first(np.array(choice.colors_srgb))
            index = nearest_paint(colors, palette)
        case "ink":
            raise AssertionError("A tool with its own ink takes no paints.")
    fixed = np.zeros(len(palette), dtype=bool) if fixed is None else fixed
    linear = srgb_to_linear(palette.astype(np.float32))
    return Paints(linear if choice.source == "given" else np.maximum(linear, np.float32(DARKEST)), index, fixed)


def in_order(strokes: S, paints: Paints, scene: Scene, config: PlanConfig) -> tuple[S, Paints]:
    """The strokes in the order of painting, and the paints from light to dark; see ``sweep_order``."""
    palette = paints.srgb()
    by_light = np.argsort(-srgb_to_lab(palette)[:, 0], kind="stable")
    light, index = palette[by_light], np.argsort(by_light)[paints.index]
    covers = coverages(strokes, scene, _COVER_PX)
    order = sweep_order(covers, light[index], index, config.sweeps)
    ordered = strokes.pick(order)
    ordered.inherited = None  # it was computed for another order
    return ordered, Paints(srgb_to_linear(light.astype(np.float32)), index[order], paints.fixed[by_light])


def repaint(strokes: S, paints: Paints, canvas: Array, scene: Scene, *, config: PlanConfig) -> tuple[S, Paints]:
    """Change the paint of strokes where that lowers the objective.

    The effect of a change is predicted to second order from the objective's gradient and from the visible area of the
    stroke. The most promising changes are tried together, then the better half of them, and so on. The first set that
    lowers the objective is kept. The objectives must include print or style; those of meaning do not count.
    """
    # Values of objectives of meaning do not compare.
    comparable = replace(config.objectives, semantic_weight=0.0, text=None)
    objective = objective_for(scene, replace(config, objectives=comparable))
    palette, srgb = linear_to_srgb(paints.linear), linear_to_srgb(strokes.color)
    image, back = render_and_back(strokes, canvas, scene)
    before, of_image = objective(image)
    slope = back(of_image)[-1] * _light_per_srgb(srgb)
    covers = coverages(strokes, scene, _COVER_PX)
    curvature = 2 / (3 * covers.shape[1]) * np.square(visible(covers)).sum(1)
    step = palette - srgb[:, None]
    change = (slope[:, None] * step).sum(-1) + 0.5 * curvature[:, None] * np.square(step).sum(-1)
    promise, wanted = change.min(1), change.argmin(1)
    candidates = np.argsort(promise, kind="stable")[: np.count_nonzero(promise < 0)]
    while len(candidates) > 0:
        index = paints.index.copy()
        index[candidates] = wanted[candidates]
        tried = replace(paints, index=index)
        if objective(render_plan(tried.dipped(strokes), canvas, scene))[0] < before:
            return tried.dipped(strokes), tried
        candidates = candidates[: len(candidates) // 2]
    return strokes, paints


def sweep_order(covers: FloatArray, colors_srgb: FloatArray, paint: IntArray, sweeps: int) -> IntArray:
    """The order [S] of execution, as indices into the present order.

    Args:
        covers: [S, P] coverage of each pixel by each stroke, 0 to 1.
        colors_srgb: [S, 3] of the strokes.
        paint: [S] which paint each takes, numbered from light to dark.
        sweeps: largest number of passes through the paints; 1 is from light to dark throughout.
    """
    shows = overlaps(covers, colors_srgb)
    weights = np.unique(shows[shows > 0])
    low, high = 0, len(weights)  # number of weakest overlaps that are ignored
    while low < high:
        middle = (low + high) // 2
        if _sweeps(shows, paint, weights[middle - 1] if middle else 0.0).max(initial=0) < sweeps:
            high = middle
        else:
            low = middle + 1
    sweep = _sweeps(shows, paint, weights[low - 1] if low else 0.0)
    return np.lexsort((np.arange(len(paint)), paint, sweep))


def overlaps(covers: FloatArray, colors_srgb: FloatArray) -> FloatArray:
    """[S, S] how much it would show if stroke i lay over the later stroke j: visible overlap times squared colour
    difference.
    """
    difference = np.square(colors_srgb[:, None] - colors_srgb).sum(-1)
    return np.triu(_visible_overlap(covers, visible(covers)) * difference, k=1)


def visible(covers: FloatArray) -> FloatArray:
    """[S, P] share of each stroke in each pixel's light, under the strokes that lie over it."""
    shown = covers.copy()
    left = np.ones_like(covers[0])
    for s in range(len(covers) - 1, -1, -1):
        shown[s] *= left
        left *= 1 - covers[s]
    return shown


def _light_per_srgb(srgb: Array) -> Array:
    """Derivative of linear light with respect to sRGB, elementwise."""
    return np.where(srgb <= 0.04045, 1 / 12.92, 2.4 / 1.055 * ((srgb + 0.055) / 1.055) ** 1.4).astype(srgb.dtype)


@compiled
def _sweeps(shows: FloatArray, paint: IntArray, ignored: float) -> IntArray:
    """[S] the sweep of each stroke, where overlaps up to ``ignored`` do not count."""
    sweep = np.zeros(len(paint), np.int64)
    for i in range(len(paint)):
        for j in range(i + 1, len(paint)):
            if shows[i, j] > ignored:
                sweep[j] = max(sweep[j], sweep[i] + (1 if paint[i] > paint[j] else 0))
    return sweep


@compiled
def _visible_overlap(covers: FloatArray, shown: FloatArray) -> FloatArray:
    """[S, S] covers @ shown.T, pixel by pixel: few strokes cover one."""
    total = np.zeros((len(covers), len(covers)))
    here = np.empty(len(covers), np.int64)
    for p in range(covers.shape[1]):
        count = 0
        for s in range(len(covers)):
            if covers[s, p] > 0.0:
                here[count] = s
                count += 1
        for i in range(count):
            for j in range(i, count):
                total[here[i], here[j]] += covers[here[i], p] * shown[here[j], p]
    return total
