"""Material slides where the slope exceeds an angle of repose.

With R_phi(h) the surface h after what is steeper than tan(phi) has run off downhill, volume kept,

    h' = h + sum_phi a_phi (R_phi(h) - h)     for two angles between which that of most granular materials lies.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from pentimento.push_dynamics.analytic_scene import PushScene
from pentimento.push_dynamics.mechanisms.mechanism import Array, Contact, Mechanism, Quantity, Settled

_ANGLES = (0.5, 0.8)
"""tan of the angles of repose, 27 and 39 degrees."""
_SWEEPS = 12


class SlopeSlide(Mechanism):
    """See above."""

    cause = "slope_slide"
    site = "surface"
    driver = "slope"
    quantities = (
        Quantity("slid_to_27_degrees", "1", 0.2),
        Quantity("slid_to_39_degrees", "1", 0.2),
    )

    def settled(self, settled: Settled, contact: Contact, scene: PushScene) -> Settled:
        height = scene.before + settled.lift_m + settled.rims_m - settled.indentation_m
        lift = settled.lift_m
        for share, angle in zip(self.values, _ANGLES, strict=True):
            if share:
                run_off = relaxed(height.astype(np.float32), np.float32(angle * scene.pixel_m), _SWEEPS)
                lift = lift + np.float32(share) * (run_off - height)
        return settled._replace(lift_m=lift)


@njit(cache=True, error_model="numpy", nogil=True)
def relaxed(height: Array, step_m: float, sweeps: int) -> Array:
    """Heights [B, H, W] after what is steeper than ``step_m`` a pixel has run off; each sweep moves an eighth of
    the excess between neighbours, diagonal ones too.
    """
    found = height.copy()
    moved = np.zeros(height.shape[1:], height.dtype)
    rows, columns = height.shape[1:]
    for b in range(len(found)):
        h = found[b]
        for _ in range(sweeps):
            moved[:] = 0.0
            for r in range(rows):
                for c in range(columns):
                    for down, right in ((0, 1), (1, 0), (1, 1), (1, -1)):
                        i, j = r + down, c + right
                        if i >= rows or j >= columns or j < 0:
                            continue
                        limit = step_m * np.sqrt(np.float32(down * down + right * right))
                        fall = h[r, c] - h[i, j]
                        if fall > limit:
                            flow = (fall - limit) * np.float32(0.125)
                        elif fall < -limit:
                            flow = (fall + limit) * np.float32(0.125)
                        else:
                            continue
                        moved[r, c] -= flow
                        moved[i, j] += flow
            h += moved
    return found
