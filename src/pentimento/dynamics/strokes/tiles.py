"""Lists of the strokes whose ink may reach each tile of the canvas, for a renderer that works tile by tile.

The lists are made by array operations on the device of the paths, without loops over strokes, segments or tiles. Their
length grows with the number of tiles that ink can reach, not with strokes × tiles.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from pentimento.render.coverage import HALF_PX, LENGTH_EPSILON, R_MIN

TILE = 16
"""Pixels along a tile's side."""


class Touches(NamedTuple):
    """A *visit* is one stroke in one tile; a *touch* is one of its segments there.

    Tiles are numbered painting by painting and row by row; strokes painting by painting.
    """

    tile_start: Tensor  # int64[tiles + 1]: tile i's visits are tile_start[i]:tile_start[i + 1]
    visit_stroke: Tensor  # int64[V]: its stroke; ascending in a tile
    visit_start: Tensor  # int64[V + 1]: visit i's touches are visit_start[i]:visit_start[i + 1]
    segment: Tensor  # int32[T]: which segment of its stroke; ascending in a visit
    slot: Tensor  # int64[T]: the touch's place in the list of all touches sorted by stroke and segment
    per_segment: Tensor  # int64[strokes · segments]: how many touches each segment has in that list


def tile_grid(height: int, width: int) -> tuple[int, int]:
    """How many tiles cover a canvas, (rows, columns)."""
    return -(-height // TILE), -(-width // TILE)


def find_touches(path: Tensor, height: int, width: int) -> Touches:
    """List the segments of paths under the tiles that their ink can reach.

    Args:
        path: float[B, S, N, ≥ 3]: column, row, radius [px], and what else a path has; a path of one point is a disc.
        height, width: of the canvas [px].
    """
    batch, strokes, points, _ = path.shape
    segments = max(points - 1, 1)
    flat = path.detach()[..., :3].flatten(0, 1)
    u, v = flat[:, :segments].flatten(0, 1), flat[:, points - segments :].flatten(0, 1)  # [B·S·segments, 3]
    corner, across = _tiles_in_box(u, v, height, width)
    count = across.prod(1)
    owner = torch.arange(len(u), device=path.device).repeat_interleave(count)  # [T] the segment of each touch
    nth = torch.arange(len(owner), device=path.device) - (count.cumsum(0) - count)[owner]
    tile = corner[owner] + torch.stack([nth % across[owner, 0], nth // across[owner, 0]], dim=1)
    near = _is_near(u[owner], v[owner], tile).nonzero()[:, 0]
    owner, tile = owner[near], tile[near]

    rows, columns = tile_grid(height, width)
    stroke = owner // segments
    tile_number = (stroke // max(strokes, 1) * rows + tile[:, 1]) * columns + tile[:, 0]
    n_strokes = max(batch * strokes, 1)
    key, slot = torch.sort(tile_number * n_strokes + stroke, stable=True)  # stable: segments stay in their order
    visit, length = torch.unique_consecutive(key, return_counts=True)
    tile_keys = torch.arange(batch * rows * columns + 1, device=path.device) * n_strokes
    return Touches(
        tile_start=torch.searchsorted(visit, tile_keys),
        visit_stroke=visit % n_strokes,
        visit_start=torch.nn.functional.pad(length.cumsum(0), (1, 0)),
        segment=(owner % segments)[slot].int(),
        slot=slot,
        per_segment=torch.searchsorted(owner, torch.arange(len(u) + 1, device=path.device)).diff(),
    )


def _tiles_in_box(u: Tensor, v: Tensor, height: int, width: int) -> tuple[Tensor, Tensor]:
    """The first tile that the box of each segment u → v [T, 3] touches, and how many; both int64[T, 2], column first.

    Positions are clamped before they become integers: a point far away must not overflow them.
    """
    reach = _reach(u, v)[:, None]
    size = u.new_tensor([width, height])
    low = (torch.minimum(u[:, :2], v[:, :2]) - reach).clamp(min=-1).minimum(size)
    high = (torch.maximum(u[:, :2], v[:, :2]) + reach).clamp(min=-1).minimum(size - 1)
    first, last = low.ceil().long().clamp(min=0), high.floor().long()  # pixels
    return first // TILE, torch.where(first <= last, last // TILE - first // TILE + 1, 0)


def _is_near(u: Tensor, v: Tensor, tile: Tensor) -> Tensor:
    """Tell whether ink of segments u → v [T, 3] can reach tiles [T, 2]: a diagonal one misses most tiles of its box."""
    edge = v[:, :2] - u[:, :2]
    offset = tile * TILE + (TILE - 1) / 2 - u[:, :2]
    t = ((offset * edge).sum(1) / edge.square().sum(1).clamp(min=LENGTH_EPSILON)).clamp(0.0, 1.0)
    half_diagonal = (TILE - 1) / 2 * 2**0.5
    margin_px = 1.0  # [px] for rounding, in segments that come from far off the canvas
    return (offset - t[:, None] * edge).norm(dim=1) <= _reach(u, v) + half_diagonal + margin_px


def _reach(u: Tensor, v: Tensor) -> Tensor:
    """How far ink of segments u → v [T, 3] falls from them [px]."""
    return torch.maximum(u[:, 2], v[:, 2]).clamp(min=R_MIN) + HALF_PX
