"""Holes are filled from measured neighbours; measured heights stay."""

import numpy as np
import pytest

from pentimento.contracts.errors import ContractError
from pentimento.planning.pushes.holes import fill_holes

PLANE = 0.04 + 1e-4 * np.arange(30.0) + 2e-4 * np.arange(20.0)[:, None]


def test_holes_in_a_plane_are_filled_to_the_plane() -> None:
    holed = PLANE.copy()
    holed[5:7, 5:7], holed[15, 20] = np.nan, np.nan
    filled, count = fill_holes(holed)
    assert count == 5
    np.testing.assert_allclose(filled, PLANE, atol=1e-4)
    np.testing.assert_array_equal(filled[np.isfinite(holed)], PLANE[np.isfinite(holed)])


def test_one_measured_pixel_fills_the_map() -> None:
    holed = np.full((16, 16), np.nan)
    holed[3, 4] = 0.04
    np.testing.assert_allclose(fill_holes(holed)[0], 0.04)


@pytest.mark.parametrize(("value", "sentence"), [(np.nan, "nothing but holes"), (np.inf, "infinite")])
def test_fill_holes_rejects_maps_without_finite_heights(value: float, sentence: str) -> None:
    with pytest.raises(ContractError, match=sentence):
        fill_holes(np.full((4, 4), value))
