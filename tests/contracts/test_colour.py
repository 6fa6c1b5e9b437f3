from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.testing import assert_allclose, assert_array_equal

from pentimento.contracts.colour import (
    delta_e_2000,
    lab_to_srgb,
    linear_to_srgb,
    srgb_to_lab,
    srgb_to_linear,
    to_float,
    to_uint8,
)
from pentimento.contracts.errors import ImageError

colours = arrays(np.float64, (4, 3), elements=st.floats(0.0, 1.0))
labs = arrays(np.float64, (4, 3), elements=st.floats(-100.0, 100.0))

# Sharma, Wu, Dalal (2005), table 1: L a b, L a b, CIEDE2000.
SHARMA = np.array(
    [
        [50.0000, 2.6772, -79.7751, 50.0000, 0.0000, -82.7485, 2.0425],
        [50.0000, 3.1571, -77.2803, 50.0000, 0.0000, -82.7485, 2.8615],
        [50.0000, 2.8361, -74.0200, 50.0000, 0.0000, -82.7485, 3.4412],
        [50.0000, -1.3802, -84.2814, 50.0000, 0.0000, -82.7485, 1.0000],
        [50.0000, -1.1848, -84.8006, 50.0000, 0.0000, -82.7485, 1.0000],
        [50.0000, -0.9009, -85.5211, 50.0000, 0.0000, -82.7485, 1.0000],
        [50.0000, 0.0000, 0.0000, 50.0000, -1.0000, 2.0000, 2.3669],
        [50.0000, -1.0000, 2.0000, 50.0000, 0.0000, 0.0000, 2.3669],
        [50.0000, 2.4900, -0.0010, 50.0000, -2.4900, 0.0009, 7.1792],
        [50.0000, 2.4900, -0.0010, 50.0000, -2.4900, 0.0010, 7.1792],
        [50.0000, 2.4900, -0.0010, 50.0000, -2.4900, 0.0011, 7.2195],
        [50.0000, 2.4900, -0.0010, 50.0000, -2.4900, 0.0012, 7.2195],
        [50.0000, -0.0010, 2.4900, 50.0000, 0.0009, -2.4900, 4.8045],
        [50.0000, -0.0010, 2.4900, 50.0000, 0.0010, -2.4900, 4.8045],
        [50.0000, -0.0010, 2.4900, 50.0000, 0.0011, -2.4900, 4.7461],
        [50.0000, 2.5000, 0.0000, 50.0000, 0.0000, -2.5000, 4.3065],
        [50.0000, 2.5000, 0.0000, 73.0000, 25.0000, -18.0000, 27.1492],
        [50.0000, 2.5000, 0.0000, 61.0000, -5.0000, 29.0000, 22.8977],
        [50.0000, 2.5000, 0.0000, 56.0000, -27.0000, -3.0000, 31.9030],
        [50.0000, 2.5000, 0.0000, 58.0000, 24.0000, 15.0000, 19.4535],
        [50.0000, 2.5000, 0.0000, 50.0000, 3.1736, 0.5854, 1.0000],
        [50.0000, 2.5000, 0.0000, 50.0000, 3.2972, 0.0000, 1.0000],
        [50.0000, 2.5000, 0.0000, 50.0000, 1.8634, 0.5757, 1.0000],
        [50.0000, 2.5000, 0.0000, 50.0000, 3.2592, 0.3350, 1.0000],
        [60.2574, -34.0099, 36.2677, 60.4626, -34.1751, 39.4387, 1.2644],
        [63.0109, -31.0961, -5.8663, 62.8187, -29.7946, -4.0864, 1.2630],
        [61.2901, 3.7196, -5.3901, 61.4292, 2.2480, -4.9620, 1.8731],
        [35.0831, -44.1164, 3.7933, 35.0232, -40.0716, 1.5901, 1.8645],
        [22.7233, 20.0904, -46.6940, 23.0331, 14.9730, -42.5619, 2.0373],
        [36.4612, 47.8580, 18.3852, 36.2715, 50.5065, 21.2231, 1.4146],
        [90.8027, -2.0831, 1.4410, 91.1528, -1.6435, 0.0447, 1.4441],
        [90.9257, -0.5406, -0.9208, 88.6381, -0.8985, -0.7239, 1.5381],
        [6.7747, -0.2908, -2.4247, 5.8714, -0.0985, -2.2286, 0.6377],
        [2.0776, 0.0795, -1.1350, 0.9033, -0.0636, -0.5514, 0.9082],
    ]
)


