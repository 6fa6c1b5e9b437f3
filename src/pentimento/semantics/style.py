"""x"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from torch import Tensor

from pentimento.contracts.errors import ContractError
from pentimento.planning.strokes.config import PlannerConfig, StyleConfig
from pentimento.planning.strokes.target import fit_to_canvas, load_photograph
from pentimento.semantics.objective import TorchObjective
from pentimento.semantics.style_features import LocalFeatures
from pentimento.semantics.vgg import load_vgg16

FloatArray = NDArray[np.float64]
_ROUNDING = 1e-9


def mean_way(points: Tensor, others: Tensor, partners: NDArray[np.intp]) -> Tensor:
    """Mean Euclidean way from ``points`` [N, D] to their ``partners`` [N] in ``others`` [N, D]; differentiable."""
    index = torch.from_numpy(partners).to(others.device)
    return torch.linalg.vector_norm(points - others[index], dim=1).mean()


def ways_between(points: Tensor, others: Tensor) -> FloatArray:
    """Euclidean distances [N, N] from each of ``points`` [N, D] to each of ``others`` [N, D].

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
        ways = torch.cdist(points, others, compute_mode="donot_use_mm_for_euclid_dist")
    if not bool(torch.isfinite(ways).all()):
        row, column = (int(i) for i in (~torch.isfinite(ways)).nonzero()[0])
        raise ContractError(
            f"The distance of point {row} to point {column} is {float(ways[row, column])}: both sets must be finite. "
            "Look for NaN in the image that the features were taken from."
        )
    return ways.double().cpu().numpy()


def best_partners(ways: FloatArray, prices: FloatArray | None = None) -> NDArray[np.intp]:
    """For each row of ``ways`` [N, N] the column [N] of its partner: the pairing of least total way.

    ``prices`` [N] of the columns change how long this takes, never what comes out: every pairing pays all of them
    once. Those that were fair to nearly the same ways (``fair_prices``) leave a fifth of the work.
    """
    if prices is not None:
        ways = ways - prices
        ways -= ways.min(axis=1, keepdims=True)
    _, partners = linear_sum_assignment(ways)
    return np.asarray(partners)


def fair_prices(ways: FloatArray, partners: NDArray[np.intp]) -> FloatArray:
    """Prices [N] of the columns at which, in the best pairing, each row's own partner is its cheapest.

    They are the dual of the pairing: shortest distances in the graph of columns whose edge j → k is what j's row would
    pay more for k (Bellman and Ford). None is negative around a circle, or there were a better pairing; so N rounds do.
    """
    own = np.empty_like(ways)
    own[partners] = ways  # row j: of the point whose partner is column j
    more = own - own.diagonal()[:, None]
    prices = np.zeros(len(ways))
    for _ in range(len(ways)):
        lower = np.minimum(prices, (prices[:, None] + more).min(axis=0))
        if (prices - lower).max() <= _ROUNDING:
            break
        prices = lower
    return prices


Features = Callable[[Tensor], Tensor]
"""An image [H, W, 3] in linear light to a set [cells, D] of local features, differentiable."""

_MAX = 256
"""Cells in a pairing: its time grows with about their cube."""
_FAIR_FOR = 10
"""Calls until prices are found anew: an image under optimisation moves little meanwhile."""


class StyleObjective:
    """Earth Mover's Distance between the sets of local features of an image and of a style picture.

    Where things are does not matter, how often they occur does. All cells are paired while both pictures have the same
    number, 256 or fewer; otherwise each call draws as many as it can pair, without replacement.
    """

    def __init__(self, style: Tensor, features: Features, seed: int) -> None:
        """Hold the features of ``style``, [H, W, 3] in linear light; ``seed`` is of the draws.

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
        count = min(len(cells), len(self._style), _MAX)
        points, drawn = cells[self._drawn(len(cells), count)], self._drawn(len(self._style), count)
        others = self._style[drawn]
        ways = ways_between(points, others)
        partners = best_partners(ways, self._prices[drawn.numpy()])
        if self._calls % _FAIR_FOR == 0:
            self._prices[drawn.numpy()] = fair_prices(ways, partners)
        self._calls += 1
        return mean_way(points, others, partners)

    def _drawn(self, cells: int, count: int) -> Tensor:
        """Which cells are paired: all, or ``count`` at random."""
        return torch.arange(cells) if cells == count else torch.randperm(cells, generator=self._generator)[:count]


Array = NDArray[np.float32]


def style_of(config: PlannerConfig) -> PictureStyle | None:
    """The style of a planner's objectives, where they have one: what ``Scene.style`` wants."""
    style = config.objectives.style
    return None if style is None else PictureStyle(style, config.seed)


class PictureStyle:
    """A picture's style, a ``planning.scene.Style``."""

    def __init__(self, config: StyleConfig, seed: int) -> None:
        """``seed`` is of the draws where a picture has too many cells to pair them all."""
        self._config, self._seed = config, seed

    def picture(self, shape: tuple[int, int]) -> Array:
        """The picture's largest centred part of the canvas's proportions, linear light [H, W, 3] at ``shape``.

        Raises:
            ImageError: there is no such picture.
        """
        return fit_to_canvas(load_photograph(self._config.picture), shape).astype(np.float32)

    def objective(self, shape: tuple[int, int]) -> TorchObjective:
        """The style objective for images of this height and width.

        Raises:
            ConfigError, ContractError, ImageError: the picture or the file of weights is not there or is none, or the
                picture is too small for local features.
        """
        style = torch.from_numpy(self.picture(shape))
        return TorchObjective(StyleObjective(style, style_features(self._config), self._seed))


def style_features(config: StyleConfig) -> Features:
    """The network that the style objective looks through.

    Raises:
        ConfigError, ContractError: the file of weights is not there, or is none; see ``vgg.load_vgg16``.
    """
    match config.features:
        case "local":
            return LocalFeatures()
        case "vgg16":
            assert config.vgg16_weights is not None  # __post_init__ saw to it
            return load_vgg16(Path(config.vgg16_weights))
