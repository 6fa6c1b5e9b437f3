"""Colour: sRGB (IEC 61966-2-1), linear light, CIE L*a*b* (D65) and the CIEDE2000 difference.

All arrays are [..., 3], RGB order, floating point; sRGB and linear light in [0, 1]. A float32 array
stays float32. Paint is mixed and averaged in linear light, compared in L*a*b*, stored in sRGB.
"""

from typing import Any, Final, TypeVar

import numpy as np
import numpy.typing as npt

from pentimento.contracts.errors import ImageError

Float = TypeVar("Float", bound=np.floating[Any])

# Linear sRGB -> XYZ (D65, 2 degrees), IEC 61966-2-1. The white is the image of (1, 1, 1), so that
# white is exactly L* = 100, a* = b* = 0.
_XYZ_FROM_RGB: Final = np.array(
    [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750], [0.0193339, 0.1191920, 0.9503041]]
)
_RGB_FROM_XYZ: Final = np.linalg.inv(_XYZ_FROM_RGB)
_WHITE: Final = _XYZ_FROM_RGB.sum(axis=1)
_DELTA: Final = 6.0 / 29.0  # below this, CIE f() is linear


def _float(array: npt.NDArray[Any], what: str) -> npt.NDArray[Any]:
    if not np.issubdtype(array.dtype, np.floating):
        raise ImageError(f"{what} must be floating point in [0, 1], not {array.dtype}; use to_float first.")
    return array


def to_uint8(srgb: npt.NDArray[Any]) -> npt.NDArray[np.uint8]:
    """sRGB floats in [0, 1] -> uint8, rounded; values outside are cut, NaN is an ImageError."""
    srgb = _float(srgb, "sRGB")
    if np.isnan(srgb).any():
        raise ImageError("An image with NaN cannot be written as uint8; find where the NaN came from.")
    return np.asarray(np.rint(np.clip(srgb, 0.0, 1.0) * 255.0), dtype=np.uint8)


def to_float(image: npt.NDArray[np.uint8]) -> npt.NDArray[np.float32]:
    """uint8 sRGB -> float32 sRGB in [0, 1]."""
    if image.dtype != np.uint8:
        raise ImageError(f"to_float takes a uint8 image, not {image.dtype}.")
    return image.astype(np.float32) / np.float32(255.0)


def srgb_to_linear(srgb: npt.NDArray[Float]) -> npt.NDArray[Float]:
    """sRGB -> linear light. Values outside [0, 1] continue both ends of the curve."""
    srgb = _float(srgb, "sRGB")
    curved = ((np.maximum(srgb, 0.0) + 0.055) / 1.055) ** 2.4
    return np.where(srgb <= 0.04045, srgb / 12.92, curved).astype(srgb.dtype)


def linear_to_srgb(linear: npt.NDArray[Float]) -> npt.NDArray[Float]:
    """Linear light -> sRGB. Values outside [0, 1] continue both ends of the curve."""
    linear = _float(linear, "linear light")
    curved = 1.055 * np.maximum(linear, 0.0) ** (1.0 / 2.4) - 0.055
    return np.where(linear <= 0.0031308, linear * 12.92, curved).astype(linear.dtype)


def srgb_to_lab(srgb: npt.NDArray[Float]) -> npt.NDArray[Float]:
    """sRGB -> CIE L*a*b* (D65): L* in 0..100."""
    xyz = srgb_to_linear(srgb).astype(np.float64) @ _XYZ_FROM_RGB.T / _WHITE
    f = np.where(xyz > _DELTA**3, np.cbrt(xyz), xyz / (3 * _DELTA**2) + 4.0 / 29.0)
    fx, fy, fz = f[..., 0], f[..., 1], f[..., 2]
    lab = np.stack([116.0 * fy - 16.0, 500.0 * (fx - fy), 200.0 * (fy - fz)], axis=-1)
    return lab.astype(srgb.dtype)


