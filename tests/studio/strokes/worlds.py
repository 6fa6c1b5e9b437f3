"""Worlds and paths that the studio's tests share."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pentimento.studio.strokes.studio import Studio
from pentimento.studio.strokes.world import World, load_world

BLACK = (0.1, 0.1, 0.1)
SCALE = 4000.0  # pixels a metre of the pictures that the tests look at


def world_with(base: str = "plain", **strengths: float) -> World:
    """The named world with no effects but these strengths."""
    world = load_world(base)
    none = dict.fromkeys(vars(world.effects), 0.0)
    return replace(world, effects=replace(world.effects, **(none | strengths)))


def straight(
    start: tuple[float, float] = (0.1, 0.1),
    length_m: float = 0.05,
    heading_rad: float = 0.0,
    depth_m: float = 0.002,
    yaw_rad: float = 0.0,
    speed_m_s: float = 0.05,
) -> NDArray[np.float64]:
    """A straight path at one press and one speed, float64[32,5]."""
    s = np.linspace(0, 1, 32)
    way = np.outer(s * length_m, (np.cos(heading_rad), np.sin(heading_rad)))
    rest = np.tile((-depth_m, yaw_rad), (32, 1))
    return np.column_stack([s * length_m / speed_m_s, way + start, rest])


def arc(radius_m: float, start: tuple[float, float] = (0.1, 0.1), depth_m: float = 0.002) -> NDArray[np.float64]:
    """Three quarters of a circle, float64[64,5], at 0.05 m/s."""
    angle = np.linspace(-np.pi / 2, np.pi, 64)
    xy = radius_m * np.column_stack([np.cos(angle), 1 + np.sin(angle)]) + start
    seconds = (angle - angle[0]) * radius_m / 0.05
    return np.column_stack([seconds, xy, np.full(64, -depth_m), np.zeros(64)])


def paint(world: World, *paths: NDArray[np.float64], seed: int = 1) -> Studio:
    """A studio in which a tool freshly dipped into black has executed these paths."""
    studio = Studio(world, seed)
    studio.dip(BLACK)
    for path in paths:
        studio.stroke(path)
    return studio


def ink(studio: Studio) -> NDArray[np.float64]:
    """How much darker than paper the sheet is, float64[H,W], 1 = black."""
    light = studio.truth_image(SCALE).mean(axis=2)
    return np.asarray(1 - light / np.median(light))


def width_m(image: NDArray[np.float64], x_m: float, y_m: float = 0.1, half_m: float = 0.012) -> float:
    """Height of the ink across a horizontal stroke, averaged over 6 mm of it."""
    column = round(x_m * SCALE)
    row = image.shape[0] - round(y_m * SCALE)
    half = round(half_m * SCALE)
    strip = image[max(row - half, 0) : row + half, column - 12 : column + 12]
    return float((strip > 0.4).sum(axis=0).mean() / SCALE)


def extent_m(image: NDArray[np.float64]) -> tuple[float, float, float, float]:
    """x_min, y_min, x_max, y_max of the ink."""
    rows, columns = np.nonzero(image > 0.4)
    height = image.shape[0]
    return (
        float(columns.min() / SCALE),
        float((height - 1 - rows.max()) / SCALE),
        float((columns.max() + 1) / SCALE),
        float((height - rows.min()) / SCALE),
    )


def centroid_m(image: NDArray[np.float64]) -> NDArray[np.float64]:
    """Centre of the ink, float64[2]."""
    rows, columns = np.nonzero(image > 0.4)
    return np.array([columns.mean() + 0.5, image.shape[0] - rows.mean() - 0.5]) / SCALE
