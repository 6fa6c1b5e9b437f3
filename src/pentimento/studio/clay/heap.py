"""Rims: displaced material heaped up around a tool's contact, whose edge is told in sectors around its middle."""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]

SECTORS = 48
OPEN_M = 0.0008  # a groove this deep takes hardly any of what is displaced


@njit(cache=True, error_model="numpy")
def bearing(along: float, across: float) -> float:
    """Direction in sectors, 0..SECTORS; sector k is centred at k."""
    return (math.atan2(across, along) / (2 * math.pi) + 0.5) * SECTORS


@njit(cache=True, error_model="numpy")
def _edge_m(edge_m: Array, along: float, across: float) -> float:
    """The contact's edge [m] in a direction, between the centres of two sectors."""
    toward = bearing(along, across)
    k = int(toward)
    share = toward - k
    return (1.0 - share) * edge_m[k % SECTORS] + share * edge_m[(k + 1) % SECTORS]


@njit(cache=True, error_model="numpy")
def heap(
    height: Array,
    pre: Array,
    column: float,
    row: float,
    heading: Array,
    contact_m: Array,
    cell_m: float,
    rim_m: float,
    forward: float,
    amount_m: float,
) -> float:
    """Lay `amount_m` (metres times cells) around the contact; returns what found no place."""
    rows, columns = height.shape
    edge_m = np.empty(SECTORS)
    widest = 0.0
    for s in range(SECTORS):
        edge_m[s] = max(contact_m[s - 1], contact_m[s], contact_m[(s + 1) % SECTORS], 0.5 * cell_m)
        widest = max(widest, edge_m[s])
    reach = int((widest + 3.2 * rim_m) / cell_m) + 1
    first_row, first_column = int(row) - reach, int(column) - reach
    weight = np.zeros((2 * reach + 2, 2 * reach + 2))
    total = 0.0
    for i in range(weight.shape[0]):
        r = first_row + i
        if r < 0 or r >= rows:
            continue
        for j in range(weight.shape[1]):
            c = first_column + j
            if c < 0 or c >= columns:
                continue
            dx, dy = (c - column) * cell_m, (r - row) * cell_m
            along, across = dx * heading[0] + dy * heading[1], dy * heading[0] - dx * heading[1]
            distance = math.hypot(dx, dy)
            beyond = (distance - _edge_m(edge_m, along, across)) / rim_m
            if beyond <= 0.0 or beyond > 3.0:
                continue
            facing = along / max(distance, 1e-9)
            toward = (1.0 - forward) + forward * (0.5 + 0.5 * facing) ** 1.5
            # The groove behind the tool stays open.
            open_groove = math.exp(-max(pre[r, c] - height[r, c], 0.0) / OPEN_M)
            w = (beyond + 0.25) * math.exp(-(beyond**1.5)) * toward * open_groove
            weight[i, j] = w
            total += w
    if total <= 0.0:
        return amount_m
    for i in range(weight.shape[0]):
        for j in range(weight.shape[1]):
            if weight[i, j] > 0.0:
                height[first_row + i, first_column + j] += amount_m * weight[i, j] / total
    return 0.0
