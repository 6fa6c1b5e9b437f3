"""log2 and exp2 that the compiler can vectorise.

The C library's functions are called element by element. For float32 these are polynomials over one octave with an error
of 3e-7. For float64, where accuracy matters more than speed, they are the C library's.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic, overload
from numpy.polynomial import Chebyshev, Polynomial

_OPTIONS = {"fastmath": True, "error_model": "numpy"}


def _coefficients(function: Callable[[Any], Any], degree: int) -> list[np.float32]:
    """Coefficients, lowest power first, of the Chebyshev interpolation of ``function`` on [0, 1]."""
    fitted = Chebyshev.interpolate(function, degree, domain=[0, 1]).convert(kind=Polynomial)
    return [np.float32(c) for c in fitted.coef]


_L0, _L1, _L2, _L3, _L4, _L5, _L6, _L7, _L8 = _coefficients(lambda x: np.log2(1 + x), 8)
_E0, _E1, _E2, _E3, _E4, _E5, _E6 = _coefficients(np.exp2, 6)


@intrinsic
def _bits(_context: Any, _x: Any) -> Any:
    """The bits of a float32 as an int32."""
    return types.int32(types.float32), lambda _c, builder, _s, a: builder.bitcast(a[0], ir.IntType(32))


@intrinsic
def _from_bits(_context: Any, _x: Any) -> Any:
    """The float32 of an int32's bits."""
    return types.float32(types.int32), lambda _c, builder, _s, a: builder.bitcast(a[0], ir.FloatType())


def log2(x: float) -> float:
    """Base-2 logarithm of a normal positive number, in compiled code only."""
    raise NotImplementedError("log2 runs inside compiled code")


def exp2(x: float) -> float:
    """2 to the power x ≤ 127, in compiled code only. Below −126 the result is that of −126."""
    raise NotImplementedError("exp2 runs inside compiled code")


@overload(log2, jit_options=_OPTIONS)
def _log2(x: Any) -> Any:
    if x != types.float32:

        def precise(x: Any) -> Any:
            return np.log2(x)

        return precise

    def polynomial(x: Any) -> Any:
        bits = _bits(x)
        octave = np.int32((bits >> np.int32(23)) - np.int32(127))
        m = _from_bits(np.int32((bits & np.int32(0x7FFFFF)) | np.int32(0x3F800000))) - np.float32(1)
        high = ((_L8 * m + _L7) * m + _L6) * m + _L5
        return np.float32(octave) + ((((high * m + _L4) * m + _L3) * m + _L2) * m + _L1) * m + _L0

    return polynomial


@overload(exp2, jit_options=_OPTIONS)
def _exp2(x: Any) -> Any:
    if x != types.float32:

        def precise(x: Any) -> Any:
            return np.exp2(x)

        return precise

    def polynomial(x: Any) -> Any:
        bounded = max(x, np.float32(-126))
        octave = np.floor(bounded)
        f = bounded - octave
        scale = _from_bits(np.int32((np.int32(octave) + np.int32(127)) << np.int32(23)))
        return scale * ((((((_E6 * f + _E5) * f + _E4) * f + _E3) * f + _E2) * f + _E1) * f + _E0)

    return polynomial
