"""Material slides where the slope exceeds an angle of repose.

With R_phi(h) the surface h after what is steeper than tan(phi) has run off downhill, volume kept,

    h' = h + sum_phi a_phi (R_phi(h) - h)     for three angles, from dry grains' to that of what holds together.

Between two of them the shares of both stand for the angle between: R_phi is nearly a straight line there. In all they
are about 1, for what is too steep does not stay.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from pentimento.dynamics.pushes.analytic_scene import PushScene
from pentimento.dynamics.pushes.mechanisms.mechanism import Array, Contact, Mechanism, Quantity, Settled

_ANGLES = (0.6, 1.1, 1.9)
"""tan of the angles of repose."""
_SWEEPS = 40
"""After these, what is left of the excess shows in no scan."""
_MIN = 0.5
"""What the shares add up to at least, for all that is too steep runs off: a base that is wrong about steep walls asks
for a part of it."""
_WALL = np.float32(1e6)
"""Metres: nothing is higher."""
_SHARE = np.float32(0.125)
"""Of the excess that moves at once to each of eight neighbours: no cell gives more than it has."""


class SlopeSlide(Mechanism):
    """See above."""

    cause = "slope_slide"
    site = "surface"
    driving_covariate = "slope"
    informative_covariates = ("slope_below",)
    quantities = (
        Quantity("slid_to_31_degrees", "1", 1.0),
        Quantity("slid_to_48_degrees", "1", 1.0),
        Quantity("slid_to_62_degrees", "1", 1.0),
    )

    @property
    def physical(self) -> bool:
        return float(self.values.sum()) >= _MIN

    def settled(self, settled: Settled, contact: Contact, scene: PushScene) -> Settled:
        height = scene.before + settled.lift_m + settled.rims_m - settled.indentation_m
        lift = settled.lift_m
        for share, angle in zip(self.values, _ANGLES, strict=True):
            if share:
                run_off = relaxed(height.astype(np.float32), np.float32(angle * scene.pixel_m), _SWEEPS)
                lift = lift + np.float32(share) * (run_off - height)
        return settled._replace(lift_m=lift)


# Sums in any order, and no care for NaN: only so does the compiler put many pixels into one instruction.
@njit(cache=True, error_model="numpy", nogil=True, fastmath={"reassoc", "nsz", "contract", "nnan"})
def relaxed(height: Array, step_m: float, sweeps: int) -> Array:
    """Heights float32[B, H, W] after what is steeper than ``step_m`` a pixel has run off; each sweep moves an eighth of
    the excess between neighbours, diagonal ones too. The border is a wall.
    """
    found = height.copy()
    rows, columns = height.shape[1:]
    gained = np.zeros((rows, columns), np.float32)
    by_column, moves = np.zeros(columns, np.float32), np.zeros(rows, np.bool_)
    straight, diagonal = np.float32(step_m), np.float32(step_m * np.sqrt(2.0))
    for b in range(len(found)):
        h = found[b]
        top, bottom, left, right = 0, rows, 0, columns  # where anything can move
        for _ in range(sweeps):
            by_column[:] = 0
            for r in range(top, bottom):
                above, upwards, up_aside = (r - 1, straight, diagonal) if r > 0 else (r, _WALL, _WALL)
                below, downwards, down_aside = (r + 1, straight, diagonal) if r < rows - 1 else (r, _WALL, _WALL)
                start, end = max(left, 1), max(min(right, columns - 1), max(left, 1))
                own0, own, own2 = h[r, start - 1 : end - 1], h[r, start:end], h[r, start + 1 : end + 1]
                up0, up, up2 = h[above, start - 1 : end - 1], h[above, start:end], h[above, start + 1 : end + 1]
                low0, low, low2 = h[below, start - 1 : end - 1], h[below, start:end], h[below, start + 1 : end + 1]
                gain, by = gained[r, start:end], by_column[start:end]
                for k in range(end - start):
                    here = own[k]
                    more = _excess(own0[k] - here, straight) + _excess(own2[k] - here, straight)
                    more += _excess(up[k] - here, upwards) + _excess(low[k] - here, downwards)
                    more += _excess(up0[k] - here, up_aside) + _excess(up2[k] - here, up_aside)
                    more += _excess(low0[k] - here, down_aside) + _excess(low2[k] - here, down_aside)
                    gain[k] = more * _SHARE
                most = np.float32(0)
                for k in range(end - start):
                    by[k] += abs(gain[k])
                    most += abs(gain[k])
                for c, inwards in ((0, 1), (columns - 1, -1)):  # beside the wall
                    if left <= c < right:
                        here, next_to = h[r, c], c + inwards
                        more = _excess(h[r, next_to] - here, straight)
                        more += _excess(h[above, c] - here, upwards) + _excess(h[below, c] - here, downwards)
                        more += _excess(h[above, next_to] - here, up_aside)
                        more += _excess(h[below, next_to] - here, down_aside)
                        gained[r, c] = more * _SHARE
                        by_column[c] += abs(gained[r, c])
                        most += abs(gained[r, c])
                moves[r] = most > 0
            moved = np.flatnonzero(moves[top:bottom]) + top
            if not len(moved):
                break
            h[top:bottom, left:right] += gained[top:bottom, left:right]
            top, bottom = max(moved[0] - 1, 0), min(moved[-1] + 2, rows)
            moved = np.flatnonzero(by_column)
            left, right = max(moved[0] - 1, 0), min(moved[-1] + 2, columns)
    return found


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def _excess(rise: float, limit: float) -> float:
    """By how much a difference of height is beyond its limit, with its sign."""
    return rise - min(max(rise, -limit), limit)
