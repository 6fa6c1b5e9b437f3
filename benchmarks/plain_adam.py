"""The planner's baseline, plain Adam from random starts (thesis 4.3.5), and the task that both get."""

import time
from dataclasses import asdict, dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from pentimento.contracts.colour import srgb_to_linear
from pentimento.dynamics.strokes.extended import base_model
from pentimento.dynamics.strokes.planned import TorchBrush
from pentimento.dynamics.strokes.traj2stroke import Traj2StrokeParameters
from pentimento.planning.adam import half_cosine
from pentimento.planning.strokes.bezier import Strokes
from pentimento.planning.strokes.config import PRINT_ALONE, ExecutionNoise, LearningRates, Log, PlannerConfig
from pentimento.planning.strokes.initialise import random_strokes
from pentimento.planning.strokes.palette import PaletteChoice
from pentimento.planning.strokes.render_plan import faults, render_and_back
from pentimento.planning.strokes.scene import Scene, objective_for, scene_with
from pentimento.planning.strokes.target import fit_to_canvas, load_photograph
from pentimento.robots.tools import load_tool

Light = NDArray[np.float32]

STROKES = 400
ITERATIONS = 400
SIZE_M = (0.30, 0.20)
PIXELS_PER_M = 1050.0
# As train_stroke_dynamics found it for the round brush.
MODEL = Traj2StrokeParameters((0.934, 0.921), (7.2e-4, -5.0e-4), 1.197, 1.92e-3, 0.0697, 0.9803)
PAPER_SRGB = (0.955, 0.95, 0.935)
PLAIN_RATES = LearningRates(6e-4, 0.03, 6e-4, 3e-4, 5e-5, 0.02)
MULTIPLES = (8, 16, 32)
OURS = PlannerConfig(
    initialisation="error_guided",
    candidates=8,
    rounds=3,
    sizes=(0.8, 0.0),
    iterations_per_round=8,
    iterations_free=60,
    iterations_palette=120,
    iterations_replan=0,
    replan_rate=0.0,
    relocate_every=10,
    relocate_share=0.3,
    min_gain_per_stroke=0.0,
    palette=PaletteChoice("plan", 12, None, None),
    sweeps=4,
    path_points=16,
    pixels_per_m=PIXELS_PER_M,
    edge_m=6e-3,
    distances_px=(1, 4),
    objectives=PRINT_ALONE,
    execution_noise=ExecutionNoise(0.0, 0.0),
    learning_rates=LearningRates(2.4e-3, 0.12, 2.4e-3, 1.2e-3, 8e-4, 0.06),
    seed=1,
)


@dataclass(frozen=True)
class Curve:
    """A run: the objective after so many seconds."""

    seconds: list[float]
    loss: list[float]

    def reaches(self, loss: float) -> float | None:
        """Seconds until it is that low, if it ever is."""
        return next((s for s, value in zip(self.seconds, self.loss, strict=True) if value <= loss), None)

    def after(self, seconds: float) -> float:
        """The least by then."""
        return min(value for s, value in zip(self.seconds, self.loss, strict=True) if s <= seconds)


class Clock:
    """A log that collects a curve, without values at half the resolution, which are none of the objective."""

    def __init__(self, skip: int) -> None:
        self.curve = Curve([], [])
        self._skip, self._start = skip, time.process_time()

    def __call__(self, _name: str, value: float, step: int) -> None:
        if step >= self._skip:
            self.curve.seconds.append(time.process_time() - self._start)
            self.curve.loss.append(value)


def scene_of(picture: str) -> tuple[Scene, Light]:
    """The picture as a task for the round brush, and a blank canvas."""
    shape = round(SIZE_M[1] * PIXELS_PER_M), round(SIZE_M[0] * PIXELS_PER_M)
    target, tool = fit_to_canvas(load_photograph(picture), shape).astype(np.float32), load_tool("round_brush")
    paper = srgb_to_linear(np.array(PAPER_SRGB, np.float32))
    brush = TorchBrush(base_model(MODEL), tool, OURS.path_points)
    return scene_with(brush, tool, SIZE_M, target), np.tile(paper, (*shape, 1))


def plain_adam(
    strokes: Strokes,
    canvas: Light,
    scene: Scene,
    *,
    multiple: float,
    free_color: bool,
    log: Log,
    last_rate: float = 0.0,
    execution_noise: ExecutionNoise = OURS.execution_noise,
) -> None:
    """Move the strokes in place for ``ITERATIONS``, along a cosine from the rates to ``last_rate`` times them."""
    rates = asdict(PLAIN_RATES)
    # Tensors that share the strokes' memory: what moves them, moves the strokes.
    shared = [torch.from_numpy(array) for array in strokes.arrays()]
    groups = [(tensor, multiple * rate) for tensor, rate in zip(shared, rates.values(), strict=True)]
    groups = groups if free_color else groups[:-1]
    adam = torch.optim.Adam([{"params": [tensor], "lr": rate} for tensor, rate in groups])
    schedule = torch.optim.lr_scheduler.LambdaLR(adam, lambda i: half_cosine(i, ITERATIONS, 1.0, last_rate))
    objective, rng = objective_for(scene, OURS), np.random.default_rng(OURS.seed)
    for iteration in range(ITERATIONS + 1):
        fault = faults(len(strokes), execution_noise, rng) if execution_noise.any() else None
        image, back = render_and_back(strokes, canvas, scene, fault)
        loss, of_image = objective(image)
        log("objective", loss, iteration)
        if iteration < ITERATIONS:
            for (tensor, _), gradient in zip(groups, back(of_image), strict=False):
                tensor.grad = torch.from_numpy(gradient)
            adam.step()
            schedule.step()
            strokes.keep_within(scene.tool, scene.canvas_size_m, OURS.edge_m)


def anywhere(scene: Scene, seed: int) -> Strokes:
    """The baseline's start."""
    strokes = random_strokes(STROKES, scene.tool, SIZE_M, np.random.default_rng(seed))
    strokes.keep_within(scene.tool, SIZE_M, OURS.edge_m)
    return strokes


def constant_adam(canvas: Light, scene: Scene, seed: int) -> Curve:
    """The curve of Adam as it comes: our first learning rates, and they stay."""
    strokes, clock = anywhere(scene, seed), Clock(0)
    plain_adam(strokes, canvas, scene, multiple=1.0, free_color=True, log=clock, last_rate=1.0)
    return clock.curve


@dataclass(frozen=True)
class AdamRun:
    """A run of the baseline."""

    strokes: Strokes
    curve: Curve
    multiple: float
    """Of the learning rates."""


def best_adam(canvas: Light, scene: Scene, seed: int) -> AdamRun:
    """The baseline's run with the lowest objective."""
    runs = []
    for multiple in MULTIPLES:
        strokes, clock = anywhere(scene, seed), Clock(0)
        plain_adam(strokes, canvas, scene, multiple=multiple, free_color=True, log=clock)
        runs.append(AdamRun(strokes, clock.curve, float(multiple)))
    return min(runs, key=lambda run: run.curve.loss[-1])
