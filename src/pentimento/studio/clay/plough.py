"""A tool ploughing through the height field, in small steps along the tip's line.

At each step the slab's reaction lifts the arm. Material above the tool's underside is removed. Of its volume a part is
lost (crushed pores), a part is set aside for the far field, and the rest is heaped up around the contact in angular
sectors, more ahead of the tool than behind it.

Grids are float64[H,W] with row 0 at the top; places are (column, row) in cells, heights metres.
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]

SECTORS = 48  # of the contact's edge, 7.5 degrees each
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
    """Lay `amount_m` (metres times cells) around the contact; returns the part for which no cell was free."""
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


HALVINGS = 11  # of the bisection: 20 mm to 10 µm
TOUCH_M = 5e-5  # gap that still sticks
ROUND_TO = 0.97  # share of the rounding's radius beyond which the sides are straight


@njit(cache=True, error_model="numpy")
def underside_m(along_m: float, across_m: float, shape: Array) -> float:
    """Height of the tool's underside above its lowest point; `shape` is half length, half width, rounding, shank."""
    rounding = shape[2]
    out = math.hypot(max(abs(along_m) - (shape[0] - rounding), 0.0), max(abs(across_m) - (shape[1] - rounding), 0.0))
    edge = ROUND_TO * rounding
    if out <= edge:
        return rounding - math.sqrt(rounding * rounding - out * out)
    return rounding - math.sqrt(rounding * rounding - edge * edge) + shape[3] * (out - edge)


@njit(cache=True, error_model="numpy")
def plough(
    height: Array,
    pre: Array,
    hardness: Array,
    strain: Array,
    line: Array,
    heading: Array,
    shape: Array,
    cell_m: float,
    give_m_per_n: float,
    firming_m: float,
    rim_m: float,
    bow_wave: float,
    crush: float,
    crushing_strain: float,
    far_share: float,
    resting_hardness: float,
    resting_steps: int,
    volume: Array,
) -> Array:
    """Move the tool along its line, in place; returns the tip's true heights float64[M].

    height: the surface, changed; pre: the surface before the push; hardness: pressure [Pa] that a cell can
    bear; strain: plastic strain so far, grown by this push; line: float64[M,3] column, row, z_m; heading:
    float64[2] of travel in (column, row); shape: float64[5] half length, half width, rounding, shank
    [m, m, m, 1], give [m/Pa]; crush: share of the volume that fresh material swallows; resting_hardness:
    factor on the hardness in the last `resting_steps`; volume: float64[2] [m³] crushed and set aside, grown.
    """
    tips = np.empty(len(line))
    for k in range(len(line)):
        softness = resting_hardness if k >= len(line) - resting_steps else 1.0
        column, row, z_m = line[k]
        tips[k] = z_m + _arm_lift_m(
            height, pre, hardness, column, row, z_m, heading, shape, cell_m, give_m_per_n, firming_m, softness
        )
        way = 0.0 if k == 0 else math.hypot(column - line[k - 1, 0], row - line[k - 1, 1]) * cell_m
        sunk = 0.0 if k == 0 else max(line[k - 1, 2] - z_m, 0.0)
        forward = bow_wave * way / (way + 0.5 * sunk + 1e-9)
        _press(
            height, pre, hardness, strain, column, row, tips[k], heading, shape, cell_m, firming_m, rim_m, forward,
            crush, crushing_strain, far_share, softness, volume,
        )  # fmt: skip
    return tips


@njit(cache=True, error_model="numpy")
def touched(height: Array, tip: Array, heading: Array, shape: Array, cell_m: float) -> NDArray[np.bool_]:
    """bool[H,W]: where the tool rests on the surface; tip: float64[3] column, row, z_m, the others as in `plough`."""
    rows, columns = height.shape
    touching = np.zeros((rows, columns), np.bool_)
    reach = (max(shape[0], shape[1]) + 0.001) / cell_m
    for r in range(max(int(tip[1] - reach), 0), min(int(tip[1] + reach) + 2, rows)):
        for c in range(max(int(tip[0] - reach), 0), min(int(tip[0] + reach) + 2, columns)):
            dx, dy = (c - tip[0]) * cell_m, (r - tip[1]) * cell_m
            under = underside_m(dx * heading[0] + dy * heading[1], dy * heading[0] - dx * heading[1], shape)
            touching[r, c] = height[r, c] >= tip[2] + under - TOUCH_M
    return touching


