"""Plans by gradient descent through the stroke renderer (thesis 4.3.5, Figure 4.5)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pentimento.contracts.ranges import above_zero, at_least
from pentimento.planning.initialise import error_guided_strokes, random_strokes
from pentimento.planning.objective import PrintObjective
from pentimento.planning.palette import cluster_palette
from pentimento.planning.strokes import StrokeTensors, with_color
from pentimento.robots.tools import Tool
from pentimento.stroke_dynamics.autograd import render_strokes
from pentimento.stroke_dynamics.photometry import linear_to_srgb
from pentimento.stroke_dynamics.traj2stroke import Mark

FloatArray = NDArray[np.float64]
Log = Callable[[str, float, int], None]


@dataclass(frozen=True)
class LearningRates:
    """Adam's step for each kind of number."""

    middle_m: float
    theta_rad: float
    length_m: float
    bend_m: float
    press_m: float
    color: float

    def __post_init__(self) -> None:
        at_least(self, 0, "middle_m", "theta_rad", "length_m", "bend_m", "press_m", "color")


@dataclass(frozen=True)
class PlannerConfig:
    """How a plan is made."""

    initialisation: Literal["random", "error_guided"]
    rounds: int
    """Strokes are added in so many rounds, coarse to fine."""
    iterations_per_round: int
    iterations_free: int
    """With free colours, after the last round."""
    iterations_palette: int
    """After the colours were clustered and the strokes ordered from light to dark."""
    iterations_replan: int
    """After each photograph (thesis 4.3.5)."""
    replan_rate: float
    """Share of the learning rates that replanning uses: it starts near the optimum."""
    palette_size: int
    path_points: int
    pixels_per_m: float
    """Resolution of planning."""
    edge_m: float
    """Strokes keep this far from the canvas's edge."""
    distances_px: tuple[int, ...]
    """Viewing distances of the print objective."""
    learning_rates: LearningRates
    seed: int

    def __post_init__(self) -> None:
        at_least(self, 0, "iterations_per_round", "iterations_free", "iterations_palette", "iterations_replan")
        at_least(self, 0, "replan_rate", "edge_m", "seed")
        at_least(self, 1, "rounds", "palette_size")
        at_least(self, 2, "path_points")
        above_zero(self, "pixels_per_m")
        if not self.distances_px or min(self.distances_px) < 1:
            raise ValueError(f"distances_px is {list(self.distances_px)}; give at least one distance, each 1 or more.")


@dataclass(frozen=True)
class Scene:
    """What a plan is made for."""

    tool: Tool
    mark: Callable[[Tensor], Mark]
    """The stroke model: paths [S, N, 5] to marks."""
    canvas_size_m: tuple[float, float]
    target: Tensor
    """[H, W, 3], linear light, of the whole canvas."""

    @property
    def pixels_per_m(self) -> float:
        """Of the target."""
        return self.target.shape[1] / self.canvas_size_m[0]


def render_plan(strokes: StrokeTensors, canvas: Tensor, scene: Scene, path_points: int) -> Tensor:
    """What the canvas [H, W, 3] (linear light) will look like after the strokes; differentiable."""
    if len(strokes) == 0:
        return canvas
    mark = scene.mark(strokes.paths(path_points))
    k = scene.pixels_per_m
    x = mark.points_m[..., 0] * k - 0.5
    y = (scene.canvas_size_m[1] - mark.points_m[..., 1]) * k - 0.5
    return render_strokes(
        torch.stack([x, y], dim=-1)[None],
        (mark.radius_m * k)[None],
        mark.density[None],
        mark.softness[None],
        strokes.color[None],
        canvas[None],
    )[0]


