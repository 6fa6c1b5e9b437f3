"""Drawings in a hand: its strokes laid where the picture is wrong, then moved and bent by gradients (thesis 5.3.6).

The thesis starts from random latents and places; here each stroke is the best of several that the hand has drawn, and
its latent stays near it, so that what is gained in likeness is not lost in manner.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.colour import srgb_to_linear
from pentimento.contracts.errors import ConfigError
from pentimento.planning.adam import Adam
from pentimento.planning.objectives import PrintObjective
from pentimento.planning.strokes.brush import Marks
from pentimento.planning.strokes.config import HandPlanConfig, Log
from pentimento.planning.strokes.descent import half_cosine
from pentimento.planning.strokes.initialise import error_map, places_of_error
from pentimento.planning.strokes.memory import commanded
from pentimento.planning.strokes.render_plan import in_pixels, render_marks
from pentimento.planning.strokes.scene import Scene, inherit
from pentimento.planning.strokes.shapes import ShapedStrokes, Shapes
from pentimento.render.strokewise import fall_with, rise_without

Array = NDArray[np.float32]
FloatArray = NDArray[np.float64]

_ROUND_END = 0.3
"""Share of the learning rates that is left at a round's end: the next round goes on from there."""
_TRIED = 256
"""Strokes of the hand whose mean length says how many the first round needs."""
_SETTLE = 0.8
"""Of the last iterations, the share after which no stroke is relocated."""


class PathBrush(Protocol):
    """A stroke model that takes paths of any shape; ``Brush`` takes Bézier strokes."""

    def path_marks(
        self, paths: Array, color: Array, inherited: dict[str, Array]
    ) -> tuple[Marks, Callable[[Marks], Array]]:
        """What commanded paths [S, N, 5] in colours [S, 3] leave, and from its gradient to the paths'."""


def plan_in_hand(
    canvas: Array, scene: Scene, brush: PathBrush, shapes: Shapes, ink_m: float, config: HandPlanConfig, log: Log
) -> ShapedStrokes:
    """Strokes of these shapes, in the order of execution, for a tool with its own ink: about ``ink_m`` of line.

    Hands are comparable at one length of line: a hundred dots are less than a hundred bows. The last iterations may
    change it a little. ``log("objective", value, iteration)`` is called at every iteration.

    Args:
        canvas: [H, W, 3], linear light: what they are laid upon.

    Raises:
        ConfigError: the tool takes paints, or the paths of brush, shapes and plan have not equally many points.
    """
    _check(scene, shapes, config)
    rng = np.random.default_rng([config.seed, 21])
    task = _Task(canvas, scene, brush, config)
    strokes = task.some(shapes, 0, task.render(None)[0], rng)[0]
    iteration = 0
    usual_m = float(_lengths_m(shapes.paths(shapes.some(_TRIED, rng))[0]).mean())
    for number in range(config.rounds):
        drawn_m = _lengths_m(strokes.placed()[0][..., 1:3])
        mean_m = float(drawn_m.mean()) if len(strokes) else usual_m
        share = max(round((ink_m * (number + 1) / config.rounds - float(drawn_m.sum())) / mean_m), 0)
        strokes = strokes.joined(task.some(shapes, share, task.render(strokes)[0], rng)[0])
        iteration = task.descend(strokes, config.iterations_per_round, 1.0, _ROUND_END, log, iteration)
    every = config.relocate_every or max(config.iterations, 1)
    starts = range(0, config.iterations, every)
    for start in starts:
        end = min(start + every, config.iterations)
        if 0 < start <= _SETTLE * config.iterations:
            strokes = task.relocate(strokes, rng)
        first, last = (half_cosine(at, config.iterations, 1.0, 0.0) for at in (start, end))
        iteration = task.descend(strokes, end - start, first, last, log, iteration)
    return strokes


def predict_drawing(strokes: ShapedStrokes, canvas: Array, scene: Scene, brush: PathBrush) -> Array:
    """What the canvas [H, W, 3] (linear light) will look like after the strokes."""
    if len(strokes) == 0:
        return canvas
    return render_marks(_marks(strokes, scene, brush)[0], canvas, scene)[0]


def _lengths_m(paths: Array) -> Array:
    """[S] of paths [S, N, 2]."""
    return np.linalg.norm(np.diff(paths, axis=1), axis=-1).sum(1)


def _check(scene: Scene, shapes: Shapes, config: HandPlanConfig) -> None:
    if scene.tool.color_srgb is None:
        raise ConfigError(f"Drawings in a hand are made with a tool's own ink; the {scene.tool.name} takes paints.")
    if not shapes.points == scene.brush.path_points == config.path_points:
        raise ConfigError(
            f"Shapes of {shapes.points} points, a brush of {scene.brush.path_points} and path_points = "
            f"{config.path_points} do not fit: train the hands at that number of points."
        )


def _marks(
    strokes: ShapedStrokes, scene: Scene, brush: PathBrush
) -> tuple[Marks, Callable[[Marks], tuple[Array, ...]]]:
    _, pull_path = strokes.placed()
    path = commanded(strokes, scene.tool, strokes.shapes.points)
    marks, pull = brush.path_marks(path, strokes.color, inherit(strokes, scene))
    return marks, lambda of_marks: pull_path(pull(of_marks))


