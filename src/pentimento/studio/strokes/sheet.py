"""The sheet and the paint on it: texture, tilt, spreading of liquid, and Kubelka-Munk films in three bands.

K absorbs and S scatters, both per thickness of a nominal film. Source: P. Kubelka, "New contributions to the optics of
intensely light-scattering materials", J. Opt. Soc. Am. 38 (1948).
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from pentimento.studio.strokes.world import Effects, Paint, Paper

CELLS_PER_M = 4000.0
BLEED_M = 0.00055  # wicking distance in a blotting paper at strength 1
WICKING_M_PER_SQRT_S = 0.0009

Field = NDArray[np.float32]


def sheet_shape(paper: Paper) -> tuple[int, int]:
    """Rows and columns of the fine grid."""
    return round(paper.size_m[1] * CELLS_PER_M), round(paper.size_m[0] * CELLS_PER_M)


def grain_field(paper: Paper, rng: np.random.Generator) -> Field:
    """Height of the paper's texture by rank, float32[H,W] uniform in [0,1]; paint reaches the peaks (1) first."""
    shape = sheet_shape(paper)
    size = paper.grain_m * CELLS_PER_M
    fine = cv2.GaussianBlur(rng.standard_normal(shape, dtype=np.float32), (0, 0), 0.45 * size)
    coarse = cv2.GaussianBlur(rng.standard_normal(shape, dtype=np.float32), (0, 0), 1.6 * size)
    height = fine / fine.std() + 0.6 * coarse / coarse.std()
    # The logistic function with this slope is the normal distribution's rank to 1 %.
    return np.asarray(1 / (1 + np.exp(-1.702 * height / height.std())), dtype=np.float32)


def absorbency_field(paper: Paper, rng: np.random.Generator) -> Field:
    """Absorbency, float32[H,W]: patches of centimetres times a random humidity of the sheet."""
    rows, columns = sheet_shape(paper)
    humidity = float(np.exp(0.35 * rng.standard_normal()))
    coarse = rng.standard_normal((rows // 40 + 2, columns // 40 + 2), dtype=np.float32)
    patches = cv2.resize(cv2.GaussianBlur(coarse, (0, 0), 1.0), (columns, rows), interpolation=cv2.INTER_CUBIC)
    thirst = paper.absorbency * humidity * np.exp(0.9 * patches)
    return np.asarray(thirst / (0.5 + thirst), dtype=np.float32)


def surface_height_m(paper: Paper, effects: Effects, xy_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Height of the sheet above the robot's nominal plane at positions float64[M,2] (`canvas_tilt`)."""
    half = 0.5 * np.asarray(paper.size_m)
    u, v = ((xy_m - half) / half).T
    plane = paper.tilt_m[0] * u + paper.tilt_m[1] * v
    bow = paper.bow_m * (np.cos(0.5 * np.pi * u) * np.cos(0.5 * np.pi * v) - 0.35 * u * v)
    return np.asarray(effects.canvas_tilt * (plane + bow))


def spread(film: NDArray[np.float32], reach_cells: Field, grain: Field) -> None:
    """Let liquid wick outwards, in place, with its volume kept: film float32[H,W,C], reach float32[H,W] in cells.

    An explicit diffusion whose conductivity follows the fibres, so that edges feather; after it a line's
    edge has about `reach_cells` as standard deviation.
    """
    largest = float(reach_cells.max(initial=0.0))
    steps = int(np.ceil(largest**2 / 2 / 0.22))
    if steps == 0:
        return
    conductivity = (reach_cells**2 / (2 * steps) * (0.35 + 1.3 * grain)).astype(np.float32)
    np.minimum(conductivity, np.float32(0.24), out=conductivity)
    buffer = np.empty_like(film)
    for _ in range(steps):
        _diffuse(film, conductivity, buffer)
        film[:] = buffer


@njit(cache=True)
def _diffuse(film: NDArray[np.float32], conductivity: Field, out: NDArray[np.float32]) -> None:
    rows, columns, channels = film.shape
    out[:] = film
    for r in range(rows):
        for c in range(columns):
            for side in range(2):
                r2, c2 = r + side, c + 1 - side
                if r2 >= rows or c2 >= columns or (film[r, c, 0] == 0 and film[r2, c2, 0] == 0):
                    continue
                k = 0.5 * (conductivity[r, c] + conductivity[r2, c2])
                for i in range(channels):
                    flow = k * (film[r, c, i] - film[r2, c2, i])
                    out[r, c, i] -= flow
                    out[r2, c2, i] += flow


LIGHTEST = 0.94  # masstones that pigments can reach
DARKEST = 0.012
FREEZE_STEP = 0.01  # change of dryness at which a cell's appearance is computed again

Array = NDArray[np.float64]


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
    """Share of the binder that has cleared; it starts late, when most of the water is gone."""
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
    """Update the sheet's appearance `seen` (float32[H,W,3] linear) where it has changed, in place.

    seen_liquid: float32[H,W], the liquid share for which `seen` holds, or 2 where it must be computed again.
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
