"""What a tool heaps up around itself: how much, where, and where not."""

from __future__ import annotations

import numpy as np

from pentimento.dynamics.pushes.contact import Sweep
from pentimento.dynamics.pushes.heaping import heaped

PIXEL_M, SIDE = 0.0016, 64
HALF_WIDTH_M, RADIUS_M = 0.008, 0.006


def places(heading: float, start_px: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    rows, columns = np.indices((SIDE, SIDE))
    x, y = (columns - start_px[0]) * PIXEL_M, (start_px[1] - rows) * PIXEL_M
    cos, sin = np.cos(heading), np.sin(heading)
    along, across = cos * x + sin * y, cos * y - sin * x
    return along[None].astype(np.float32), across[None].astype(np.float32)


def laid(
    before: np.ndarray,
    length_m: float = 0.02,
    depth_m: float = 0.006,
    heading: float = 0.0,
    start_px: tuple[float, float] = (26.0, 31.5),
    facing: float = 0.5,
    stand_off: float = 1.0,
) -> tuple[np.ndarray, np.ndarray]:
    """What one push of a ball lays, and what its envelope takes off, [H, W] metres."""
    along, across = places(heading, start_px)
    moved = np.array([[0.0, 0.0, depth_m / max(length_m, 1e-4), length_m, 0.0, HALF_WIDTH_M]])
    deep = depth_m * (np.linspace(0, 1, 9) if length_m else np.ones(9))[None]
    knots = np.stack([np.array([0.15, 1.6]) * HALF_WIDTH_M, np.zeros(2)])
    fixed = np.array([RADIUS_M, 1.0, 0.0, 0.0002, HALF_WIDTH_M])
    found = heaped(Sweep(before, along, across, moved, deep, knots, fixed), 3.0, facing, stand_off)[0]
    stations = np.linspace(0, length_m, 200)
    ramp = stations / length_m if length_m else np.ones(200)
    away = (along[0][..., None] - stations) ** 2 + across[0][..., None] ** 2
    envelope = (away / (2 * RADIUS_M) - depth_m * ramp).min(-1)
    return found, np.maximum(before[0] - envelope, 0)


def flat() -> np.ndarray:
    return np.zeros((1, SIDE, SIDE), dtype=np.float32)


def test_all_that_is_taken_off_is_laid_down_again() -> None:
    for length_m in (0.0, 0.006, 0.03):
        found, taken = laid(flat(), length_m)
        # A travelling tool takes it off step by step: between two steps a little stays.
        assert abs(found.sum() - taken.sum()) < 0.04 * taken.sum(), length_m
        assert found.min() >= 0


def test_nothing_rises_where_the_tool_has_passed() -> None:
    found, taken = laid(flat())
    assert found[taken > 0.001].sum() < 0.03 * found.sum()


def test_a_push_straight_down_raises_an_even_ring_whatever_faces_what() -> None:
    found, _ = laid(flat(), 0.0, start_px=(31.5, 31.5), facing=1.0)
    assert np.abs(found - np.rot90(found)).max() < 1e-6
    assert np.abs(found - found[::-1]).max() < 1e-6


def test_a_turned_push_lays_what_is_turned() -> None:
    found, _ = laid(flat(), start_px=(31.5, 31.5))
    turned, _ = laid(flat(), heading=np.pi / 2, start_px=(31.5, 31.5))
    assert np.abs(np.rot90(found) - turned).max() < 1e-5


def test_a_heap_grows_ahead_of_a_travelling_tool() -> None:
    found, _ = laid(flat(), 0.03)
    along, across = (maps[0] for maps in places(0.0, (26.0, 31.5)))
    # The groove is deepest at its end: compare what lies ahead with what lies behind the start and beside the way.
    ahead, behind = found[along > 0.03].sum(), found[along < 0.0].sum()
    assert ahead > 3 * behind
    more, _ = laid(flat(), 0.03, facing=1.0)
    assert more[along > 0.03].sum() > 1.1 * ahead
    assert more[(along > 0) & (along < 0.03) & (abs(across) > 0.004)].sum() > 0


def test_material_that_stands_off_lies_less_at_the_edge_and_further_out() -> None:
    near, far = (laid(flat(), 0.0, start_px=(31.5, 31.5), stand_off=s)[0] for s in (0.0, 2.0))
    rows, columns = np.indices((SIDE, SIDE))
    away = np.hypot(rows - 31.5, columns - 31.5)
    assert (far * away).sum() / far.sum() > 1.02 * (near * away).sum() / near.sum()


def test_an_old_hole_behind_a_travelling_tool_takes_less_than_one_at_its_side() -> None:
    """Nothing pushes material back."""
    along, across = (maps[0] for maps in places(0.0, (26.0, 31.5)))
    behind = np.hypot(along + 0.008, across) < 0.005
    beside = np.hypot(along - 0.02, across - 0.012) < 0.005
    before = flat()
    before[0, behind | beside] = -0.003
    found, _ = laid(before, 0.02)
    assert found[beside].sum() > 3 * found[behind].sum()
