"""The polynomials for log2 and exp2 against NumPy's double precision."""

from typing import Any

import numpy as np
import pytest
from numba import njit

from pentimento.render.fastmath import exp2, log2


@njit
def logs(x: Any) -> Any:
    out = np.empty_like(x)
    for i in range(x.size):
        out[i] = log2(x[i])
    return out


@njit
def powers(x: Any) -> Any:
    out = np.empty_like(x)
    for i in range(x.size):
        out[i] = exp2(x[i])
    return out


@pytest.mark.parametrize(("dtype", "bound"), [(np.float32, 5e-7), (np.float64, 1e-14)])
def test_log2_and_exp2_are_accurate(dtype: type, bound: float) -> None:
    x = np.geomspace(1e-3, 1, 20001).astype(dtype)
    assert np.abs(logs(x) - np.log2(x.astype(np.float64))).max() <= 10 * bound  # absolute; up to 10 in size
    y = np.linspace(-20, 0, 20001).astype(dtype)
    np.testing.assert_allclose(powers(y), np.exp2(y.astype(np.float64)), rtol=4 * bound)


def test_integer_powers_are_exact_to_rounding() -> None:
    whole = np.arange(-40, 41).astype(np.float32)
    np.testing.assert_allclose(logs(np.exp2(whole)), whole, atol=5e-7)
    np.testing.assert_allclose(powers(whole), np.exp2(whole), rtol=5e-7)


def test_exp2_of_large_negative_does_not_wrap() -> None:
    assert 0 <= powers(np.array([-1e6], np.float32))[0] < 1e-37
