"""Partial paintings: subsets of the strokes of a full painting (thesis 6.4.1, Figure 6.4).

Strokes are removed by four strategies, so that a goal planner learns to start on an empty canvas (`all`), to continue
anywhere (`random`), to add the salient part of a picture (`salient`) and to add one thing (`semantic`). Subsets depend
on the geometry of the strokes only; nothing is rendered.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.ranges import at_least

FloatArray = NDArray[np.floating]
BoolArray = NDArray[np.bool_]


@dataclass(frozen=True)
class PartialsConfig:
    """How many partial paintings of each strategy are made of one full painting, at most."""

    random: int
    random_kept: tuple[float, float]
    """Range of the fraction of strokes that a random subset keeps."""
    salient_shares: tuple[float, ...]
    """For each fraction, the strokes on that most salient fraction of the picture are removed."""
    semantic: int
    """Regions, the largest first; the strokes of one region are removed."""
    min_inside_share: float
    """A stroke belongs to a region if at least this fraction of its path lies in it."""
    margin_m: float
    """Regions are dilated by this distance, because the strokes of an outline lie on the border."""

    def __post_init__(self) -> None:
        at_least(self, 0, "random", "semantic", "margin_m")
        low, high = self.random_kept
        if not 0 < low <= high < 1:
            raise ValueError(f"random_kept is {[low, high]}; give two rising shares above 0 and below 1.")
        if not all(0 < share < 1 for share in self.salient_shares):
            raise ValueError(f"salient_shares is {list(self.salient_shares)}; each must be above 0 and below 1.")
        if not 0 < self.min_inside_share <= 1:
            raise ValueError(f"min_inside_share is {self.min_inside_share}; it must be above 0, and 1 at most.")


@dataclass(frozen=True, eq=False)
class Partial:
    """The strokes that a partial painting shows."""

    strategy: str
    """`all`, `random`, `salient` or `semantic`: how strokes were removed."""
    region: int | None
    """The label of the region whose strokes were removed, for `semantic`."""
    kept: BoolArray
    """[S], True for strokes that stay."""


def partials(
    points_m: FloatArray,
    saliency: FloatArray,
    regions: NDArray[np.integer],
    canvas_size_m: tuple[float, float],
    *,
    config: PartialsConfig,
    rng: np.random.Generator,
) -> list[Partial]:
    """All partial paintings of a plan, each different from the others; none for a plan without strokes.

    A subset with all strokes is left out, and so is one that equals another. For a picture with one thing, `semantic`
    often equals `all`.

    Args:
        points_m: [S, N, 2] points along the strokes, canvas frame.
        saliency: [H, W] of the whole canvas.
        regions: [H, W] labels of the whole canvas, 0 for the background.
    """

    def strokes_on(region: BoolArray) -> BoolArray:
        return on_region(points_m, region, canvas_size_m, inside=config.min_inside_share, margin_m=config.margin_m)

    number = len(points_m)
    found = [Partial("all", None, np.zeros(number, bool))]
    for label in largest_labels(regions, config.semantic):
        found.append(Partial("semantic", label, ~strokes_on(regions == label)))
    for share in config.salient_shares:
        found.append(Partial("salient", None, ~strokes_on(most_salient(saliency, share))))
    found += [Partial("random", None, random_subset(number, config.random_kept, rng)) for _ in range(config.random)]
    first: dict[bytes, Partial] = {}
    for partial in found:
        if not partial.kept.all():
            first.setdefault(partial.kept.tobytes(), partial)
    return list(first.values())


def random_subset(strokes: int, kept: tuple[float, float], rng: np.random.Generator) -> BoolArray:
    """[S]: a random subset whose fraction is uniform over `kept`; if possible, at least one stroke stays and one
    goes."""
    count = int(np.clip(round(rng.uniform(*kept) * strokes), min(1, strokes), max(strokes - 1, 0)))
    chosen = np.zeros(strokes, bool)
    chosen[rng.permutation(strokes)[:count]] = True
    return chosen


def most_salient(saliency: FloatArray, share: float) -> BoolArray:
    """[H, W]: the most salient `share` of the pixels; no pixel of a constant map."""
    region: BoolArray = saliency > np.quantile(saliency, 1 - share)
    return region


def largest_labels(regions: NDArray[np.integer], count: int) -> list[int]:
    """The labels of the `count` largest regions, without the background's 0; of equal ones the lower label first."""
    labels, sizes = np.unique(regions[regions > 0], return_counts=True)
    return [int(labels[i]) for i in np.lexsort((labels, -sizes))[:count]]


def on_region(
    points_m: FloatArray, region: BoolArray, canvas_size_m: tuple[float, float], *, inside: float, margin_m: float
) -> BoolArray:
    """[S]: whether at least the fraction `inside` of a stroke's points lies within `margin_m` of the region.

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
