"""What the machine could do at best, and how much there is to do: no culling, no branches, nothing to look up.

The loops here go over pixel-segment pairs that lie side by side in memory, in blocks that stay in the processor's
cache, by the formula of ``pentimento.render.kernel`` and with its log2 and exp2. They share nothing else with it.
"""

import re
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pentimento.render.coverage import HALF_PX, R_MIN, RIM_PX
from pentimento.render.fastmath import exp2, log2

Array = NDArray[Any]
BLOCK = 256
"""Pairs in a block. Number k of the block's pair i stands at k · BLOCK + i: the compiler sees that nothing overlaps."""
READ = (
    "gx", "gy", "ex", "ey", "inverse", "r_u", "r_step", "rho_u", "rho_step", "c_u", "c_step",
    "red", "green", "blue", "below_red", "below_green", "below_blue", "g_red", "g_green", "g_blue",
)  # fmt: skip
"""Of a pair: G − u, v − u, 1/|v − u|²; radius, density, softness, start and step each; colour, below, gradient."""
WRITTEN = (
    "coverage", "image_red", "image_green", "image_blue", "g_ux", "g_uy", "g_vx", "g_vy", "g_r_u", "g_r_v",
    "g_rho_u", "g_rho_v", "g_c_u", "g_c_v", "g_color_red", "g_color_green", "g_color_blue",
    "g_below_red", "g_below_green", "g_below_blue",
)  # fmt: skip
"""And what is worked out: coverage and image, then the gradients of everything."""
FIELDS = len(READ) + len(WRITTEN)
_LINE = 16
"""float32 in a cache line."""
_LN2 = float(np.log(2))
_PACKED = re.compile(r"^\s*v?(?:mul|add|sub|fn?m(?:add|sub)\d*|sqrt|div|max|min)ps\b.*$", re.MULTILINE)
_compiled = njit(fastmath=True, error_model="numpy", boundscheck=False)


@_compiled
def touched_pairs(points: Array, radius: Array, height: int, width: int) -> int:
    """Pixel-segment pairs with ink (D < R + ½) of strokes [S, N, 2] and [S, N], each segment tried at each pixel."""
    zero, one, floor = radius.dtype.type(0), radius.dtype.type(1), radius.dtype.type(R_MIN)
    tiny, half = radius.dtype.type(1e-12), radius.dtype.type(HALF_PX)
    columns = np.arange(width).astype(radius.dtype)
    touched = 0
    for s in range(points.shape[0]):
        for k in range(max(points.shape[1] - 1, 1)):
            j = min(k + 1, points.shape[1] - 1)
            ux, uy = points[s, k, 0], points[s, k, 1]
            ex, ey = points[s, j, 0] - ux, points[s, j, 1] - uy
            inverse = one / max(ex * ex + ey * ey, tiny)
            r_u, r_step = radius[s, k], radius[s, j] - radius[s, k]
            for row in range(height):
                gy = radius.dtype.type(row) - uy
                in_row = np.int32(0)
                for column in range(width):
                    gx = columns[column] - ux
                    t = min(max((gx * ex + gy * ey) * inverse, zero), one)
                    wx, wy = gx - t * ex, gy - t * ey
                    reach = max(r_u + t * r_step, floor) + half
                    in_row += np.int32(1) if wx * wx + wy * wy < reach * reach else np.int32(0)
                touched += in_row
    return touched


@_compiled
def forward_pairs(blocks: Array, passes: int) -> None:
    """Coverage of all pairs in ``blocks`` float32[B, FIELDS · BLOCK], again and again."""
    zero, one, floor = blocks.dtype.type(0), blocks.dtype.type(1), blocks.dtype.type(R_MIN)
    half, rim = blocks.dtype.type(HALF_PX), blocks.dtype.type(RIM_PX)
    for _ in range(passes):
        for b in range(blocks.shape[0]):
            x = blocks[b]
            for i in range(BLOCK):
                gx, gy, ex, ey = x[i], x[BLOCK + i], x[2 * BLOCK + i], x[3 * BLOCK + i]
                t = min(max((gx * ex + gy * ey) * x[4 * BLOCK + i], zero), one)
                wx, wy = gx - t * ex, gy - t * ey
                d, r = np.sqrt(wx * wx + wy * wy), max(x[5 * BLOCK + i] + t * x[6 * BLOCK + i], floor)
                q, edge = min(max(r - d, rim) / r, one), max(min(r, d + half) + min(r, half - d), zero)
                rho, soft = x[7 * BLOCK + i] + t * x[8 * BLOCK + i], x[9 * BLOCK + i] + t * x[10 * BLOCK + i]
                x[20 * BLOCK + i] = rho * exp2(soft * log2(q)) * edge


