"""The Earth Mover's Distance between two sets of points, with its gradient (thesis 4.2 as a distance between sets)."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from torch import Tensor

from pentimento.contracts.errors import ContractError

FloatArray = NDArray[np.float64]
_ROUNDING = 1e-9


def earth_movers_distance(points: Tensor, others: Tensor) -> Tensor:
    """Mean Euclidean way from each of ``points`` [N, D] to its partner in ``others`` [N, D], least over all pairings.

    With N points of equal mass on both sides this is exactly the Earth Mover's (1-Wasserstein) distance: a metric
    between sets. It is differentiable in both by the envelope theorem: where the best pairing is unique, moving a
    point by little keeps the pairing, so the gradient is that of the pairs' distances with the pairing held. A pair
    that coincides has the subgradient 0.

    Raises:
        ContractError: the sets are empty, not of one shape [N, D], or not finite.
    """
    return mean_way(points, others, best_partners(ways_between(points, others)))


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
