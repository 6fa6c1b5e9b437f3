"""The Earth Mover's Distance is a metric, optimal, and differentiable."""

import itertools

import numpy as np
import pytest
import torch
from torch import Tensor

from pentimento.contracts.errors import ContractError
from pentimento.semantics.style import distances, dual_prices, mean_distance, optimal_pairing


def earth_movers_distance(one: Tensor, other: Tensor) -> Tensor:
    """Mean distance [] between two sets [N, D] under the best pairing."""
    return mean_distance(one, other, optimal_pairing(distances(one, other)))


def points(count: int, dimensions: int, seed: int) -> Tensor:
    return torch.randn(count, dimensions, dtype=torch.float64, generator=torch.Generator().manual_seed(seed))


@pytest.mark.parametrize(("count", "dimensions"), [(1, 3), (40, 1), (60, 12)])
def test_earth_movers_distance_is_a_metric(count: int, dimensions: int) -> None:
    a, b, c = (points(count, dimensions, seed) for seed in range(3))
    assert float(earth_movers_distance(a, a)) == 0
    assert float(earth_movers_distance(a, b)) > 0
    torch.testing.assert_close(earth_movers_distance(a, b), earth_movers_distance(b, a))
    way, detour = earth_movers_distance(a, c), earth_movers_distance(a, b) + earth_movers_distance(b, c)
    assert float(way) <= float(detour) + 1e-12


def test_earth_movers_distance_ignores_order() -> None:
    a, b = points(50, 4, 0), points(50, 4, 1)
    shuffled = a[torch.randperm(50, generator=torch.Generator().manual_seed(2))]
    assert float(earth_movers_distance(a, shuffled)) == 0
    torch.testing.assert_close(earth_movers_distance(shuffled, b), earth_movers_distance(a, b))


def test_earth_movers_distance_on_a_line_is_the_difference_of_sorted_points() -> None:
    a, b = points(80, 1, 0), 2 * points(80, 1, 1) + 0.3
    expected = (a.sort(0).values - b.sort(0).values).abs().mean()
    torch.testing.assert_close(earth_movers_distance(a, b), expected)


def test_earth_movers_distance_of_a_shifted_set_is_the_shift() -> None:
    a, step = points(50, 3, 0), torch.tensor([0.3, -0.4, 1.2], dtype=torch.float64)
    torch.testing.assert_close(earth_movers_distance(a, a + step), step.norm())  # no pairing beats the mean's way


def test_earth_movers_distance_equals_brute_force() -> None:
    a, b = points(6, 2, 3), points(6, 2, 4)
    minimum = min(float((a - b[list(order)]).norm(dim=1).mean()) for order in itertools.permutations(range(6)))
    assert float(earth_movers_distance(a, b)) == pytest.approx(minimum, rel=1e-12)


def test_prices_do_not_change_the_pairing() -> None:
    ways = distances(points(60, 3, 0), points(60, 3, 1))
    partners = optimal_pairing(ways)
    for prices in (dual_prices(ways, partners), np.random.default_rng(0).normal(size=60)):
        np.testing.assert_array_equal(optimal_pairing(ways, prices), partners)


def test_dual_prices_prove_the_pairing_optimal() -> None:
    """Strong duality: no pairing costs less than what the rows' cheapest offers and the prices add up to."""
    ways = distances(points(60, 3, 0), points(60, 3, 1))
    partners = optimal_pairing(ways)
    prices = dual_prices(ways, partners)
    bound = (ways - prices).min(axis=1).sum() + prices.sum()
    assert float(ways[np.arange(60), partners].sum()) == pytest.approx(bound, rel=1e-9)
    np.testing.assert_allclose((ways - prices)[np.arange(60), partners], (ways - prices).min(axis=1), atol=1e-8)


def test_earth_movers_gradient_equals_finite_differences() -> None:
    a, b = points(12, 3, 0).requires_grad_(True), points(12, 3, 1).requires_grad_(True)
    assert torch.autograd.gradcheck(earth_movers_distance, (a, b))


def test_earth_movers_gradient_of_equal_sets_is_finite() -> None:
    a = points(5, 3, 0).requires_grad_(True)
    (gradient,) = torch.autograd.grad(earth_movers_distance(a, a.detach()), a)
    assert float(gradient.abs().max()) == 0


@pytest.mark.parametrize("others", [(4, 3), (5, 2), (5,)])
def test_rejects_sets_of_different_shapes(others: tuple[int, ...]) -> None:
    with pytest.raises(ContractError, match=r"shapes \(5, 3\) and .* have no pairing"):
        earth_movers_distance(torch.zeros(5, 3), torch.zeros(others))


def test_names_a_point_that_is_not_finite() -> None:
    broken = points(5, 3, 0)
    broken[3, 1] = float("nan")
    with pytest.raises(ContractError, match=r"distance of point 3 to point 0 is nan"):
        distances(broken, points(5, 3, 1))
