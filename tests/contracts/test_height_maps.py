import numpy as np
import pytest

from pentimento.contracts.errors import ContractError, ImageError
from pentimento.contracts.height_maps import decode_height_m, encode_height_png, level, surface_at_m
from pentimento.contracts.images import encode_png

UNIT_M = 1e-6


def test_heights_come_back_to_half_a_unit_and_holes_as_holes() -> None:
    heights = np.random.default_rng(0).uniform(0.03, 0.05, (6, 9))
    heights[2, 3] = np.nan
    decoded = decode_height_m(encode_height_png(heights, UNIT_M), UNIT_M)
    np.testing.assert_array_equal(np.isnan(decoded), np.isnan(heights))
    assert np.nanmax(np.abs(decoded - heights)) <= 0.5 * UNIT_M * (1 + 1e-9)


def test_the_bare_table_is_not_a_hole() -> None:
    decoded = decode_height_m(encode_height_png([[0.0, -0.001, 0.002]], UNIT_M), UNIT_M)
    np.testing.assert_allclose(decoded, [[UNIT_M, UNIT_M, 0.002]])


def test_millimetres_given_as_metres_are_refused() -> None:
    with pytest.raises(ContractError, match="metres against millimetres"):
        encode_height_png(np.full((2, 2), 40.0), UNIT_M)


@pytest.mark.parametrize("heights", [np.zeros(3), np.zeros((0, 4)), [[np.inf]]])
def test_what_is_no_height_map_is_refused(heights: np.ndarray) -> None:
    with pytest.raises(ContractError):
        encode_height_png(heights, UNIT_M)


@pytest.mark.parametrize("unit", [0.0, -1e-6, np.nan, np.inf])
def test_a_unit_is_a_length(unit: float) -> None:
    with pytest.raises(ContractError, match="height_per_unit_m"):
        encode_height_png(np.ones((2, 2)), unit)
    with pytest.raises(ContractError, match="height_per_unit_m"):
        decode_height_m(encode_height_png(np.full((2, 2), 0.04), UNIT_M), unit)


@pytest.mark.parametrize(
    ("png", "error", "words"),
    [
        (encode_png(np.ones((4, 4), np.uint8)), ImageError, "this PNG has 8"),
        (encode_png(np.ones((4, 4, 3), np.uint8)), ImageError, "in colour"),
        (encode_png(np.zeros((4, 4), np.uint16)), ContractError, "nothing but holes"),
        (b"", ImageError, "not a readable image"),
    ],
)
def test_other_pictures_are_named_errors(png: bytes, error: type[Exception], words: str) -> None:
    with pytest.raises(error, match=words):
        decode_height_m(png, UNIT_M)


def test_a_scan_of_holes_alone_can_be_written_but_not_read_as_heights() -> None:
    with pytest.raises(ContractError, match="nothing but holes"):
        decode_height_m(encode_height_png(np.full((3, 3), np.nan), UNIT_M), UNIT_M)


WINDOW = (0.0, 0.0, 0.06, 0.04)


def test_levelling_takes_the_table_s_plane_out() -> None:
    x_m, y_m = (np.arange(30) + 0.5) * 0.002, 0.04 - (np.arange(20) + 0.5) * 0.002
    tilted = 0.03 + 0.1 * x_m[None, :] - 0.2 * y_m[:, None] + 0.001
    np.testing.assert_allclose(level(tilted, WINDOW, [0.1, -0.2, 0.001]), 0.03, atol=1e-12)
    with pytest.raises(ContractError, match="three finite numbers"):
        level(tilted, WINDOW, [np.nan, 0, 0])


def test_the_surface_at_a_place_is_what_lies_around_it() -> None:
    heights = np.full((20, 30), 0.03)
    heights[:5] = 0.05  # the uppermost centimetre
    heights[16, 15] = np.nan
    heights[16, 16] = 7.0  # a speck
    assert surface_at_m(heights, WINDOW, 0.03, 0.037) == 0.05
    assert surface_at_m(heights, WINDOW, 0.031, 0.007) == 0.03
    with pytest.raises(ContractError, match="outside"):
        surface_at_m(heights, WINDOW, 0.03, 0.05)
    heights[10:] = np.nan
    assert surface_at_m(heights, WINDOW, 0.03, 0.018) == 0.03  # 2 mm beside what is known
    assert surface_at_m(heights, WINDOW, 0.03, 0.012) == 0.03  # 8 mm
    with pytest.raises(ContractError, match="hole of 20 mm"):
        surface_at_m(heights, WINDOW, 0.03, 0.007)