def lab_to_srgb(lab: npt.NDArray[Float]) -> npt.NDArray[Float]:
    """CIE L*a*b* (D65) -> sRGB, not cut: colours outside the sRGB gamut leave [0, 1]."""
    lab = _float(lab, "L*a*b*")
    wide = lab.astype(np.float64)
    fy = (wide[..., 0] + 16.0) / 116.0
    f = np.stack([fy + wide[..., 1] / 500.0, fy, fy - wide[..., 2] / 200.0], axis=-1)
    xyz = np.where(f > _DELTA, f**3, 3 * _DELTA**2 * (f - 4.0 / 29.0)) * _WHITE
    return linear_to_srgb(xyz @ _RGB_FROM_XYZ.T).astype(lab.dtype)


def delta_e_2000(lab_a: npt.ArrayLike, lab_b: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """CIEDE2000 colour difference of two L*a*b* arrays [..., 3] -> [...].

    After Sharma, Wu, Dalal, "The CIEDE2000 color-difference formula" (2005); its equation
    numbers are in the comments. Parametric factors k_L = k_C = k_H = 1.
    """
    a, b = np.asarray(lab_a, dtype=np.float64), np.asarray(lab_b, dtype=np.float64)
    c7 = ((np.hypot(a[..., 1], a[..., 2]) + np.hypot(b[..., 1], b[..., 2])) / 2) ** 7  # (2)-(3)
    g = 0.5 * (1 - np.sqrt(c7 / (c7 + 25.0**7)))  # (4)
    a1, a2 = (1 + g) * a[..., 1], (1 + g) * b[..., 1]  # (5)
    c1, c2 = np.hypot(a1, a[..., 2]), np.hypot(a2, b[..., 2])  # (6)
    h1 = np.degrees(np.arctan2(a[..., 2], a1)) % 360.0  # (7)
    h2 = np.degrees(np.arctan2(b[..., 2], a2)) % 360.0
    grey = c1 * c2 == 0  # no hue to compare

    d_l, d_c = b[..., 0] - a[..., 0], c2 - c1  # (8)-(9)
    d_h_deg = np.where(grey, 0.0, (h2 - h1 + 180.0) % 360.0 - 180.0)  # (10)
    d_h_deg = np.where(np.abs(h2 - h1) == 180.0, h2 - h1, d_h_deg)
    d_h = 2 * np.sqrt(c1 * c2) * np.sin(np.radians(d_h_deg) / 2)  # (11)

    mean_l, mean_c = (a[..., 0] + b[..., 0]) / 2, (c1 + c2) / 2  # (12)-(13)
    total = h1 + h2
    across = np.where(total < 360.0, (total + 360.0) / 2, (total - 360.0) / 2)
    mean_h = np.where(np.abs(h1 - h2) <= 180.0, total / 2, across)  # (14)
    mean_h = np.where(grey, total, mean_h)

    def cos_deg(angle_deg: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        return np.cos(np.radians(angle_deg))

    t = (  # (15)
        1
        - 0.17 * cos_deg(mean_h - 30)
        + 0.24 * cos_deg(2 * mean_h)
        + 0.32 * cos_deg(3 * mean_h + 6)
        - 0.20 * cos_deg(4 * mean_h - 63)
    )
    s_l = 1 + 0.015 * (mean_l - 50) ** 2 / np.sqrt(20 + (mean_l - 50) ** 2)  # (18)
    s_c, s_h = 1 + 0.045 * mean_c, 1 + 0.015 * mean_c * t  # (19)-(20)
    turn = 30 * np.exp(-(((mean_h - 275) / 25) ** 2))  # (16)
    r_t = -np.sin(np.radians(2 * turn)) * 2 * np.sqrt(mean_c**7 / (mean_c**7 + 25.0**7))  # (17), (21)
    l_term, c_term, h_term = d_l / s_l, d_c / s_c, d_h / s_h
    squared = l_term**2 + c_term**2 + h_term**2 + r_t * c_term * h_term  # (22)
    return np.asarray(np.sqrt(np.maximum(squared, 0.0)))
