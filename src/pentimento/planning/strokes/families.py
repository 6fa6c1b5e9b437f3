"""What the planner needs of a kind of stroke (``PathFamily``), for Bézier strokes and strokes of one kind of shape."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from pentimento.planning.strokes.bezier import Strokes, no_strokes, with_color
from pentimento.planning.strokes.config import PlanConfig, PlannerConfig, ShapedPlanConfig
from pentimento.planning.strokes.initialise import (
    HEADING_SPREAD_RAD,
    best_of,
    error_map,
    guided_strokes,
    places_of_error,
    random_strokes,
    tone_along,
    tones,
)
from pentimento.planning.strokes.paths import PlannedPaths
from pentimento.planning.strokes.scene import Scene
from pentimento.planning.strokes.shapes import ShapedStrokes, Shapes

Array = NDArray[np.float32]
FloatArray = NDArray[np.float64]
S = TypeVar("S", bound=PlannedPaths)

_LENGTH_SAMPLES = 256
"""Random shapes whose mean length says how many strokes the first round needs."""


class PathFamily(Protocol[S]):
    """A kind of stroke that can be planned: how many strokes each round adds, and where new strokes start."""

    def none(self) -> S:
        """An empty set of strokes."""

    def count_in_round(self, number: int, present: S) -> int | None:
        """How many strokes round ``number`` adds to the present ones. None skips the round."""

    def initial(
        self, count: int, image: Array, scene: Scene, *, distances_px: tuple[int, ...], progress: float,
        rng: np.random.Generator,
    ) -> S:  # fmt: skip
        """New strokes for a round. ``progress`` is 0 in the first round and 1 in the last."""

    def guided(
        self, count: int, image: Array, scene: Scene, *, distances_px: tuple[int, ...], progress: float,
        paints: FloatArray | None, rng: np.random.Generator,
    ) -> tuple[S, FloatArray]:  # fmt: skip
        """New strokes where the image [H, W, 3] (linear light) differs from the target, and the gain of each [count].

        A gain is the fall of the error, summed over pixels, when the stroke alone is laid on the image. ``paints``
        [K, 3] (linear light) are the only colours to use; None allows any.
        """


@dataclass(frozen=True)
class BezierFamily:
    """Up to ``count`` Bézier strokes in all."""

    config: PlannerConfig
    count: int

    def none(self) -> Strokes:
        """See ``PathFamily``."""
        return no_strokes()

    def count_in_round(self, number: int, _present: Strokes) -> int | None:
        """The round's share; see ``round_shares``."""
        return round_shares(self.count, self.config.rounds)[number] or None

    def initial(
        self, count: int, image: Array, scene: Scene, *, distances_px: tuple[int, ...], progress: float,
        rng: np.random.Generator,
    ) -> Strokes:  # fmt: skip
        """Random or guided strokes, as ``config.initialisation`` says."""
        if self.config.initialisation != "random":
            return self.guided(
                count, image, scene, distances_px=distances_px, progress=progress, paints=None, rng=rng
            )[0]  # fmt: skip
        new = random_strokes(count, scene.tool, scene.canvas_size_m, rng)
        if scene.tool.color_srgb is not None:
            new = with_color(new, np.tile(np.array(scene.tool.color_srgb, np.float32), (count, 1)))
        new.keep_within(scene.tool, scene.canvas_size_m, self.config.edge_m)
        return new

    def guided(
        self, count: int, image: Array, scene: Scene, *, distances_px: tuple[int, ...], progress: float,
        paints: FloatArray | None, rng: np.random.Generator,
    ) -> tuple[Strokes, FloatArray]:  # fmt: skip
        """Strokes along the target's edges in its colours, smaller from round to round."""
        first, last = self.config.sizes
        size = last + (first - last) * (1 - progress) ** 2
        return guided_strokes(
            count, size, image, scene, config=self.config, distances_px=distances_px, paints=paints, rng=rng
        )  # fmt: skip


