"""A Gaussian over height maps, however wide, beside SciPy's."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from pentimento.dynamics.pushes.spread import spread


@pytest.mark.parametrize("sigma_px", [0.6, 1.9, 2.1, 5.5, 30.0])
def test_narrow_and_wide_ones_are_gaussians_and_nothing_comes_from_beyond_the_edge(sigma_px: float) -> None:
    maps = np.random.default_rng(0).normal(size=(3, 64, 48))
    expected = gaussian_filter(maps, (0, sigma_px, sigma_px), mode="constant", truncate=4)
    assert np.allclose(spread(maps, sigma_px), expected, atol=2e-4)


def test_volume_is_kept_away_from_the_edges() -> None:
    heap = np.zeros((1, 96, 96))
    heap[0, 48, 48] = 1.0
    assert spread(heap, 6.0).sum() == pytest.approx(1.0, abs=1e-5)
