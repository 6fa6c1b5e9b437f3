"""Chamfer and Earth Mover's Distance have closed forms on shifted lattices."""

import numpy as np
import pytest

from pentimento.dynamics.pushes.clouds import chamfer, cloud, earth_movers, thinned

FLAT = cloud(np.full((10, 12), 0.04), np.ones((10, 12), dtype=bool), 500.0)


def test_a_small_lift_is_its_height() -> None:
    lifted = FLAT + np.array([0.0, 0.0, 5e-4])
    assert chamfer(FLAT, lifted) == pytest.approx(1e-3)  # both directions
    assert earth_movers(FLAT, lifted) == pytest.approx(5e-4)


def test_a_point_far_off_costs_the_pairing_its_share() -> None:
    moved = FLAT.copy()
    moved[7] += [0.0, 0.0, 0.1]
    assert earth_movers(FLAT, moved) == pytest.approx(0.1 / 120)
    assert earth_movers(FLAT, FLAT[::-1]) == pytest.approx(0.0)


def test_clouds_of_two_sizes_can_be_paired() -> None:
    assert 0 < earth_movers(FLAT, FLAT[:60] + 1e-4) < 0.03


def test_unknown_pixels_are_no_points() -> None:
    known = np.ones((10, 12), dtype=bool)
    known[2, 3] = False
    assert len(cloud(np.full((10, 12), 0.04), known, 500.0)) == 119


def test_y_points_up() -> None:
    height = np.zeros((10, 12))
    height[0, 5] = 1.0
    points = cloud(height, np.ones((10, 12), dtype=bool), 500.0)
    assert points[points[:, 2].argmax(), 1] == points[:, 1].max()


def test_thinning_averages_and_noise_about_the_centre_makes_no_second_layer() -> None:
    rng = np.random.default_rng(0)
    noisy = FLAT + np.array([0, 0, 1]) * rng.normal(0, 1e-4, (120, 1))
    thin = thinned(noisy, 5e-3, np.median(noisy, axis=0))
    area_voxels = (12 / 500 / 5e-3 + 2) * (10 / 500 / 5e-3 + 2)
    assert len(thin) <= area_voxels
    assert thin[:, 2].std() < 1e-4
