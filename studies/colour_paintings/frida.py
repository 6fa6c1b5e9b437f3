"""FRIDA's planner (Schaldenbrand, McCann & Oh, ICRA 2023; thesis 4.3.5), written from its description.

Strokes are drawn uniformly over their parameters. Adam lowers the squared difference of sRGB (eq. 4.3), at a rate that
rises to the middle of the iterations and falls again. Strokes lie from the lightest to the darkest colour. From half of
the iterations on their colours are those of 12 clusters in L*a*b*. While painting, the same objective moves the
remaining strokes on each photograph.

The learning rates are the published ones: a step of 0.005 of half the sheet for places, 0.01 rad, 0.005 of sRGB.
Lengths and bends are taken in the same unit of half the sheet, presses as shares of the brush's range.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray

from pentimento.contracts.colour import linear_to_srgb, srgb_to_lab, srgb_to_linear
from pentimento.planning.strokes.bezier import Strokes
from pentimento.planning.strokes.config import PRINT_ALONE, ExecutionNoise, LearningRates, PlannerConfig
from pentimento.planning.strokes.initialise import random_strokes
from pentimento.planning.strokes.palette import cluster_palette
from pentimento.planning.strokes.render_plan import render_and_back
from pentimento.planning.strokes.scene import Scene, objective_for

Array = NDArray[np.float32]
FloatArray = NDArray[np.float64]

_PAINTS = 12
_CLUSTER_EVERY = 10
"""Iterations between two clusterings, in the second half."""


@dataclass(frozen=True)
class FridaConfig:
    """What FRIDA leaves to its user."""

    iterations: int
    """Of the first plan (thesis 4.6: 1000)."""
    multiple: float
    """Of the learning rates."""


def frida_rates(canvas_size_m: tuple[float, float], press_m: float, multiple: float) -> LearningRates:
    """The published learning rates in this project's units, times ``multiple``."""
    half = max(canvas_size_m) / 2
    return LearningRates(
        5e-3 * half * multiple, 1e-2 * multiple, 1e-2 * half * multiple, 3e-3 * half * multiple,
        1e-2 * press_m * multiple, 5e-3 * multiple,
    )  # fmt: skip


def frida_settings(planner: PlannerConfig, rates: LearningRates) -> PlannerConfig:
    """The planner's settings with FRIDA's objective and rates, which also serve its replanning."""
    return replace(
        planner, initialisation="random", distances_px=(1,), objectives=PRINT_ALONE,
        execution_noise=ExecutionNoise(0.0, 0.0), relocate_share=0.0, iterations_replan=50, replan_rate=0.5,
        learning_rates=rates,
    )  # fmt: skip


def frida_plan(
    canvas: Array, scene: Scene, count: int, planner: PlannerConfig, frida: FridaConfig
) -> tuple[Strokes, FloatArray]:
    """``count`` strokes from light to dark and their palette, sRGB [K, 3]."""
    strokes = random_strokes(count, scene.tool, scene.canvas_size_m, np.random.default_rng(planner.seed))
    strokes.keep_within(scene.tool, scene.canvas_size_m, planner.edge_m)
    strokes.color[:] = linear_to_srgb(strokes.color)  # colours are moved in sRGB
    shared = [torch.from_numpy(array) for array in strokes.arrays()]  # what moves them, moves the strokes
    rates = planner.learning_rates.steps()
    adam = torch.optim.Adam([{"params": [tensor], "lr": rate} for tensor, rate in zip(shared, rates, strict=True)])
    triangle = torch.optim.lr_scheduler.LambdaLR(adam, lambda i: 1.005 - 2 * abs(i / frida.iterations - 0.5))
    objective, palette = objective_for(scene, planner), np.zeros((0, 3))
    for iteration in range(frida.iterations):
        order = _light_first(strokes)
        image, back = render_and_back(_laid(strokes, order), canvas, scene)
        gradients = list(back(objective(image)[1]))
        gradients[-1] = gradients[-1] * _light_per_srgb(strokes.color[order])
        for tensor, gradient in zip(shared, gradients, strict=True):
            unsorted = np.empty_like(gradient)
            unsorted[order] = gradient
            tensor.grad = torch.from_numpy(unsorted)
        adam.step()
        triangle.step()
        strokes.keep_within(scene.tool, scene.canvas_size_m, planner.edge_m)
        done = (iteration + 1) / frida.iterations
        if done > 0.9 or (done >= 0.5 and iteration % _CLUSTER_EVERY == 0):
            palette, index = cluster_palette(strokes.color, np.ones(count), _PAINTS, planner.seed)
            strokes.color[:] = palette[index]
    return _laid(strokes, _light_first(strokes)), palette


def _light_first(strokes: Strokes) -> NDArray[np.int64]:
    return np.argsort(-srgb_to_lab(strokes.color.astype(np.float64))[:, 0], kind="stable")


def _laid(strokes: Strokes, order: NDArray[np.int64]) -> Strokes:
    """In this order, their sRGB colours in linear light."""
    picked = strokes.pick(order)
    return picked.colored(srgb_to_linear(picked.color))


def _light_per_srgb(srgb: Array) -> Array:
    return np.where(srgb <= 0.04045, 1 / 12.92, 2.4 / 1.055 * ((srgb + 0.055) / 1.055) ** 1.4).astype(srgb.dtype)
