"""Paint as light sees it: Kubelka-Munk films over a background, in three bands.

K absorbs and S scatters, both per thickness of a nominal film. Source: P. Kubelka, "New contributions to
the optics of intensely light-scattering materials", J. Opt. Soc. Am. 38 (1948).
"""

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pentimento.studio.world import Paint

LIGHTEST, DARKEST = 0.94, 0.012  # masstones that pigments can reach
FREEZE_STEP = 0.01  # change of dryness that is worth looking at again

Array = NDArray[np.float64]
Field = NDArray[np.float32]


@dataclass(frozen=True)
class Pigment:
    """Optical constants of a mixed paint: float64[3] each."""

    absorption: Array
    scattering: Array


def pigment(masstone_linear: Array, paint: Paint) -> Pigment:
    """Paint whose infinitely thick layer has this reflectance, float64[3] linear; a dye's nominal film has
    it on white.

    Dark paints scatter less, so that no film absorbs more than `paint.absorption` allows.
    """
    masstone = np.clip(np.asarray(masstone_linear, dtype=np.float64), DARKEST, LIGHTEST)
    if paint.medium == "ink":
        # Light passes a dye twice; the densest dye (a masstone of DARKEST) has the absorption of the paint.
        density = paint.absorption * np.log(masstone) / np.log(DARKEST)
        return Pigment(density, np.full(3, paint.scattering))
    ratio = (1 - masstone) ** 2 / (2 * masstone)
    scattering = paint.scattering / (1 + ratio * paint.scattering / paint.absorption)
    return Pigment(ratio * scattering, scattering)


@njit(cache=True)
def film_over(absorption: float, scattering: float, background: float) -> float:
    """Reflectance of a film with these K and S times its thickness over a background of this reflectance."""
    if scattering < 1e-6:
        return float(background * np.exp(-2 * absorption))
    a = 1 + absorption / scattering
    b = np.sqrt(max(a * a - 1, 1e-12))
    x = b * scattering
    # b coth(x), which tends to 1/S as x tends to 0
    t = b / np.tanh(x) if x < 20 else b
    return float((1 - background * (a - t)) / (a - background + t))


@njit(cache=True)
def lay_film(
    film: Field,
    wet: Field,
    below: Field,
    painted_s: Field,
    clock_s: float,
    drying_s: float,
    drying_loss: float,
    stirring: float,
) -> None:
    """Lay a stroke's film float32[h,w,7] (volume, K[3], S[3]) on the sheet, in place.

    wet: float32[h,w,7] the uppermost layer; below: float32[h,w,3] linear reflectance of what lies beneath
    it; painted_s: float32[h,w] when the uppermost layer was painted. A wet layer is stirred into the new
    one as far as it is liquid and the new one is thick enough to do so; what is left of it becomes
    background.
    """
    rows, columns = painted_s.shape
    for r in range(rows):
        for c in range(columns):
            volume = film[r, c, 0]
            if volume < 1e-4:
                continue
            if wet[r, c, 0] > 1e-5:
                liquid = np.exp(-(clock_s - painted_s[r, c]) / drying_s)
                share = stirring * liquid * volume / (volume + 0.3)
                solid = 1 - drying_loss * _setting(liquid)
                for i in range(3):
                    k, s = wet[r, c, 1 + i], wet[r, c, 4 + i]
                    below[r, c, i] = film_over(k * (1 - share), s * (1 - share) * solid, below[r, c, i])
                for i in range(7):
                    film[r, c, i] += share * wet[r, c, i]
            for i in range(7):
                wet[r, c, i] = film[r, c, i]
            painted_s[r, c] = clock_s


@njit(cache=True)
def _setting(liquid: float) -> float:
    """How far the binder has cleared: it starts late, when most of the water is gone."""
    return (1 - liquid) ** 2


@njit(cache=True)
def refresh(
    seen: Field,
    seen_liquid: Field,
    wet: Field,
    below: Field,
    painted_s: Field,
    clock_s: float,
    drying_s: float,
    drying_loss: float,
) -> None:
    """Bring the sheet's appearance `seen` (float32[H,W,3] linear) up to date where it has changed, in place.

    seen_liquid: float32[H,W] the liquid share for which `seen` holds, or 2 where it must be looked at again.
    """
    rows, columns = painted_s.shape
    for r in range(rows):
        for c in range(columns):
            if wet[r, c, 0] <= 1e-5:
                continue
            stale = seen_liquid[r, c] > 1.5
            if not stale and (drying_loss == 0 or seen_liquid[r, c] < FREEZE_STEP):
                continue
            liquid = np.exp(-(clock_s - painted_s[r, c]) / drying_s)
            if not stale and seen_liquid[r, c] - liquid < FREEZE_STEP:
                continue
            solid = 1 - drying_loss * _setting(liquid)
            for i in range(3):
                seen[r, c, i] = film_over(wet[r, c, 1 + i], wet[r, c, 4 + i] * solid, below[r, c, i])
            seen_liquid[r, c] = liquid
