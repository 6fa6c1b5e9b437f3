"""Photographs of height maps: light from the upper left, shadows and hollows."""

import numpy as np

from pentimento.goals3d.shading import photograph

WINDOW_M = (0.0, 0.0, 0.064, 0.064)
FLAT = np.full((64, 64), 0.04, np.float32)


def brightness(height: np.ndarray, scale: int = 1) -> np.ndarray:
    return photograph(height, WINDOW_M, scale).astype(float).mean(axis=-1)


def test_photograph_of_level_clay_is_uniform() -> None:
    assert np.ptp(brightness(FLAT)) == 0
    np.testing.assert_array_equal(brightness(FLAT), brightness(FLAT + np.float32(0.01)))


def test_photograph_lights_mound_from_upper_left() -> None:
    x, y = np.meshgrid(np.arange(64) - 31.5, 31.5 - np.arange(64))
    mound = FLAT + (0.005 * np.exp(-(x**2 + y**2) / 72)).astype(np.float32)
    picture = brightness(mound)
    assert picture[24:30, 24:30].mean() > brightness(FLAT).mean() + 10  # row 0 is the top
    assert picture[34:40, 34:40].mean() < brightness(FLAT).mean() - 10


def test_photograph_casts_shadow_of_wall() -> None:
    wall = FLAT.copy()
    wall[:, 30:33] += 0.006
    picture = brightness(wall)
    assert picture[30, 36] < 0.7 * picture[30, 60]
    assert picture[30, 20] > 0.9 * picture[30, 60]


def test_photograph_darkens_hollows() -> None:
    x, y = np.meshgrid(np.arange(64) - 31.5, np.arange(64) - 31.5)
    bowl = FLAT - (0.004 * np.exp(-(((x**2 + y**2) / 300) ** 2))).astype(np.float32)
    assert brightness(bowl)[30:34, 30:34].mean() < brightness(bowl)[2:6, 2:6].mean()


def test_photograph_scales_up() -> None:
    assert photograph(FLAT, WINDOW_M, 3).shape == (192, 192, 3)
