from dataclasses import replace

import numpy as np
from numpy.testing import assert_allclose

from pentimento.studio.clay.scanner import calibrated_plane, in_shadow, scan_height_m, table_plane
from pentimento.studio.clay.world import load_clay_world

SCANNER = replace(load_clay_world("clay_table").scanner, pixels=64)
SIZE = (0.1, 0.1)
FLAT = np.full((128, 128), 0.04)


def rng() -> np.random.Generator:
    return np.random.default_rng(5)


def exact(**changes: object) -> object:
    clean = replace(SCANNER, noise_m=0.0, step_m=1e-9, dropout=0.0, tilt=(0.0, 0.0), lift_m=0.0)
    return replace(clean, **changes)  # type: ignore[arg-type]


def test_a_level_surface_is_seen_at_its_height_but_for_the_table_s_plane() -> None:
    assert_allclose(scan_height_m(FLAT, SIZE, exact(), rng()), 0.04, atol=1e-8)
    tilted = scan_height_m(FLAT, SIZE, exact(tilt=(0.01, -0.02), lift_m=0.001), rng())
    assert_allclose(tilted[0, 0], 0.041 + 0.01 * (0.1 / 128) - 0.02 * (0.1 - 0.1 / 128), atol=1e-8)
    assert_allclose(tilted[-1, -1], 0.041 + 0.01 * (0.1 - 0.1 / 128) - 0.02 * (0.1 / 128), atol=1e-8)


def test_noise_has_its_size_and_grows_on_slopes() -> None:
    level = scan_height_m(FLAT, SIZE, exact(noise_m=1e-4), rng())
    assert_allclose(np.std(level), 1e-4, rtol=0.05)
    ramp = FLAT + np.linspace(0, 0.1, 128)[None, :]  # slope 1, away from the light
    seen = scan_height_m(ramp, SIZE, exact(noise_m=1e-4, azimuth_rad=np.pi), rng())
    rest = seen - scan_height_m(ramp, SIZE, exact(azimuth_rad=np.pi), rng())
    assert np.nanstd(rest) > 1.4e-4


def test_heights_come_in_steps() -> None:
    seen = scan_height_m(FLAT, SIZE, exact(noise_m=1e-4, step_m=5e-5), rng())
    assert_allclose(np.rint(seen / 5e-5), seen / 5e-5, atol=1e-6)


def test_a_wall_throws_its_shadow_away_from_the_projector() -> None:
    wall = FLAT.copy()
    wall[:, 60:64] += 0.02
    for azimuth, shaded in ((0.0, np.s_[:, 22:29]), (np.pi, np.s_[:, 34:41])):
        seen = scan_height_m(wall, SIZE, exact(elevation_rad=np.pi / 4, azimuth_rad=azimuth), rng())
        other = np.s_[:, 34:41] if azimuth == 0.0 else np.s_[:, 22:29]
        assert np.isnan(seen[shaded]).all()
        assert np.isfinite(seen[other]).all()


def test_the_shadow_is_as_long_as_the_wall_over_the_light_s_slope() -> None:
    height = np.zeros((9, 60))
    height[:, 40] = 5.5
    dark = in_shadow(height, 1.0, 0.0, 0.5)
    assert dark[4].sum() == 10
    assert dark[4, 30:40].all()


def test_light_from_the_top_shades_what_lies_below_an_edge() -> None:
    edge = FLAT.copy()
    edge[:64] += 0.02
    seen = scan_height_m(edge, SIZE, exact(elevation_rad=np.pi / 4, azimuth_rad=np.pi / 2), rng())
    assert np.isnan(seen[33:42]).all()
    assert np.isfinite(seen[:31]).all()


def test_some_pixels_are_lost_at_random() -> None:
    seen = scan_height_m(FLAT, SIZE, exact(dropout=0.05), rng())
    assert 0.03 < np.isnan(seen).mean() < 0.07


def test_the_plane_is_known_but_for_its_calibration() -> None:
    believed, true = calibrated_plane(SCANNER, rng()), table_plane(SCANNER)
    assert 0 < np.abs(believed / true - 1).max() < 5 * SCANNER.plane_error
