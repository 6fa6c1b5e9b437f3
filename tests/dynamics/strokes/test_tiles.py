"""The lists of strokes under tiles: nothing that inks is missed, and little else is listed."""

import pytest
import torch

from pentimento.dynamics.strokes.reference import render_reference
from pentimento.dynamics.strokes.tiles import TILE, Touches, find_touches, tile_grid
from pentimento.render import PixelStrokes

SHAPE = (53, 70)


def paths(strokes: int, points: int, seed: int, batch: int = 1) -> torch.Tensor:
    """Random paths [B, S, N, 3] (column, row, radius) on and around the canvas."""
    generator = torch.Generator().manual_seed(seed)
    start = torch.rand(batch, strokes, 1, 2, generator=generator) * 110 - 20
    steps = torch.randn(batch, strokes, points, 2, generator=generator) * 12
    radius = torch.rand(batch, strokes, points, 1, generator=generator) * 5
    return torch.cat([start + steps.cumsum(2), radius], dim=-1)


def listed(touches: Touches) -> list[tuple[int, int, int]]:
    """(tile, stroke, segment) of every touch, in the order in which a program meets them."""
    found = []
    for tile in range(len(touches.tile_start) - 1):
        for visit in range(int(touches.tile_start[tile]), int(touches.tile_start[tile + 1])):
            for touch in range(int(touches.visit_start[visit]), int(touches.visit_start[visit + 1])):
                found.append((tile, int(touches.visit_stroke[visit]), int(touches.segment[touch])))
    return found


@pytest.mark.parametrize("points", [1, 2, 5])
def test_every_inked_pixel_lies_in_a_tile_that_its_segment_touches(points: int) -> None:
    path = paths(12, points, seed=points)
    found = set(listed(find_touches(path, *SHAPE)))
    columns = tile_grid(*SHAPE)[1]
    inked = set()
    for stroke, line in enumerate(path[0]):
        for segment in range(max(points - 1, 1)):
            part = line[None, segment : segment + 2]
            one = torch.ones(part.shape[:2])
            alone = PixelStrokes(part[..., :2], part[..., 2], one, one, torch.ones(1, 3))
            painted = render_reference(alone, torch.zeros(*SHAPE, 3))
            ink = painted[..., 0].nonzero() // TILE
            inked |= {(int(r) * columns + int(c), stroke, segment) for r, c in ink}
    assert len({tile for tile, _, _ in inked}) > 5
    assert inked <= found


def test_touches_are_in_painting_order_and_each_is_listed_once() -> None:
    found = listed(find_touches(paths(9, 6, seed=4, batch=2), *SHAPE))
    assert found == sorted(set(found))


def test_strokes_of_a_painting_stay_in_it() -> None:
    rows, columns = tile_grid(*SHAPE)
    both = paths(7, 4, seed=6, batch=2)
    found = listed(find_touches(both, *SHAPE))
    second = [(tile - rows * columns, stroke - 7, k) for tile, stroke, k in found if stroke >= 7]
    assert second == listed(find_touches(both[1:], *SHAPE))


def test_slots_order_the_touches_by_stroke_and_segment() -> None:
    touches = find_touches(paths(9, 6, seed=8), *SHAPE)
    met = torch.tensor([stroke * 5 + k for _, stroke, k in listed(touches)])
    ordered = torch.empty_like(met)
    ordered[touches.slot] = met
    assert torch.equal(ordered, torch.arange(9 * 5).repeat_interleave(touches.per_segment))


def test_a_slanting_stroke_is_listed_under_the_tiles_along_it_not_under_its_box() -> None:
    path = torch.tensor([[[[0.0, 0.0, 2.0], [1023.0, 1023.0, 2.0]]]])
    visits = len(find_touches(path, 1024, 1024).visit_stroke)
    assert 64 <= visits <= 3 * 64  # its box has 64 x 64 tiles


def test_a_larger_canvas_around_the_same_strokes_costs_nothing() -> None:
    path = paths(10, 4, seed=9)
    path[..., :2] = path[..., :2].clamp(20, 44)
    assert len(find_touches(path, 64, 64).slot) == len(find_touches(path, 640, 640).slot)


@pytest.mark.parametrize("place", [-1e9, -50.0, 1e9, 3e38])
def test_what_lies_off_the_canvas_touches_nothing(place: float) -> None:
    touches = find_touches(torch.tensor([[[[place, 10.0, 3.0], [place, 30.0, 3.0]]]]), *SHAPE)
    assert len(touches.slot) == 0
    assert touches.per_segment.tolist() == [0]


def test_no_strokes_touch_nothing() -> None:
    touches = find_touches(torch.zeros(2, 0, 3, 3), *SHAPE)
    assert touches.tile_start.tolist() == [0] * (2 * 4 * 5 + 1)
    assert len(touches.slot) == len(touches.visit_stroke) == len(touches.per_segment) == 0
