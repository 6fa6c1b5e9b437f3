"""The pairing without SciPy is SciPy's in total, and the way between sets is Euclid's."""

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

from pentimento.bundle.assignment import best_partners, ways_between


@pytest.mark.parametrize("count", [1, 2, 7, 60])
@pytest.mark.parametrize("ties", [False, True])
def test_no_pairing_is_shorter(count: int, ties: bool) -> None:
    rng = np.random.default_rng(count)
    for _ in range(20):
        ways = rng.integers(0, 4, (count, count)).astype(float) if ties else rng.random((count, count))
        partners = best_partners(ways)
        assert sorted(partners) == list(range(count))
        rows, columns = linear_sum_assignment(ways)
        assert ways[np.arange(count), partners].sum() == pytest.approx(ways[rows, columns].sum())


def test_points_shuffled_find_themselves() -> None:
    rng = np.random.default_rng(0)
    points = rng.random((40, 9), np.float32)
    order = rng.permutation(40)
    ways = ways_between(points, points[order])
    np.testing.assert_allclose(ways, cdist(points, points[order]), atol=1e-6)
    np.testing.assert_array_equal(order[best_partners(ways)], np.arange(40))
