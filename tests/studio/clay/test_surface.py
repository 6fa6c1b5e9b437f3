from dataclasses import replace

import cv2
import numpy as np
from numpy.testing import assert_allclose, assert_array_equal

from pentimento.studio.clay.slab import cells_shape, fresh_surface, smooth_field
from pentimento.studio.clay.world import load_clay_world

SLAB = load_clay_world("foam").slab


def rng() -> np.random.Generator:
    return np.random.default_rng(3)


def test_the_grid_is_finer_than_the_scan_and_has_square_cells() -> None:
    assert cells_shape(SLAB, 128) == (256, 256)
    assert cells_shape(SLAB, 512) == (1024, 1024)
    rows, columns = cells_shape(replace(SLAB, size_m=(0.2, 0.1)), 128)
    assert (rows, columns) == (128, 256)


def test_a_field_is_standard_and_the_same_at_every_resolution() -> None:
    coarse, fine = smooth_field((64, 64), 8.0, rng()), smooth_field((192, 192), 24.0, rng())
    assert_allclose([coarse.mean(), coarse.std()], [0, 1], atol=1e-9)
    assert_allclose(cv2.resize(fine, (64, 64), interpolation=cv2.INTER_AREA), coarse, atol=0.15)


def test_a_field_is_smooth_over_its_grain() -> None:
    rough, smooth = (smooth_field((96, 96), grain, rng()) for grain in (4.0, 24.0))
    assert np.diff(smooth, axis=1).std() < 0.4 * np.diff(rough, axis=1).std()


def test_smoothed_slab_has_the_height_and_roughness_of_its_world() -> None:
    surface = fresh_surface(replace(SLAB, height_spread_m=0.0), (128, 128), rng())
    assert_allclose(surface.mean(), SLAB.height_m, atol=1e-6)
    assert_allclose(surface.std(), np.hypot(SLAB.undulation_m, SLAB.roughness_m), rtol=0.1)
    plane = fresh_surface(replace(SLAB, height_spread_m=0.0, undulation_m=0.0, roughness_m=0.0), (32, 32), rng())
    assert_array_equal(plane, SLAB.height_m)
