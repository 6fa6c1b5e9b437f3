"""Displaced material: its volume, place and symmetries."""

from __future__ import annotations

import numpy as np
import pytest

from pentimento.planning.pushes.analytic.contact import Sweep
from pentimento.planning.pushes.analytic.heaping import heaped

PIXEL_M, SIDE = 0.0016, 64
HALF_WIDTH_M, RADIUS_M = 0.008, 0.006


def places(heading: float, start_px: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    rows, columns = np.indices((SIDE, SIDE))
    x, y = (columns - start_px[0]) * PIXEL_M, (start_px[1] - rows) * PIXEL_M
    cos, sin = np.cos(heading), np.sin(heading)
    along, across = cos * x + sin * y, cos * y - sin * x
    return along[None].astype(np.float32), across[None].astype(np.float32)


def deposit(
    before: np.ndarray,
    length_m: float = 0.02,
    depth_m: float = 0.006,
    heading: float = 0.0,
    start_px: tuple[float, float] = (26.0, 31.5),
    facing: float = 0.5,
    stand_off: float = 1.0,
    flanking: float = 0.0,
    refill: float = 0.0,
) -> tuple[np.ndarray, np.ndarray]:
    """Deposit of one push of a ball, and the material that its envelope removes, [H, W] metres."""
    along, across = places(heading, start_px)
    motion = np.array([[0.0, 0.0, depth_m / max(length_m, 1e-4), length_m, 0.0, HALF_WIDTH_M]])
    tip_depth = depth_m * (np.linspace(0, 1, 9) if length_m else np.ones(9))[None]
    knots = np.stack([np.array([0.15, 1.6]) * HALF_WIDTH_M, np.zeros(2)])
    fixed = np.array([RADIUS_M, 1.0, 0.0, 0.0002, HALF_WIDTH_M])
    sweep = Sweep(before, along, across, motion, tip_depth, knots, fixed)
    shape = {"facing": facing, "flanking": flanking, "log_steep": 0.0, "stand_off": stand_off, "refill": refill}
    found = heaped(sweep, 3.0, **shape)[0]
    stations = np.linspace(0, length_m, 200)
    ramp = stations / length_m if length_m else np.ones(200)
    away = (along[0][..., None] - stations) ** 2 + across[0][..., None] ** 2
    envelope = (away / (2 * RADIUS_M) - depth_m * ramp).min(-1)
    return found, np.maximum(before[0] - envelope, 0)


def flat() -> np.ndarray:
    return np.zeros((1, SIDE, SIDE), dtype=np.float32)


def test_displacement_conserves_material() -> None:
    for length_m in (0.0, 0.006, 0.03):
        found, taken = deposit(flat(), length_m)
        # A travelling tool removes material step by step; a little stays between two steps.
        assert abs(found.sum() - taken.sum()) < 0.04 * taken.sum(), length_m
        assert found.min() >= 0


def test_no_deposit_in_fresh_groove() -> None:
    found, taken = deposit(flat())
    assert found[taken > 0.001].sum() < 0.03 * found.sum()


def test_refill_lays_material_into_the_fresh_groove_and_conserves_it() -> None:
    found, taken = deposit(flat(), refill=1.0)
    assert found[taken > 0.001].sum() > 0.1 * found.sum()
    assert found.sum() == pytest.approx(taken.sum(), rel=0.04)


def test_flanking_moves_deposit_to_the_sides_of_the_travel() -> None:
    along, across = (each[0] for each in places(0.0, (26.0, 31.5)))
    beside = (np.abs(across) > HALF_WIDTH_M) & (along > 0) & (along < 0.02)
    plain, aside = (deposit(flat(), flanking=amount)[0] for amount in (0.0, 0.8))
    assert aside[beside].sum() / aside.sum() > 1.1 * plain[beside].sum() / plain.sum()


def test_vertical_push_raises_symmetric_ring() -> None:
    found, _ = deposit(flat(), 0.0, start_px=(31.5, 31.5), facing=1.0)
    assert np.abs(found - np.rot90(found)).max() < 1e-6
    assert np.abs(found - found[::-1]).max() < 1e-6


def test_deposit_is_rotation_equivariant() -> None:
    found, _ = deposit(flat(), start_px=(31.5, 31.5))
    turned, _ = deposit(flat(), heading=np.pi / 2, start_px=(31.5, 31.5))
    assert np.abs(np.rot90(found) - turned).max() < 1e-5


def test_heap_grows_ahead_of_travelling_tool() -> None:
    found, _ = deposit(flat(), 0.03)
    along, across = (maps[0] for maps in places(0.0, (26.0, 31.5)))
    # The groove is deepest at its end: compare the deposit ahead with that behind the start and beside the path.
    ahead, behind = found[along > 0.03].sum(), found[along < 0.0].sum()
    assert ahead > 3 * behind
    more, _ = deposit(flat(), 0.03, facing=1.0)
    assert more[along > 0.03].sum() > 1.1 * ahead
    assert more[(along > 0) & (along < 0.03) & (abs(across) > 0.004)].sum() > 0


def test_stand_off_moves_deposit_outwards() -> None:
    near, far = (deposit(flat(), 0.0, start_px=(31.5, 31.5), stand_off=s)[0] for s in (0.0, 2.0))
    rows, columns = np.indices((SIDE, SIDE))
    away = np.hypot(rows - 31.5, columns - 31.5)
    assert (far * away).sum() / far.sum() > 1.02 * (near * away).sum() / near.sum()


def test_hole_behind_tool_takes_less_than_hole_beside() -> None:
    along, across = (maps[0] for maps in places(0.0, (26.0, 31.5)))
    behind = np.hypot(along + 0.008, across) < 0.005
    beside = np.hypot(along - 0.02, across - 0.012) < 0.005
    before = flat()
    before[0, behind | beside] = -0.003
    found, _ = deposit(before, 0.02)
    assert found[beside].sum() > 3 * found[behind].sum()
