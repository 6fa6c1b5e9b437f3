"""The style objective (thesis 4.3.4, eq. 4.2): the Earth Mover's Distance between sets of local features.

The distance is exact, not the relaxed one of STROTSS (Kolkin et al. 2019), in which many features may share a partner
and which therefore does not constrain proportions: after 60 gradient steps on pixels it left 1.5 to 2.3 times the exact
distance. All cells are paired instead of a sample: with a quarter of the cells, redrawn at each call, 1.5 to 1.8 times
as much was left, and with the same quarter at each call three times as much.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Final

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from torch import Tensor

from pentimento.bundle.manifest import MAX_CELLS
from pentimento.contracts.errors import ContractError
from pentimento.planning.strokes.config import PlanConfig, StyleConfig
from pentimento.planning.strokes.target import fit_to_canvas, load_photograph
from pentimento.semantics.objective import TorchObjective
from pentimento.semantics.style_features import LocalFeatures
from pentimento.semantics.vgg import load_vgg16

FloatArray = NDArray[np.float64]
_TOLERANCE: Final = 1e-9  # of prices, in units of the costs

Features = Callable[[Tensor], Tensor]
"""Maps an image [H, W, 3] in linear light to a set [cells, D] of local features, differentiable."""
_PRICES_VALID_FOR: Final = 10
"""Calls until prices are computed again: an image under optimisation changes little in between."""
Array = NDArray[np.float32]


def mean_distance(points: Tensor, others: Tensor, partners: NDArray[np.intp]) -> Tensor:
    """Mean Euclidean distance of `points` [N, D] and their `partners` [N] in `others` [N, D]; differentiable.

    With the optimal pairing it is the Earth Mover's (1-Wasserstein) distance of two sets of N points of equal mass. By
    the envelope theorem its gradient is that of the pairs' distances with the pairing held fixed. A pair that coincides
    has the subgradient 0.
    """
    index = torch.from_numpy(partners).to(others.device)
    return torch.linalg.vector_norm(points - others[index], dim=1).mean()


def distances(points: Tensor, others: Tensor) -> FloatArray:
    """Euclidean distances [N, N] of `points` [N, D] and `others` [N, D].

    Raises:
        ContractError: the sets are empty, not of one shape [N, D], or not finite.
    """
    if points.ndim != 2 or points.shape != others.shape or len(points) == 0:
        raise ContractError(
            f"Sets of shapes {tuple(points.shape)} and {tuple(others.shape)} have no pairing: "
            "give two of one shape [N, D] with at least one point."
        )
    with torch.no_grad():
        # Differences, not the expanded square: its rounding would pair near neighbours at random.
        costs = torch.cdist(points, others, compute_mode="donot_use_mm_for_euclid_dist")
    if not bool(torch.isfinite(costs).all()):
        row, column = (int(i) for i in (~torch.isfinite(costs)).nonzero()[0])
        raise ContractError(
            f"The distance of point {row} to point {column} is {float(costs[row, column])}: both sets must be finite. "
            "Look for NaN in the image that the features were taken from."
        )
    return costs.double().cpu().numpy()


def optimal_pairing(costs: FloatArray, prices: FloatArray | None = None) -> NDArray[np.intp]:
    """For each row of `costs` [N, N], the column [N] of its partner: the assignment of minimum total cost.

    `prices` [N] of the columns change the run time only, because every assignment pays each of them once. Those of
    nearly the same costs (`dual_prices`) reduce it to a fifth.
    """
    if prices is not None:
        costs = costs - prices
        costs -= costs.min(axis=1, keepdims=True)
    _, partners = linear_sum_assignment(costs)
    return np.asarray(partners)


def dual_prices(costs: FloatArray, partners: NDArray[np.intp]) -> FloatArray:
    """Prices [N] of the columns at which the partner of each row is its cheapest column: the dual of the assignment.

    They are shortest distances in the graph of columns whose edge j → k is the additional cost of k for the row of j
    (Bellman and Ford). An optimal assignment has no negative cycle, so N rounds suffice.
    """
    own = np.empty_like(costs)
    own[partners] = costs  # row j: of the point whose partner is column j
    more = own - own.diagonal()[:, None]
    prices = np.zeros(len(costs))
    for _ in range(len(costs)):
        lower = np.minimum(prices, (prices[:, None] + more).min(axis=0))
        if (prices - lower).max() <= _TOLERANCE:
            break
        prices = lower
    return prices


class StyleObjective:
    """Earth Mover's Distance between the sets of local features of an image and of a style picture.

    It depends on how often features occur, not on where. If both pictures have the same number of cells, at most
    `MAX_CELLS`, all cells are paired; otherwise each call draws cells without replacement.
    """

    def __init__(self, style: Tensor, features: Features, seed: int) -> None:
        """Compute the features of `style`, [H, W, 3] in linear light; `seed` is of the draws.

        Raises:
            ConfigError: the picture is too small to have features.
        """
        self._features = features
        with torch.no_grad():
            self._style = features(style)
        self._generator = torch.Generator().manual_seed(seed)
        self._prices = np.zeros(len(self._style))
        self._calls = 0

    def __call__(self, image: Tensor) -> Tensor:
        """The objective for an image [H, W, 3] in linear light; a scalar, differentiable.

        Raises:
            ConfigError: the image is too small to have features.
            ContractError: the image is not finite.
        """
        cells = self._features(image)
        count = min(len(cells), len(self._style), MAX_CELLS)
        points, drawn = cells[self._drawn(len(cells), count)], self._drawn(len(self._style), count)
        others = self._style[drawn]
        costs = distances(points, others)
        partners = optimal_pairing(costs, self._prices[drawn.numpy()])
        if self._calls % _PRICES_VALID_FOR == 0:
            self._prices[drawn.numpy()] = dual_prices(costs, partners)
        self._calls += 1
        return mean_distance(points, others, partners)

    def _drawn(self, cells: int, count: int) -> Tensor:
        """Indices of the cells to pair: all, or `count` at random."""
        return torch.arange(cells) if cells == count else torch.randperm(cells, generator=self._generator)[:count]


def style_of(config: PlanConfig) -> PictureStyle | None:
    """The style of a planner's objectives for `Scene.style`, or None if it has none."""
    style = config.objectives.style
    return None if style is None else PictureStyle(style, config.seed)


class PictureStyle:
    """The style of a picture, a `planning.strokes.scene.Style`."""

    def __init__(self, config: StyleConfig, seed: int) -> None:
        """`seed` is of the draws if a picture has too many cells to pair them all."""
        self._config, self._seed = config, seed

    def picture(self, shape: tuple[int, int]) -> Array:
        """The largest centred part of the picture with the canvas's proportions, linear light [H, W, 3] at `shape`.

        Raises:
            ImageError: there is no such picture.
        """
        return fit_to_canvas(load_photograph(self._config.picture), shape).astype(np.float32)

    def objective(self, shape: tuple[int, int]) -> TorchObjective:
        """The style objective for images of this height and width.

        Raises:
            ConfigError, ContractError, ImageError: the picture or the weights are missing or invalid, or the picture is
                too small for local features.
        """
        style = torch.from_numpy(self.picture(shape))
        return TorchObjective(StyleObjective(style, style_features(self._config), self._seed))


def style_features(config: StyleConfig) -> Features:
    """The features of the style objective.

    Raises:
        ConfigError, ContractError: the file of weights is missing or invalid; see `vgg.load_vgg16`.
    """
    match config.features:
        case "local":
            return LocalFeatures()
        case "vgg16":
            assert config.vgg16_weights is not None  # __post_init__ saw to it
            return load_vgg16(Path(config.vgg16_weights))