@_compiled
def forward_backward_pairs(blocks: Array, passes: int) -> None:
    """Coverage, composition and all gradients of all pairs in ``blocks``, as above."""
    zero, one, ln2 = blocks.dtype.type(0), blocks.dtype.type(1), blocks.dtype.type(_LN2)
    floor, half, rim = blocks.dtype.type(R_MIN), blocks.dtype.type(HALF_PX), blocks.dtype.type(RIM_PX)
    for _ in range(passes):
        for b in range(blocks.shape[0]):
            x = blocks[b]
            for i in range(BLOCK):
                gx, gy, ex, ey = x[i], x[BLOCK + i], x[2 * BLOCK + i], x[3 * BLOCK + i]
                inverse, r_step, rho_step = x[4 * BLOCK + i], x[6 * BLOCK + i], x[8 * BLOCK + i]
                c_step = x[10 * BLOCK + i]
                t_free = (gx * ex + gy * ey) * inverse
                t = min(max(t_free, zero), one)
                wx, wy = gx - t * ex, gy - t * ey
                d = np.sqrt(wx * wx + wy * wy)
                r_free = x[5 * BLOCK + i] + t * r_step
                r = max(r_free, floor)
                within = r - d
                profile = max(within, rim)
                q = min(profile / r, one)
                edge_free = min(r, d + half) + min(r, half - d)
                edge = max(edge_free, zero)
                rho, soft, log_q = x[7 * BLOCK + i] + t * rho_step, x[9 * BLOCK + i] + t * c_step, log2(q)
                power = exp2(soft * log_q)
                a = rho * power * edge
                over_r, over_g = x[11 * BLOCK + i] - x[14 * BLOCK + i], x[12 * BLOCK + i] - x[15 * BLOCK + i]
                over_b, g_r, g_g, g_b = (
                    x[13 * BLOCK + i] - x[16 * BLOCK + i], x[17 * BLOCK + i], x[18 * BLOCK + i], x[19 * BLOCK + i],
                )  # fmt: skip
                g_a = g_r * over_r + g_g * over_g + g_b * over_b
                g_rho, g_soft = g_a * power * edge, g_a * a * log_q * ln2
                g_profile = g_a * soft * a / profile if q < one else zero
                g_edge = g_a * rho * power if edge_free > zero else zero
                sloped = one if within > rim else zero
                outer, inner = one if r <= d + half else zero, one if r <= half - d else zero
                g_radius = g_profile * (sloped - q) + g_edge * (inner + outer)
                g_radius = g_radius if r_free > floor else zero
                pull = (g_profile * sloped - g_edge * (inner - outer)) / d if d > zero else zero
                g_t = (g_radius * r_step + g_rho * rho_step + g_soft * c_step) * inverse
                g_t = g_t if (t_free > zero) & (t_free < one) else zero
                x[20 * BLOCK + i] = a
                x[21 * BLOCK + i] = x[14 * BLOCK + i] + a * over_r
                x[22 * BLOCK + i] = x[15 * BLOCK + i] + a * over_g
                x[23 * BLOCK + i] = x[16 * BLOCK + i] + a * over_b
                g_vx, g_vy = t * pull * wx + g_t * (gx - (t + t) * ex), t * pull * wy + g_t * (gy - (t + t) * ey)
                x[24 * BLOCK + i] = pull * wx - g_t * ex - g_vx
                x[25 * BLOCK + i] = pull * wy - g_t * ey - g_vy
                x[26 * BLOCK + i] = g_vx
                x[27 * BLOCK + i] = g_vy
                x[28 * BLOCK + i] = g_radius - t * g_radius
                x[29 * BLOCK + i] = t * g_radius
                x[30 * BLOCK + i] = g_rho - t * g_rho
                x[31 * BLOCK + i] = t * g_rho
                x[32 * BLOCK + i] = g_soft - t * g_soft
                x[33 * BLOCK + i] = t * g_soft
                x[34 * BLOCK + i] = a * g_r
                x[35 * BLOCK + i] = a * g_g
                x[36 * BLOCK + i] = a * g_b
                x[37 * BLOCK + i] = g_r - a * g_r
                x[38 * BLOCK + i] = g_g - a * g_g
                x[39 * BLOCK + i] = g_b - a * g_b


def random_pairs(blocks: int, seed: int) -> Array:
    """float32[B, FIELDS · BLOCK]: pairs near segments of 1 to 20 px, most of them with ink; results not yet filled."""
    rng = np.random.default_rng(seed)
    x = _aligned(blocks * FIELDS * BLOCK).reshape(blocks, FIELDS, BLOCK)
    n = (blocks, BLOCK)
    length, heading = rng.uniform(1, 20, n), rng.uniform(-np.pi, np.pi, n)
    x[:, 2], x[:, 3] = length * np.cos(heading), length * np.sin(heading)
    share, apart = rng.uniform(-0.2, 1.2, n), rng.uniform(-4, 4, n)
    x[:, 0] = share * x[:, 2] - apart * np.sin(heading)
    x[:, 1] = share * x[:, 3] + apart * np.cos(heading)
    x[:, 4] = 1 / np.maximum(x[:, 2] ** 2 + x[:, 3] ** 2, 1e-12)
    for start, low, high in ((5, 1.5, 5.0), (7, 0.5, 1.0), (9, 0.2, 1.0)):
        x[:, start], x[:, start + 1] = rng.uniform(low, high, n), rng.uniform(-0.1, 0.1, n)
    x[:, 11:17], x[:, 17:20] = rng.uniform(0, 1, (blocks, 6, BLOCK)), rng.normal(size=(blocks, 3, BLOCK))
    return x.reshape(blocks, FIELDS * BLOCK)


def _aligned(size: int) -> Array:
    """float32[size] that starts with a cache line: vectors across two lines cost a third more."""
    room = np.zeros(size + _LINE, np.float32)
    start = -(room.ctypes.data // room.itemsize) % _LINE
    return room[start : start + size]


def packed_instructions(function: Any) -> int:
    """How many instructions of a compiled loop work on several float32 at once (x86)."""
    return sum(len(_PACKED.findall(assembly)) for assembly in function.inspect_asm().values())
