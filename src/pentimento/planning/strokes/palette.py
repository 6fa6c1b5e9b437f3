"""Paints for a plan: clustered from its colours (thesis 4.3.5, Figure 4.6) or a picture's, or given by the person."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.colour import lab_to_srgb, srgb_to_lab, to_float
from pentimento.planning.strokes.target import load_photograph

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Mask = NDArray[np.bool_]

_PICTURE_PIXELS = 20_000
"""Largest number of a picture's pixels that are clustered, drawn at random."""
_RESTARTS = 4
"""Of k-means; the best result is kept."""
_MAX_ITERATIONS = 300
"""Of k-means in one start, as in scikit-learn."""
_TOLERANCE = 1e-4
"""Squared shift of the centres, as a share of the points' variance, at which k-means stops; as in scikit-learn."""
_SHADES = 40
"""Clusters among which salient colours are looked for."""
_SALIENT_PAINTS = 3
"""Largest number of paints that are salient colours."""
_MIN_SHARE = 0.002
"""Smallest share of the picture of a salient colour: an eye in a face."""
_UNLIKE = 8.0
"""Smallest difference of a salient colour from every other paint, in L*/√2, a*, b*. Hue counts more than lightness,
because strokes of two paints can look like one between them in lightness, and seldom in hue.
"""


@dataclass(frozen=True)
class PaletteChoice:
    """Which paints the person lays out."""

    source: Literal["plan", "picture", "given", "ink"]
    """``plan``: the strokes' own colours, clustered with regard to small salient ones, then optimised with the strokes.
    ``picture``: a picture's colours, clustered. ``given``: ``colors_srgb``. ``ink``: none, the tool has its own."""
    size: int | None
    """Number of paints, for ``plan`` and ``picture``."""
    picture: str | None
    """A file, or the name of a photograph that scikit-image ships."""
    colors_srgb: tuple[tuple[float, float, float], ...] | None
    """The paints of ``given``."""

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
        weights: [S] weight of each colour: the area that its stroke covers.
        size: number of paints. There are fewer where there are fewer distinct colours.

    Returns:
        The palette, sRGB [K, 3], from light to dark; and which paint each colour takes, [S].
    """
    lab = srgb_to_lab(np.asarray(colors_srgb, dtype=np.float64))
    size = min(size, len(np.unique(lab.round(6), axis=0)))
    centres = weighted_kmeans(lab, weights, size, np.random.default_rng([seed, 3]))
    palette = light_first(np.clip(lab_to_srgb(centres), 0.0, 1.0))
    return palette, nearest_paint(colors_srgb, palette)


def salient_palette(
    colors_srgb: FloatArray, weights: FloatArray, size: int, seed: int
) -> tuple[FloatArray, IntArray, Mask]:
    """``cluster_palette`` with some paints kept for small colours that differ from all others.

    Colours with little weight have no cluster of their own: a tabby gets twelve browns and brown eyes. The colours are
    therefore also clustered into many shades. While a shade differs from every paint by ``_UNLIKE`` or more, the one
    with the largest difference times root of its weight becomes a paint, and the rest are clustered into the others.

    Returns:
        As ``cluster_palette``; and which paints are such shades, [K].
    """
    lab = srgb_to_lab(np.asarray(colors_srgb, dtype=np.float64))
    distinct = len(np.unique(lab.round(6), axis=0))
    size = min(size, distinct)
    shades = weighted_kmeans(lab, weights, min(_SHADES, distinct), np.random.default_rng([seed, 5]))
    shade = _squares(lab, shades).argmin(1)
    share = np.bincount(shade, weights, len(shades)) / weights.sum()
    kept = np.zeros((0, 3))
    left = np.ones(len(lab), dtype=bool)
    while True:
        others = min(size - len(kept), len(np.unique(lab[left].round(6), axis=0)))
        paints = np.concatenate(
            [weighted_kmeans(lab[left], weights[left], others, np.random.default_rng([seed, 3])), kept]
        )
        unlike = np.sqrt((np.square(shades[:, None] - paints) * (0.5, 1.0, 1.0)).sum(-1).min(1))
        salience = np.where((share >= _MIN_SHARE) & (unlike >= _UNLIKE), unlike * np.sqrt(share), 0.0)
        if len(kept) == min(_SALIENT_PAINTS, size - 1) or salience.max() == 0:
            break
        most = int(salience.argmax())
        kept = np.concatenate([kept, shades[most : most + 1]])
        left &= shade != most
    order = np.argsort(-paints[:, 0], kind="stable")
    palette = np.clip(lab_to_srgb(paints[order]), 0.0, 1.0)
    return palette, nearest_paint(colors_srgb, palette), order >= len(paints) - len(kept)


def picture_palette(name_or_path: str, size: int, seed: int) -> FloatArray:
    """The clustered colours of a picture, sRGB [K, 3], from light to dark.

    Raises:
        ImageError: the picture does not exist.
    """
    pixels = to_float(load_photograph(name_or_path)).astype(np.float64).reshape(-1, 3)
    some = np.random.default_rng([seed, 1]).choice(len(pixels), min(_PICTURE_PIXELS, len(pixels)), replace=False)
    return cluster_palette(pixels[some], np.ones(len(some)), size, seed)[0]


def light_first(palette_srgb: FloatArray) -> FloatArray:
    """The paints by decreasing lightness."""
    return np.asarray(palette_srgb[np.argsort(-srgb_to_lab(palette_srgb)[:, 0], kind="stable")])


def nearest_paint(colors_srgb: FloatArray, palette_srgb: FloatArray) -> IntArray:
    """[S] the paint nearest to each colour, in L*a*b*."""
    difference = srgb_to_lab(np.asarray(colors_srgb, dtype=np.float64))[:, None] - srgb_to_lab(palette_srgb)
    return np.asarray(np.square(difference).sum(-1).argmin(1))


def weighted_kmeans(points: FloatArray, weights: FloatArray, count: int, rng: np.random.Generator) -> FloatArray:
    """Weighted k-means (Lloyd 1982) with greedy k-means++ starts (Arthur & Vassilvitskii 2007): centres [K, D].

    Args:
        points: [S, D], at least ``count`` of them distinct.
        weights: [S], above 0.
    """
    found = [_lloyd(points, weights, _spread_start(points, weights, count, rng)) for _ in range(_RESTARTS)]
    return min(found, key=lambda centres: float(weights @ _squares(points, centres).min(1)))


def _lloyd(points: FloatArray, weights: FloatArray, centres: FloatArray) -> FloatArray:
    settled = _TOLERANCE * points.var(0).mean()
    for _ in range(_MAX_ITERATIONS):
        squares = _squares(points, centres)
        nearest = squares.argmin(1)
        mass = np.bincount(nearest, weights, len(centres))
        sums = np.stack([np.bincount(nearest, weights * column, len(centres)) for column in points.T], axis=1)
        # An empty cluster moves to the points with the largest weighted error.
        worst = points[np.argsort(-weights * squares.min(1), kind="stable")[: len(centres)]]
        moved = np.where(mass[:, None] > 0, sums / np.maximum(mass, 1e-300)[:, None], worst)
        shift, centres = np.square(moved - centres).sum(), moved
        if shift <= settled:
            break
    return centres


def _spread_start(points: FloatArray, weights: FloatArray, count: int, rng: np.random.Generator) -> FloatArray:
    """Distant points: each is the best of a few drawn in proportion to their squared distance to those before."""
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
