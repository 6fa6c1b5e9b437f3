"""The print objective sees tone from afar, and sums weigh values and gradients."""

import numpy as np
import pytest

from pentimento.contracts.errors import ConfigError
from pentimento.planning.objectives import PrintObjective, Term, WeightedObjective


def picture(height: int, width: int, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).random((height, width, 3), np.float32)


def test_print_objective_averages_fine_patterns_at_a_distance() -> None:
    stripes = np.zeros((32, 32, 3), np.float32)
    stripes[::2] = 1.0
    grey = np.full((32, 32, 3), 0.5, np.float32)
    assert PrintObjective(grey, (4,))(stripes)[0] < 1e-10  # averaged in linear light
    assert PrintObjective(grey, (1,))(stripes)[0] > 0.1


def test_print_gradient_agrees_with_finite_differences() -> None:
    image, target = (picture(24, 30, seed).astype(np.float64) for seed in (0, 1))
    objective = PrintObjective(target, (1, 4))
    way = np.random.default_rng(2).normal(size=image.shape)
    ends = [objective(image + step * way)[0] for step in (-1e-6, 1e-6)]
    assert (ends[1] - ends[0]) / 2e-6 == pytest.approx(float((objective(image)[1] * way).sum()), rel=1e-5)


def test_print_objective_rejects_a_distance_larger_than_the_picture() -> None:
    with pytest.raises(ConfigError, match=r"41 px is larger than the picture of 40 x 60 px: .*distances_px"):
        PrintObjective(picture(40, 60, 0), (1, 41))


def test_weighted_objective_weights_values_and_gradients() -> None:
    image, target = picture(32, 48, 0), picture(32, 48, 1)
    near, far = PrintObjective(target, (1,)), PrintObjective(target, (8,))
    both = WeightedObjective((Term("near", 0.5, near), Term("far", 3.0, far)))
    assert both.values(image) == {"near": near(image)[0], "far": far(image)[0]}
    value, gradient = both(image)
    assert value == pytest.approx(0.5 * near(image)[0] + 3 * far(image)[0])
    np.testing.assert_allclose(gradient, 0.5 * near(image)[1] + 3 * far(image)[1], atol=1e-9)


def test_weighted_objective_skips_terms_of_weight_zero() -> None:
    def fails(image: np.ndarray) -> tuple[float, np.ndarray]:
        raise AssertionError

    kept = Term("print", 1.0, lambda image: (float(image.sum()), np.ones_like(image)))
    assert list(WeightedObjective((kept, Term("style", 0.0, fails))).values(np.ones(2, np.float32))) == ["print"]


@pytest.mark.parametrize(
    ("weights", "names", "sentence"),
    [
        ((0.0, 0.0), "ab", "No objective of"),
        ((1.0, -1.0), "ab", "each must be 0 or more"),
        ((1.0, float("nan")), "ab", "each must be 0 or more"),
        ((1.0, 1.0), "aa", "share a name"),
    ],
)
def test_weighted_objective_rejects_invalid_terms(weights: tuple[float, float], names: str, sentence: str) -> None:
    terms = (Term(n, w, PrintObjective(picture(4, 4, 0), (1,))) for n, w in zip(names, weights, strict=True))
    with pytest.raises(ValueError, match=sentence):
        WeightedObjective(tuple(terms))
