"""Mixture of paint and ground, and its derivatives."""

import numpy as np
import pytest

from pentimento.diagnosis.strokes.soft_edge import mixture, slopes_of_mixture


def test_power_one_mixes_in_linear_light() -> None:
    below, paint, coverage = np.float32([0.9, 0.5, 0.02]), np.float32([0.05, 0.5, 0.3]), np.float32([0.3])
    np.testing.assert_allclose(mixture(below, paint, coverage, 1), 0.7 * below + 0.3 * paint, rtol=1e-6)
    # A mean of logarithms dims by a share, as a filter does.
    np.testing.assert_allclose(mixture(below, paint, coverage, 1e-3), below**0.7 * paint**0.3, rtol=2e-3)
    for power in (0.2, 0.5, 1.0, 1.5):
        for whole, light in ((0, below), (1, paint)):
            np.testing.assert_allclose(mixture(below, paint, np.float32([whole]), power), light, rtol=1e-5)


@pytest.mark.parametrize("power", [0.3, 0.45, 1.0, 1.6])
def test_slopes_of_a_mixture_are_its_derivatives(power: float) -> None:
    rng = np.random.default_rng(0)
    below, paint = rng.uniform(0.05, 0.95, (2, 50, 3))
    coverage, step = rng.uniform(0.1, 0.9, (50, 1)), 1e-4
    by_coverage, by_paint = slopes_of_mixture(below, paint, coverage, power)
    for slope, up, down in (
        (by_coverage, (below, paint, coverage + step), (below, paint, coverage - step)),
        (by_paint, (below, paint + step, coverage), (below, paint - step, coverage)),
    ):
        np.testing.assert_allclose(slope, (mixture(*up, power) - mixture(*down, power)) / (2 * step), rtol=1e-3)