@pytest.mark.parametrize("pair", SHARMA, ids=lambda pair: f"{pair[-1]}")
def test_delta_e_2000_of_the_published_pairs(pair: np.ndarray) -> None:
    assert delta_e_2000(pair[:3], pair[3:6]) == pytest.approx(pair[6], abs=5e-5)
    assert delta_e_2000(pair[3:6], pair[:3]) == pytest.approx(pair[6], abs=5e-5)


def test_delta_e_2000_broadcasts() -> None:
    assert_allclose(delta_e_2000(SHARMA[:, :3], SHARMA[:, 3:6]), SHARMA[:, 6], atol=5e-5)
    assert delta_e_2000(SHARMA[:, None, :3], SHARMA[None, :, 3:6]).shape == (34, 34)


@given(labs)
def test_delta_e_is_a_symmetric_difference(lab: np.ndarray) -> None:
    assert_allclose(delta_e_2000(lab, lab), 0.0, atol=1e-9)
    there, back = delta_e_2000(lab, lab[::-1]), delta_e_2000(lab[::-1], lab)
    assert np.isfinite(there).all() and (there >= 0).all()
    assert_allclose(there, back, rtol=1e-6, atol=1e-6)


def test_delta_e_of_greys_of_equal_hue_is_lightness_over_its_weight() -> None:
    # a = b = 0 leaves dL / S_L, and S_L at the mean lightness 50 is 1.
    assert delta_e_2000([45.0, 0, 0], [55.0, 0, 0]) == pytest.approx(10.0)


@given(colours)
def test_round_trips(srgb: np.ndarray) -> None:
    assert_allclose(linear_to_srgb(srgb_to_linear(srgb)), srgb, atol=1e-6)
    assert_allclose(lab_to_srgb(srgb_to_lab(srgb)), srgb, atol=1e-6)


def test_every_byte_survives_linear_light_in_float32() -> None:
    bytes_ = np.repeat(np.arange(256, dtype=np.uint8)[:, None], 3, axis=1)
    linear = srgb_to_linear(to_float(bytes_))
    assert linear.dtype == np.float32
    assert_array_equal(to_uint8(linear_to_srgb(linear)), bytes_)


def test_known_values() -> None:
    # IEC 61966-2-1: sRGB 0.5 is 0.21404 of the light; white is L* = 100 without colour.
    assert srgb_to_linear(np.full(3, 0.5))[0] == pytest.approx(0.214041, abs=1e-6)
    assert_allclose(srgb_to_lab(np.ones(3)), [100, 0, 0], atol=1e-9)
    assert_allclose(srgb_to_lab(np.array([1.0, 0.0, 0.0])), [53.24, 80.09, 67.20], atol=0.01)
    assert_allclose(srgb_to_lab(np.array([0.0, 0.0, 1.0])), [32.30, 79.19, -107.86], atol=0.01)


def test_curves_rise_and_join() -> None:
    ramp = np.linspace(-0.2, 1.2, 2001)
    for curve in (srgb_to_linear, linear_to_srgb):
        values = curve(ramp)
        assert all(a < b for a, b in pairwise(values))
        assert np.diff(values).max() < 0.02


def test_bad_input_raises_contract_error() -> None:
    with pytest.raises(ImageError, match="use to_float first"):
        srgb_to_linear(np.zeros((2, 3), np.uint8))
    with pytest.raises(ImageError, match="NaN"):
        to_uint8(np.full((1, 3), np.nan))
    with pytest.raises(ImageError, match="uint8"):
        to_float(np.zeros((2, 3)))


def test_to_uint8_rounds_and_cuts() -> None:
    assert_array_equal(to_uint8(np.array([-0.1, 0.4999 / 255, 0.5001 / 255, 1.7])), [0, 0, 1, 255])