class _Task:
    """What all steps of one plan share."""

    def __init__(self, canvas: Array, scene: Scene, brush: PathBrush, config: HandPlanConfig) -> None:
        self.canvas, self.scene, self.brush, self.config = canvas, scene, brush, config
        self.objective = PrintObjective(scene.target, config.distances_px)

    def render(self, strokes: ShapedStrokes | None) -> tuple[Array, Callable[[Array], tuple[Array, ...]]]:
        """The canvas after the strokes, and from its gradient to that of the strokes' arrays."""
        if strokes is None or len(strokes) == 0:
            return self.canvas, lambda _: ()
        marks, pull = _marks(strokes, self.scene, self.brush)
        image, back = render_marks(marks, self.canvas, self.scene)
        return image, lambda of_image: pull(back(of_image))

    def descend(
        self, strokes: ShapedStrokes, iterations: int, rate: float, last_rate: float, log: Log, first: int
    ) -> int:
        """Move the strokes, in place, down the objective; returns the number of the iteration that would be next."""
        if len(strokes) == 0:
            return first
        rates, adam = self.config.learning_rates, Adam(strokes.arrays())
        spread = strokes.shapes.spread
        for iteration in range(iterations):
            image, back = self.render(strokes)
            value, of_image = self.objective(image)
            log("objective", value, first + iteration)
            numbers, *others = back(of_image)
            share = half_cosine(iteration, iterations, rate, last_rate)
            steps = [share * step for step in (rates.shape, rates.middle_m, rates.theta_rad, rates.press_m)]
            before = strokes.numbers.copy()
            adam.step([numbers * spread, *others], steps)
            strokes.numbers[:] = before + (strokes.numbers - before) * spread  # steps in spreads of each number
            self.hold(strokes)
        return first + iterations

    def some(
        self, shapes: Shapes, count: int, image: Array, rng: np.random.Generator
    ) -> tuple[ShapedStrokes, FloatArray]:
        """``count`` new strokes where the image is wrong, each the best of its candidates, and what each alone gains.

        Half of the candidates run along the target's edges there, half anywhere.
        """
        config, scene = self.config, self.scene
        tries = config.candidates
        numbers = shapes.some(tries * count, rng)
        if count == 0:
            return self._strokes(shapes, numbers, np.zeros((0, 2)), np.zeros(0), rng), np.zeros(0)
        extent_px = float(np.ptp(shapes.paths(numbers)[0], axis=1).max(-1).mean()) * scene.pixels_per_m
        middle, along = places_of_error(error_map(image, scene), count, max(extent_px, 2.0) / 3, scene, rng)
        shape = (tries, count)
        free = np.arange(tries)[:, None] % 2 == 1
        heading = np.where(free, rng.uniform(-np.pi, np.pi, shape), along + rng.normal(0, 0.15, shape))
        beside = (
            rng.normal(0, 0.1 * extent_px / scene.pixels_per_m, (*shape, 2)) * (np.arange(tries) > 0)[:, None, None]
        )
        tried = self._strokes(shapes, numbers, (middle + beside).reshape(-1, 2), heading.ravel(), rng)
        gains = fall_with(*self._marked(tried, image)).reshape(shape)
        best = gains.argmax(0)
        return tried.pick(best * count + np.arange(count)), gains.max(0)

    def relocate(self, strokes: ShapedStrokes, rng: np.random.Generator) -> ShapedStrokes:
        """The strokes with the least useful of them moved to the top, where they lower the error more."""
        most = int(len(strokes) * self.config.relocate_share)
        if most == 0:
            return strokes
        worth = rise_without(*self._marked(strokes, self.canvas))
        new, gains = self.some(strokes.shapes, most, self.render(strokes)[0], rng)
        idle, best = np.argsort(worth, kind="stable")[:most], np.argsort(-gains, kind="stable")
        better = gains[best] > np.maximum(worth[idle], 0.0)
        moved = most if better.all() else int(better.argmin())
        staying = np.setdiff1d(np.arange(len(strokes)), idle[:moved])
        return strokes.pick(staying).joined(new.pick(best[:moved]))

    def hold(self, strokes: ShapedStrokes) -> None:
        """Keep them to hand, tool and canvas."""
        strokes.keep_within(self.scene.tool, self.scene.canvas_size_m, self.config.edge_m, self.config.reach)

    def _strokes(
        self, shapes: Shapes, numbers: Array, middle: FloatArray, theta: FloatArray, rng: np.random.Generator
    ) -> ShapedStrokes:
        tool = self.scene.tool
        ink = srgb_to_linear(np.array(tool.color_srgb, np.float32))
        press = np.repeat(rng.uniform(*tool.press_range_m, len(theta))[:, None], 3, axis=1)
        fields = (middle, theta, press, np.tile(ink, (len(theta), 1)))
        strokes = ShapedStrokes(shapes, numbers, numbers.copy(), *(array.astype(np.float32) for array in fields))
        if len(strokes):
            self.hold(strokes)
        return strokes

    def _marked(
        self, strokes: ShapedStrokes, canvas: Array
    ) -> tuple[Array, Array, Array, Array, Array, Array, Array, tuple[int, ...]]:
        """The arguments of ``render.strokewise``'s functions."""
        marks, _ = _marks(strokes, self.scene, self.brush)
        points, radius = in_pixels(marks, self.scene)
        return (
            points, radius, marks.density, marks.softness, strokes.color, canvas, self.scene.target,
            self.config.distances_px,
        )  # fmt: skip