@dataclass(frozen=True)
class ShapedFamily:
    """Strokes of one kind of shape: about ``ink_m`` metres of line in all."""

    config: ShapedPlanConfig
    shapes: Shapes
    ink_m: float
    mean_length_m: float
    """Mean length of a random shape."""

    def none(self) -> ShapedStrokes:
        """See ``PathFamily``."""
        parameters = self.shapes.sample(0, np.random.default_rng(0))
        return self._strokes(
            parameters, np.zeros((0, 2)), np.zeros(0), press_m=np.zeros((0, 3)), color=np.zeros((0, 3))
        )

    def count_in_round(self, number: int, present: ShapedStrokes) -> int | None:
        """As many strokes as the missing length of line needs at the present strokes' mean length."""
        drawn_m = path_lengths_m(present.placed()[0][..., 1:3])
        mean_m = float(drawn_m.mean()) if len(present) else self.mean_length_m
        return max(round((self.ink_m * (number + 1) / self.config.rounds - float(drawn_m.sum())) / mean_m), 0)

    def initial(
        self, count: int, image: Array, scene: Scene, *, distances_px: tuple[int, ...], progress: float,
        rng: np.random.Generator,
    ) -> ShapedStrokes:  # fmt: skip
        """Guided strokes in every round."""
        return self.guided(
            count, image, scene, distances_px=distances_px, progress=progress, paints=None, rng=rng
        )[0]  # fmt: skip

    def guided(
        self, count: int, image: Array, scene: Scene, *, distances_px: tuple[int, ...], progress: float,
        paints: FloatArray | None, rng: np.random.Generator,
    ) -> tuple[ShapedStrokes, FloatArray]:  # fmt: skip
        """Random shapes: half of the candidates run along the target's edges, half anywhere."""
        del progress  # sizes are those of the shapes
        if count == 0:
            return self.none(), np.zeros(0)
        tries = self.config.candidates
        parameters = self.shapes.sample(tries * count, rng)
        extent_px = float(np.ptp(self.shapes.paths(parameters)[0], axis=1).max(-1).mean()) * scene.pixels_per_m
        middle, along = places_of_error(error_map(image, scene), count, max(extent_px, 2.0) / 3, scene, rng)
        shape, number = (tries, count), np.arange(tries)
        anywhere = rng.uniform(-np.pi, np.pi, shape)
        heading = np.where(number[:, None] % 2 == 1, anywhere, along + rng.normal(0, HEADING_SPREAD_RAD, shape))
        aside = rng.normal(0, 0.1 * extent_px / scene.pixels_per_m, (*shape, 2)) * (number > 0)[:, None, None]
        press = np.repeat(rng.uniform(*scene.tool.press_range_m, tries * count)[:, None], 3, axis=1)
        color = np.zeros((tries * count, 3))
        tried = self._strokes(parameters, (middle + aside).reshape(-1, 2), heading.ravel(), press_m=press, color=color)
        tried.keep_within(scene.tool, scene.canvas_size_m, self.config.edge_m)
        tried.color = tone_along(tried.placed()[0], tones(scene), scene, paints).astype(np.float32)
        return best_of(tried, tries, image, scene, distances_px)

    def _strokes(
        self, parameters: Array, middle_m: FloatArray, theta_rad: FloatArray, *, press_m: FloatArray,
        color: FloatArray | Array,
    ) -> ShapedStrokes:  # fmt: skip
        middle, theta, press, linear = (array.astype(np.float32) for array in (middle_m, theta_rad, press_m, color))
        return ShapedStrokes(
            self.shapes, self.config.max_latent_distance, parameters, parameters.copy(), middle, theta, press, linear
        )  # fmt: skip


def family_of(strokes: S, config: PlanConfig) -> PathFamily[S]:
    """The family of some strokes, for relocating them."""
    if isinstance(strokes, ShapedStrokes):
        assert isinstance(config, ShapedPlanConfig)
        return cast("PathFamily[S]", ShapedFamily(config, strokes.shapes, ink_m=0.0, mean_length_m=0.0))
    assert isinstance(config, PlannerConfig)
    return cast("PathFamily[S]", BezierFamily(config, len(strokes)))


def shaped_family(shapes: Shapes, ink_m: float, config: ShapedPlanConfig, rng: np.random.Generator) -> ShapedFamily:
    """The family, with the mean length of its shapes estimated from random ones."""
    lengths_m = path_lengths_m(shapes.paths(shapes.sample(_LENGTH_SAMPLES, rng))[0])
    return ShapedFamily(config, shapes, ink_m, float(lengths_m.mean()))


def path_lengths_m(paths: Array) -> Array:
    """[S] of paths [S, N, 2]."""
    return np.linalg.norm(np.diff(paths, axis=1), axis=-1).sum(1)


def round_shares(count: int, rounds: int) -> list[int]:
    """``count`` strokes over the rounds. The last gets twice as many as the first, since its strokes are smaller."""
    weights = np.linspace(1, 2, rounds) if rounds > 1 else np.ones(1)
    ends = np.rint(count * np.cumsum(weights) / weights.sum()).astype(int)
    return [int(share) for share in np.diff(ends, prepend=0)]
