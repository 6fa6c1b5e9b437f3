"""K-means finds what it is to find, and weights count."""

import numpy as np
import pytest

from pentimento.planning.strokes.palette import weighted_kmeans


def clouds(seed: int, count: int = 5) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    centres = rng.permutation(count)[:, None] * np.array([30.0, -20.0, 10.0]) + rng.normal(0, 1, (count, 3))
    return centres, (centres[:, None] + rng.normal(0, 0.5, (count, 40, 3))).reshape(-1, 3)


@pytest.mark.parametrize("seed", range(5))
def test_kmeans_separates_distant_clusters(seed: int) -> None:
    centres, points = clouds(seed)
    found = weighted_kmeans(points, np.ones(len(points)), 5, np.random.default_rng(seed))
    distance = np.linalg.norm(found[:, None] - centres, axis=-1)
    assert sorted(distance.argmin(1)) == list(range(5))
    assert distance.min(1).max() < 0.5


def test_kmeans_with_one_centre_is_the_weighted_mean() -> None:
    rng = np.random.default_rng(0)
    points, weights = rng.normal(size=(30, 3)), rng.uniform(0.1, 2, 30)
    (centre,) = weighted_kmeans(points, weights, 1, rng)
    np.testing.assert_allclose(centre, weights @ points / weights.sum())


def test_kmeans_weight_two_equals_a_repeated_point() -> None:
    rng = np.random.default_rng(1)
    points = rng.normal(size=(20, 3))
    weights = rng.integers(1, 4, 20)

    def cost(points_: np.ndarray, weights_: np.ndarray, centres: np.ndarray) -> float:
        return float(weights_ @ np.square(points_[:, None] - centres).sum(-1).min(1))

    once = weighted_kmeans(points, weights.astype(float), 3, np.random.default_rng(0))
    repeated = np.repeat(points, weights, axis=0)
    often = weighted_kmeans(repeated, np.ones(len(repeated)), 3, np.random.default_rng(0))
    one, other = (cost(points, weights.astype(float), centres) for centres in (once, often))
    assert one == pytest.approx(other, rel=0.1)


def test_kmeans_with_as_many_centres_as_points_is_exact() -> None:
    points = np.random.default_rng(2).normal(size=(6, 3))
    found = weighted_kmeans(points, np.ones(6), 6, np.random.default_rng(0))
    np.testing.assert_allclose(found[np.lexsort(found.T)], points[np.lexsort(points.T)])


def test_kmeans_merges_coincident_points() -> None:
    points = np.repeat(np.array([[0.0, 0, 0], [50, 0, 0], [0, 50, 0]]), [9, 1, 4], axis=0)
    found = weighted_kmeans(points, np.ones(14), 3, np.random.default_rng(0))
    np.testing.assert_allclose(found[np.lexsort(found.T)], np.unique(points, axis=0)[[0, 1, 2]][[0, 2, 1]], atol=1e-9)
