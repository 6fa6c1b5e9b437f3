"""Material slides where the slope exceeds an angle of repose.

With R_phi(h) the surface h after everything steeper than tan(phi) has run off downhill, at constant volume,

    h' = h + sum_phi a_phi (R_phi(h) - h)     for three angles, from that of dry grains to that of cohesive material.

Between two of the angles, R_phi is nearly linear in the angle, so two shares represent an angle in between. The shares
sum to about 1, because material that is too steep does not stay.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from pentimento.planning.pushes.analytic.mechanisms.mechanism import Array, Contact, Mechanism, Quantity, Settled
from pentimento.planning.pushes.analytic.scene import PushScene

_ANGLES = (0.6, 1.1, 1.9)
"""Tangents of the angles of repose."""
_ITERATIONS = 40
"""After these, the remaining excess is below the resolution of a scan."""
_MIN_TOTAL = 0.5
"""Minimum sum of the shares. Material that is too steep runs off completely; a base with wrong steep walls asks for a
fraction."""
_WALL = np.float32(1e6)
"""Metres; larger than any height, so that nothing crosses the border."""
_SHARE = np.float32(0.125)
"""Of the excess that moves at once to each of eight neighbours: no cell gives more than it has."""


class SlopeSlide(Mechanism):
    """See above."""

    cause = "slope_slide"
    site = "surface"
    driving_covariate = "slope"
    hidden_from_network = False
    informative_covariates = ("slope_below",)
    quantities = (
        Quantity("slid_to_31_degrees", "1", 1.0),
        Quantity("slid_to_48_degrees", "1", 1.0),
        Quantity("slid_to_62_degrees", "1", 1.0),
    )

    @property
    def physical(self) -> bool:
        return float(self.values.sum()) >= _MIN_TOTAL

    def settled(self, settled: Settled, contact: Contact, scene: PushScene) -> Settled:
        height = scene.before + settled.lift_m + settled.rims_m - settled.indentation_m
        lift = settled.lift_m
        for share, angle in zip(self.values, _ANGLES, strict=True):
            if share:
                run_off = relaxed(height.astype(np.float32), np.float32(angle * scene.pixel_m), _ITERATIONS)
                lift = lift + np.float32(share) * (run_off - height)
        return settled._replace(lift_m=lift)


# The compiler vectorises the loop only if it may reorder sums and ignore NaN.
@njit(cache=True, error_model="numpy", nogil=True, fastmath={"reassoc", "nsz", "contract", "nnan"})
def relaxed(height: Array, step_m: float, sweeps: int) -> Array:
    """Heights float32[B, H, W] after material steeper than ``step_m`` a pixel has run off. Each iteration moves an
    eighth of the excess between neighbours, including diagonal ones. The border is a wall."""
    heights = height.copy()
    rows, columns = height.shape[1:]
    gained = np.zeros((rows, columns), np.float32)
    by_column, moves = np.zeros(columns, np.float32), np.zeros(rows, np.bool_)
    straight, diagonal = np.float32(step_m), np.float32(step_m * np.sqrt(2.0))
    for b in range(len(heights)):
        h = heights[b]
        top, bottom, left, right = 0, rows, 0, columns  # where anything can move
        for _ in range(sweeps):
            by_column[:] = 0
            for r in range(top, bottom):
                above, upwards, up_aside = (r - 1, straight, diagonal) if r > 0 else (r, _WALL, _WALL)
                below, downwards, down_aside = (r + 1, straight, diagonal) if r < rows - 1 else (r, _WALL, _WALL)
                start, end = max(left, 1), max(min(right, columns - 1), max(left, 1))
                mid0, mid, mid2 = h[r, start - 1 : end - 1], h[r, start:end], h[r, start + 1 : end + 1]
                up0, up, up2 = h[above, start - 1 : end - 1], h[above, start:end], h[above, start + 1 : end + 1]
                low0, low, low2 = h[below, start - 1 : end - 1], h[below, start:end], h[below, start + 1 : end + 1]
                gain, by = gained[r, start:end], by_column[start:end]
                for k in range(end - start):
                    here = mid[k]
                    more = _excess(mid0[k] - here, straight) + _excess(mid2[k] - here, straight)
                    more += _excess(up[k] - here, upwards) + _excess(low[k] - here, downwards)
                    more += _excess(up0[k] - here, up_aside) + _excess(up2[k] - here, up_aside)
                    more += _excess(low0[k] - here, down_aside) + _excess(low2[k] - here, down_aside)
                    gain[k] = more * _SHARE
                activity = np.float32(0)
                for k in range(end - start):
                    by[k] += abs(gain[k])
                    activity += abs(gain[k])
                for c, inwards in ((0, 1), (columns - 1, -1)):  # beside the wall
                    if left <= c < right:
                        here, next_to = h[r, c], c + inwards
                        more = _excess(h[r, next_to] - here, straight)
                        more += _excess(h[above, c] - here, upwards) + _excess(h[below, c] - here, downwards)
                        more += _excess(h[above, next_to] - here, up_aside)
                        more += _excess(h[below, next_to] - here, down_aside)
                        gained[r, c] = more * _SHARE
                        by_column[c] += abs(gained[r, c])
                        activity += abs(gained[r, c])
                moves[r] = activity > 0
            active = np.flatnonzero(moves[top:bottom]) + top
            if not len(active):
                break
            h[top:bottom, left:right] += gained[top:bottom, left:right]
            top, bottom = max(active[0] - 1, 0), min(active[-1] + 2, rows)
            active = np.flatnonzero(by_column)
            left, right = max(active[0] - 1, 0), min(active[-1] + 2, columns)
    return heights


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def _excess(rise: float, limit: float) -> float:
    """Part of a height difference beyond its limit, with its sign."""
    return rise - min(max(rise, -limit), limit)