@njit(cache=True, error_model="numpy")
def _pad_m(depth_m: float, hardness: float, firming_m: float, give_m_per_pa: float) -> float:
    """Compression of a soft tool's surface where the material reaches `depth_m` above it."""
    if give_m_per_pa == 0.0 or depth_m <= 0.0:
        return 0.0
    first = give_m_per_pa * hardness * (1.0 - math.exp(-depth_m / firming_m))
    second = give_m_per_pa * hardness * (1.0 - math.exp(-max(depth_m - first, 0.0) / firming_m))
    return min(0.5 * (first + second), depth_m)


@njit(cache=True, error_model="numpy")
def _arm_lift_m(
    height: Array,
    pre: Array,
    hardness: Array,
    column: float,
    row: float,
    z_m: float,
    heading: Array,
    shape: Array,
    cell_m: float,
    give_m_per_n: float,
    firming_m: float,
    softness: float,
) -> float:
    """Elastic lift of arm and slab at the balance of their springs with the material's reaction (bisection)."""
    if give_m_per_n == 0.0:
        return 0.0
    low, high = 0.0, 0.02
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        force = _force_n(height, pre, hardness, column, row, z_m + middle, heading, shape, cell_m, firming_m)
        if middle < give_m_per_n * softness * force:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


@njit(cache=True, error_model="numpy")
def _force_n(
    height: Array,
    pre: Array,
    hardness: Array,
    column: float,
    row: float,
    z_m: float,
    heading: Array,
    shape: Array,
    cell_m: float,
    firming_m: float,
) -> float:
    rows, columns = height.shape
    reach = (max(shape[0], shape[1]) + 0.003) / cell_m
    force = 0.0
    for r in range(max(int(row - reach), 0), min(int(row + reach) + 2, rows)):
        for c in range(max(int(column - reach), 0), min(int(column + reach) + 2, columns)):
            dx, dy = (c - column) * cell_m, (r - row) * cell_m
            under = z_m + underside_m(dx * heading[0] + dy * heading[1], dy * heading[0] - dx * heading[1], shape)
            # Material that has just been pressed flat still bears the tool.
            if height[r, c] > under - 1e-6:
                depth = max(height[r, c], pre[r, c]) - under
                force += hardness[r, c] * (1.0 - math.exp(-max(depth, 0.0) / firming_m))
    return force * cell_m * cell_m


@njit(cache=True, error_model="numpy")
def _press(
    height: Array,
    pre: Array,
    hardness: Array,
    strain: Array,
    column: float,
    row: float,
    z_m: float,
    heading: Array,
    shape: Array,
    cell_m: float,
    firming_m: float,
    rim_m: float,
    forward: float,
    crush: float,
    crushing_strain: float,
    far_share: float,
    softness: float,
    volume: Array,
) -> None:
    """Remove the material above the tool's underside and heap up the kept part of it around the contact."""
    rows, columns = height.shape
    reach = (max(shape[0], shape[1]) + 0.003) / cell_m
    contact_m = np.zeros(SECTORS)
    moved, lost = 0.0, 0.0
    for r in range(max(int(row - reach), 0), min(int(row + reach) + 2, rows)):
        for c in range(max(int(column - reach), 0), min(int(column + reach) + 2, columns)):
            dx, dy = (c - column) * cell_m, (r - row) * cell_m
            along, across = dx * heading[0] + dy * heading[1], dy * heading[0] - dx * heading[1]
            shape_m = underside_m(along, across, shape)
            under = z_m + shape_m
            depth = max(height[r, c], pre[r, c]) - under
            # A soft tool is thickest, and so softest, at its tip.
            give = shape[4] * max(1.0 - shape_m / shape[2], 0.0)
            under += _pad_m(depth, hardness[r, c] * softness, firming_m, give)
            over = height[r, c] - under
            if over <= -1e-6:
                continue
            sector = int(bearing(along, across) + 0.5) % SECTORS
            contact_m[sector] = max(contact_m[sector], math.hypot(dx, dy))
            if over <= 0.0:
                continue
            height[r, c] = under
            # Pores that are closed already take no volume.
            lost += over * crush / (1.0 + strain[r, c] / crushing_strain)
            strain[r, c] += over / max(pre[r, c], 0.005)
            moved += over
    if moved == 0.0:
        return
    kept = moved - lost
    far = kept * far_share
    left = heap(height, pre, column, row, heading, contact_m, cell_m, rim_m, forward, kept - far)
    volume[0] += lost * cell_m * cell_m
    volume[1] += (far + left) * cell_m * cell_m
