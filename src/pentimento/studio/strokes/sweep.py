"""The bundle swept over the sheet: bristles lay paint down, level it, and pick up wet paint."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
Field = NDArray[np.float32]

TOUCH_M = 0.00025  # press over which a bristle comes to bear fully
LEVELLING = 0.30  # share of the way to its film that a cell goes at one full touch
LIFTING = 0.18  # the same where a cell has more paint than the bristle would leave, which makes streaks
LEVEL = 0.01  # difference of thickness that does not make paint flow
THIRST = 0.6  # load at which a bristle lays down half of what it could
HELD = 4.0  # volume at a bristle's end: about a nominal film over the area that it covers
FEED = 0.012  # share of a bristle's deficit that the belly refills in one step


@njit(cache=True, error_model="numpy")
def sweep(
    film: Field,
    wet: Field,
    liquid: Field,
    grain: Field,
    roughness: float,
    centre: Array,
    press_m: Array,
    frame: Array,
    outer: Array,
    thickness: Array,
    place: Array,
    short_m: Array,
    wetting: Array,
    colour: Array,
    load: Array,
    filled: Array,
    belly: Array,
    bristle_cells: Array,
    belly_cells: float,
    radius: float,
    pickup: float,
    swell: float,
) -> None:
    """Move the bundle along its drag and transfer paint, in place. Lengths are cells of the window's grid.

    film: float32[h,w,7] this stroke's paint: volume (nominal thickness times cells), K[3], S[3]; wet:
    float32[h,w,7] the layer on the sheet, liquid: float32[h,w] its liquid share, grain: float32[h,w];
    centre: float64[M,2] (column, row); frame: float64[M,2,2], outer: float64[M,2] as in `brush.Drag` but in
    (column, row); thickness: float64[M]; place, short_m, wetting: the bundle; colour: float64[B,6] K and S
    of what each bristle holds; load: float64[B] and belly: float64[1] shares of full, whose volumes are
    `bristle_cells` (float64[B]) and `belly_cells`; filled: float64[B] the load after the dip; pickup: share of
    the wet layer that one touch exchanges; swell: relative narrowing when emptied.
    """
    rows, columns = grain.shape
    before_x, before_y = np.empty(load.size), np.empty(load.size)
    for k in range(press_m.size):
        # Paint between the bristles keeps them apart; when it is gone, they draw together.
        swollen = 1 - swell * (1 - belly[0] ** 0.8)
        for b in range(load.size):
            u, v = place[b, 0], place[b, 1]
            dx = swollen * (frame[k, 0, 0] * u + frame[k, 0, 1] * v)
            dy = swollen * (frame[k, 1, 0] * u + frame[k, 1, 1] * v)
            swing = max(dx * outer[k, 0] + dy * outer[k, 1], 0.0)
            norm = outer[k, 0] ** 2 + outer[k, 1] ** 2
            if norm > 0:
                dx += outer[k, 0] * swing / np.sqrt(norm)
                dy += outer[k, 1] * swing / np.sqrt(norm)
            x, y = centre[k, 0] + dx, centre[k, 1] + dy
            way = 0.0 if k == 0 else np.hypot(x - before_x[b], y - before_y[b])
            before_x[b], before_y[b] = x, y
            touch = (press_m[k] - short_m[b]) / TOUCH_M
            if touch <= 0:
                continue
            touch = min(touch, 1.0)
            # A bristle that rolls on the spot still wets the sheet a little.
            rate = 1 - (1 - LEVELLING) ** (0.25 + min(way, 2.5))
            need = filled[b] - load[b]  # what has been laid down flows after
            if need > 0 and belly[0] > 0:
                flow = need * FEED * min(way, 2.5) * belly[0] ** 0.7
                flow = min(flow, belly[0] * belly_cells / bristle_cells[b])
                belly[0] = max(belly[0] - flow * bristle_cells[b] / belly_cells, 0.0)
                load[b] += flow
            supply = load[b] * (1 + THIRST) / (load[b] + THIRST)
            target = thickness[k] * wetting[b] * supply * (0.5 + 0.5 * touch)
            # Sliding works the paint into the valleys that a mere dab bridges.
            depth = 0.4 * touch + 0.8 * supply + 0.4 * way / (way + 0.5) - 0.1
            r, c = int(np.floor(y + 0.5)), int(np.floor(x + 0.5))
            if pickup > 0 and 0 <= r < rows and 0 <= c < columns and wet[r, c, 0] > 0.02:
                _pick_up(wet, liquid[r, c], colour, b, r, c, pickup * rate)
            _touch_sheet(film, grain, roughness, x, y, radius, rate, target, depth, colour, load, bristle_cells[b], b)


@njit(cache=True, error_model="numpy")
def _touch_sheet(
    film: Field,
    grain: Field,
    roughness: float,
    x: float,
    y: float,
    radius: float,
    rate: float,
    target: float,
    depth: float,
    colour: Array,
    load: Array,
    capacity: float,
    b: int,
) -> None:
    """One bristle's touch: the cells that it covers come nearer to the film that it would leave."""
    rows, columns = grain.shape
    far = radius + 0.5
    for r in range(max(int(np.ceil(y - far)), 0), min(int(np.floor(y + far)) + 1, rows)):
        for c in range(max(int(np.ceil(x - far)), 0), min(int(np.floor(x + far)) + 1, columns)):
            distance2 = (c - x) ** 2 + (r - y) ** 2
            if distance2 >= far * far:
                continue
            weight = min(far - np.sqrt(distance2), 1.0) * rate
            # Valleys of the paper are reached only by a well loaded or well pressed bristle.
            caught = (depth - (1 - grain[r, c]) * (0.6 + roughness)) / 0.15
            if caught <= 0:
                continue
            wanted = target * min(caught, 1.0)
            has = film[r, c, 0]
            if abs(wanted - has) < LEVEL:
                continue
            if wanted > has:
                gain = (wanted - has) * weight
                gain = min(gain, load[b] * capacity)
                load[b] -= gain / capacity
                film[r, c, 0] += gain
                for i in range(6):
                    film[r, c, 1 + i] += gain * colour[b, i]
            elif has > 0:
                loss = (has - wanted) * weight * LIFTING / LEVELLING
                loss = min(loss, (1 - load[b]) * capacity)
                if loss > 0:
                    load[b] += loss / capacity
                    kept = 1 - loss / has
                    for i in range(7):
                        film[r, c, i] *= kept


@njit(cache=True, error_model="numpy")
def _pick_up(wet: Field, liquid: float, colour: Array, b: int, r: int, c: int, pickup: float) -> None:
    """Exchange paint between the bristle and the wet layer, volume for volume."""
    share = pickup * liquid
    moved = share * wet[r, c, 0]
    dilution = moved / (moved + HELD)
    for i in range(6):
        taken = wet[r, c, 1 + i] / wet[r, c, 0]
        wet[r, c, 1 + i] += moved * (colour[b, i] - taken)
        colour[b, i] += dilution * (taken - colour[b, i])
