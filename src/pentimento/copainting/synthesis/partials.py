"""Partial paintings: which strokes of a full one are there already (thesis 6.4.1, Figure 6.4).

Strokes are removed in four ways, so that a goal planner learns to begin on an empty canvas (all), to go on anywhere
(random), to add what a picture is about (salient) and to add one thing (semantic). What stays is told by the strokes'
geometry alone; nothing is rendered here.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.ranges import at_least

FloatArray = NDArray[np.floating]
BoolArray = NDArray[np.bool_]


@dataclass(frozen=True)
class PartialsConfig:
    """How many partial paintings of each kind are made of one full painting, at most."""

    random: int
    random_kept: tuple[float, float]
    """Least and largest share of the strokes that a random subset keeps."""
    salient_shares: tuple[float, ...]
    """For each share, the strokes on so much of the picture, its most salient part, are removed."""
    semantic: int
    """Regions, the largest first: for each, its strokes are removed."""
    inside: float
    """A stroke belongs to a region when at least this share of its path lies in it."""
    margin_m: float
    """Regions are wider by this: an outline's strokes lie on the border."""

    def __post_init__(self) -> None:
        at_least(self, 0, "random", "semantic", "margin_m")
        low, high = self.random_kept
        if not 0 < low <= high < 1:
            raise ValueError(f"random_kept is {[low, high]}; give two rising shares above 0 and below 1.")
        if not all(0 < share < 1 for share in self.salient_shares):
            raise ValueError(f"salient_shares is {list(self.salient_shares)}; each must be above 0 and below 1.")
        if not 0 < self.inside <= 1:
            raise ValueError(f"inside is {self.inside}; it must be above 0, and 1 at most.")


class Partial(NamedTuple):
    """Which strokes a partial painting shows."""

    strategy: str
    """``all``, ``random``, ``salient`` or ``semantic``: which strokes were removed."""
    region: int | None
    """The label of the region whose strokes were removed, for ``semantic``."""
    kept: BoolArray
    """[S]."""


def partials(
    points_m: FloatArray,
    saliency: FloatArray,
    regions: NDArray[np.integer],
    canvas_size_m: tuple[float, float],
    config: PartialsConfig,
    rng: np.random.Generator,
) -> list[Partial]:
    """All partial paintings of one plan, each different from the others; none where there is no stroke.

    What would remove no stroke is left out, and so is what removes the same strokes as another: those of a picture's
    one thing are all, and a random subset may be anything.

    Args:
        points_m: [S, N, 2] places along the strokes, canvas frame.
        saliency: [H, W] of the whole canvas.
        regions: [H, W] labels of the whole canvas, 0 the background.
    """
    number = len(points_m)
    found = [Partial("all", None, np.zeros(number, bool))]
    for label in largest_labels(regions, config.semantic):
        gone = on_region(points_m, regions == label, canvas_size_m, config.inside, config.margin_m)
        found.append(Partial("semantic", label, ~gone))
    for share in config.salient_shares:
        gone = on_region(points_m, most_salient(saliency, share), canvas_size_m, config.inside, config.margin_m)
        found.append(Partial("salient", None, ~gone))
    found += [Partial("random", None, random_subset(number, config.random_kept, rng)) for _ in range(config.random)]
    first: dict[bytes, Partial] = {}
    for partial in found:
        if not partial.kept.all():
            first.setdefault(partial.kept.tobytes(), partial)
    return list(first.values())


def random_subset(strokes: int, kept: tuple[float, float], rng: np.random.Generator) -> BoolArray:
    """[S]: a random subset whose share is uniform over ``kept``; at least one stroke stays and one goes, if it can."""
    count = int(np.clip(round(rng.uniform(*kept) * strokes), min(1, strokes), max(strokes - 1, 0)))
    chosen = np.zeros(strokes, bool)
    chosen[rng.permutation(strokes)[:count]] = True
    return chosen


def most_salient(saliency: FloatArray, share: float) -> BoolArray:
    """[H, W]: the ``share`` of the picture's pixels that is the most salient; nothing in a map without difference."""
    region: BoolArray = saliency > np.quantile(saliency, 1 - share)
    return region


def largest_labels(regions: NDArray[np.integer], most: int) -> list[int]:
    """The labels of the regions by falling size, without the background's 0; of equal ones the lower label first."""
    labels, sizes = np.unique(regions[regions > 0], return_counts=True)
    return [int(labels[i]) for i in np.lexsort((labels, -sizes))[:most]]


def on_region(
    points_m: FloatArray, region: BoolArray, canvas_size_m: tuple[float, float], inside: float, margin_m: float
) -> BoolArray:
    """[S]: whether at least the share ``inside`` of a stroke's points lies on the region or within ``margin_m`` of it.

    Args:
        points_m: [S, N, 2], canvas frame.
        region: [H, W] of the whole canvas; row 0 is its top.
    """
    height, width = region.shape
    k = width / canvas_size_m[0]
    # From each pixel's centre to that of the region's nearest pixel; on the region 0.
    away_px = cv2.distanceTransform((~region).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    near = region | ((away_px <= margin_m * k) & bool(region.any()))
    columns = np.clip((points_m[..., 0] * k).astype(int), 0, width - 1)
    rows = np.clip(((canvas_size_m[1] - points_m[..., 1]) * height / canvas_size_m[1]).astype(int), 0, height - 1)
    hit: BoolArray = near[rows, columns].mean(1) >= inside
    return hit