def plan(canvas: Tensor, scene: Scene, count: int, config: PlannerConfig, log: Log) -> tuple[StrokeTensors, FloatArray]:
    """``count`` strokes in the order of execution, and their palette, sRGB [K, 3].

    Strokes are added round by round, coarse to fine, and optimised; then their colours are clustered, the strokes
    ordered from light to dark and optimised again in those colours. A tool with its own ink keeps its colour.
    ``log("print_loss", value, iteration)`` is called at every iteration.
    """
    rng = np.random.default_rng([config.seed, 0])
    strokes = StrokeTensors(*(torch.zeros(0, *rest) for rest in ((2,), (), (), (), (3,), (3,))))
    done = 0
    free_color = scene.tool.color_srgb is None
    for part in range(config.rounds):
        share = len(range(part, count, config.rounds))
        strokes = strokes.joined(_new_strokes(share, part, strokes, canvas, scene, config, rng))
        optimise(strokes, canvas, scene, config, config.iterations_per_round, free_color, 1.0, log, done)
        done += config.iterations_per_round
    optimise(strokes, canvas, scene, config, config.iterations_free, free_color, 1.0, log, done)
    done += config.iterations_free
    if scene.tool.color_srgb is not None:
        return strokes, np.array([scene.tool.color_srgb])
    strokes, palette = light_to_dark(strokes, config.palette_size, config.seed)
    optimise(strokes, canvas, scene, config, config.iterations_palette, False, 1.0, log, done)
    return strokes, palette


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
) -> None:
    """Move the strokes, in place, down the print objective, always within what tool and canvas allow.

    They end where the objective was least on the way, so never worse than they started. ``rate`` is a share of the
    learning rates.
    """
    rates = config.learning_rates
    steps = (rates.middle_m, rates.theta_rad, rates.length_m, rates.bend_m, rates.press_m, rates.color)
    objective = PrintObjective(scene.target, config.distances_px)
    moving = list(zip(strokes.tensors(), steps, strict=True))[: 6 if free_color else 5]
    for tensor, _ in moving:
        tensor.requires_grad_(True)
    optimiser = torch.optim.Adam([{"params": [tensor], "lr": rate * step} for tensor, step in moving])
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, max(iterations, 1), eta_min=0.0)
    least, best = float("inf"), strokes.pick(slice(None))
    for iteration in range(iterations + 1):
        optimiser.zero_grad()
        loss = objective(render_plan(strokes, canvas, scene, config.path_points))
        if float(loss.detach()) < least:
            least, best = float(loss.detach()), strokes.pick(slice(None))
        if iteration == iterations:
            break
        loss.backward()  # type: ignore[no-untyped-call]
        optimiser.step()
        schedule.step()
        strokes.keep_within(scene.tool, scene.canvas_size_m, config.edge_m)
        log("print_loss", float(loss.detach()), first_iteration + iteration)
    for (tensor, _), kept in zip(moving, best.tensors(), strict=False):
        tensor.requires_grad_(False)
        tensor.copy_(kept)


def light_to_dark(strokes: StrokeTensors, palette_size: int, seed: int) -> tuple[StrokeTensors, FloatArray]:
    """The strokes in palette colours, ordered from the lightest paint to the darkest, and the palette [K, 3]."""
    covered = (strokes.length_m * (1e-3 + strokes.press_m.mean(1))).numpy()
    palette, paint = cluster_palette(linear_to_srgb(strokes.color).numpy(), covered, palette_size, seed)
    order = torch.from_numpy(np.argsort(paint, kind="stable"))
    colors = torch.tensor(palette[paint], dtype=torch.float32)
    return with_color(strokes, colors).pick(order), palette


def _new_strokes(
    count: int,
    part: int,
    present: StrokeTensors,
    canvas: Tensor,
    scene: Scene,
    config: PlannerConfig,
    rng: np.random.Generator,
) -> StrokeTensors:
    match config.initialisation:
        case "random":
            new = random_strokes(count, scene.tool, scene.canvas_size_m, rng)
        case "error_guided":
            image = render_plan(present, canvas, scene, config.path_points).double().numpy()
            size = 1 - part / max(config.rounds - 1, 1)
            target = scene.target.double().numpy()
            new = error_guided_strokes(count, scene.tool, scene.canvas_size_m, image, target, size, rng)
    if scene.tool.color_srgb is not None:
        new = with_color(new, torch.tensor(scene.tool.color_srgb).expand(count, 3))
    new.keep_within(scene.tool, scene.canvas_size_m, config.edge_m)
    return new
