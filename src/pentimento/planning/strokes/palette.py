"""Paints for a plan: gathered from its colours (thesis 4.3.5, Figure 4.6), from a picture, or given by the person."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.colour import lab_to_srgb, srgb_to_lab, to_float
from pentimento.planning.strokes.target import load_photograph

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_PICTURE_PIXELS = 20_000
"""Of a picture, so many at most are looked at to gather its colours."""


@dataclass(frozen=True)
class PaletteChoice:
    """Which paints the person lays out."""

    source: Literal["plan", "picture", "given", "ink"]
    """``plan``: the strokes' own colours, clustered, then moved with the strokes. ``picture``: a picture's colours,
    clustered. ``given``: these. ``ink``: none, the tool carries its own."""
    size: int | None
    """Paints to gather, for ``plan`` and ``picture``."""
    picture: str | None
    """A file, or the name of a photograph that scikit-image ships."""
    colors_srgb: tuple[tuple[float, float, float], ...] | None
    """Of the paints ``given``."""

    def __post_init__(self) -> None:
        wanted = {"plan": {"size"}, "picture": {"size", "picture"}, "given": {"colors_srgb"}, "ink": set[str]()}
        for name in ("size", "picture", "colors_srgb"):
            if (getattr(self, name) is not None) != (name in wanted[self.source]):
                needs = ", ".join(sorted(wanted[self.source])) or "nothing else"
                raise ValueError(f"{name} is {getattr(self, name)!r}; a palette from {self.source} takes {needs}.")
        if self.size is not None and self.size < 1:
            raise ValueError(f"size is {self.size}; it must be 1 or more.")
        for color in self.colors_srgb or ():
            if not all(0 <= channel <= 1 for channel in color):
                raise ValueError(f"colors_srgb has {list(color)}; sRGB runs from 0 to 1.")
        if self.colors_srgb == ():
            raise ValueError("colors_srgb is empty; give at least one paint.")


def cluster_palette(colors_srgb: FloatArray, weights: FloatArray, size: int, seed: int) -> tuple[FloatArray, IntArray]:
    """K-means in L*a*b*.

    Args:
        colors_srgb: [S, 3].
        weights: [S], how much each colour counts: the area that its stroke covers.
        size: paints wanted; fewer come back where there are fewer distinct colours.

    Returns:
        The palette, sRGB [K, 3], from light to dark; and which paint each colour takes, [S].
    """
    lab = srgb_to_lab(np.asarray(colors_srgb, dtype=np.float64))
    size = min(size, len(np.unique(lab.round(6), axis=0)))
    centres = weighted_kmeans(lab, weights, size, np.random.default_rng([seed, 3]))
    palette = light_first(np.clip(lab_to_srgb(centres), 0.0, 1.0))
    return palette, nearest_paint(colors_srgb, palette)


def picture_palette(name_or_path: str, size: int, seed: int) -> FloatArray:
    """The colours of a picture, sRGB [K, 3], from light to dark.

    Raises:
        ImageError: there is no such picture.
    """
    pixels = to_float(load_photograph(name_or_path)).astype(np.float64).reshape(-1, 3)
    some = np.random.default_rng([seed, 1]).choice(len(pixels), min(_PICTURE_PIXELS, len(pixels)), replace=False)
    return cluster_palette(pixels[some], np.ones(len(some)), size, seed)[0]


def light_first(palette_srgb: FloatArray) -> FloatArray:
    """The paints by falling lightness."""
    return np.asarray(palette_srgb[np.argsort(-srgb_to_lab(palette_srgb)[:, 0], kind="stable")])


def nearest_paint(colors_srgb: FloatArray, palette_srgb: FloatArray) -> IntArray:
    """[S] the paint nearest to each colour, in L*a*b*."""
    difference = srgb_to_lab(np.asarray(colors_srgb, dtype=np.float64))[:, None] - srgb_to_lab(palette_srgb)
    return np.asarray(np.square(difference).sum(-1).argmin(1))


_STARTS = 4
_MAX = 300
_SETTLED = 1e-4
"""Of the points' variance: centres that moved by less than this, squared, stay."""


def weighted_kmeans(points: FloatArray, weights: FloatArray, count: int, rng: np.random.Generator) -> FloatArray:
    """[K, D] centres of ``count`` clusters: the best of several starts.

    Args:
        points: [S, D], of which at least ``count`` differ.
        weights: [S], above 0: how much each point counts.
    """
    found = [_lloyd(points, weights, _spread_start(points, weights, count, rng)) for _ in range(_STARTS)]
    return min(found, key=lambda centres: float(weights @ _squares(points, centres).min(1)))


def _lloyd(points: FloatArray, weights: FloatArray, centres: FloatArray) -> FloatArray:
    settled = _SETTLED * points.var(0).mean()
    for _ in range(_MAX):
        squares = _squares(points, centres)
        nearest = squares.argmin(1)
        mass = np.bincount(nearest, weights, len(centres))
        sums = np.stack([np.bincount(nearest, weights * column, len(centres)) for column in points.T], axis=1)
        # A centre that nothing is nearest to goes where the points are served worst.
        worst = points[np.argsort(-weights * squares.min(1), kind="stable")[: len(centres)]]
        moved = np.where(mass[:, None] > 0, sums / np.maximum(mass, 1e-300)[:, None], worst)
        shift, centres = np.square(moved - centres).sum(), moved
        if shift <= settled:
            break
    return centres


def _spread_start(points: FloatArray, weights: FloatArray, count: int, rng: np.random.Generator) -> FloatArray:
    """Points far apart: each is the best of a few drawn in proportion to their squared distance to those before."""
    tries = 2 + int(np.log(count))
    first = rng.choice(len(points), p=weights / weights.sum())
    chosen, left = [points[first]], np.square(points - points[first]).sum(1)
    for _ in range(count - 1):
        potential = weights * left
        drawn = rng.choice(len(points), tries, p=potential / potential.sum())
        after = np.minimum(left, _squares(points, points[drawn]).T)
        best = int((after @ weights).argmin())
        chosen.append(points[drawn[best]])
        left = after[best]
    return np.array(chosen)


def _squares(points: FloatArray, centres: FloatArray) -> FloatArray:
    """[S, K] squared distances."""
    squares = np.square(points).sum(1)[:, None] - 2 * points @ centres.T + np.square(centres).sum(1)
    return np.asarray(np.maximum(squares, 0.0))
