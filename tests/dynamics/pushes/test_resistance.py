"""How hard a surface pushes back: scale, order, and what a tool that gives way makes of it."""

from __future__ import annotations

import numpy as np
import pytest

from pentimento.dynamics.pushes.resistance import STATIONS, deepest_m, resistance_of, yielded

PIXEL_M, SIDE, HALF_M = 0.0005, 120, 0.008


def resistances(before: np.ndarray, worked_m: np.ndarray, length_m: float, depth_m: float) -> np.ndarray:
    """[2, STATIONS, depths] of one push along the middle row: of everything, and of what was worked."""
    x = (np.arange(SIDE) + 0.5) * PIXEL_M - 0.02
    along, across = np.meshgrid(x, (np.arange(SIDE)[::-1] + 0.5) * PIXEL_M - 0.03)
    surface, u, v, worked = (m[None].astype(np.float32) for m in (before, along, across, worked_m))
    return resistance_of(surface, u, v, worked, np.array([[0.0, 0.0, 0.0, length_m, depth_m]]), PIXEL_M, HALF_M)[:, 0]


def resistance(before: np.ndarray, length_m: float, depth_m: float) -> np.ndarray:
    """[STATIONS, depths] of everything."""
    return resistances(before, LEVEL, length_m, depth_m)[0]


LEVEL = np.zeros((SIDE, SIDE))


def depths(depth_m: float, count: int) -> np.ndarray:
    return np.linspace(0.0, float(deepest_m(np.array([depth_m]))[0]), count)


def test_a_ball_pressed_5_mm_straight_down_meets_1() -> None:
    force = resistance(LEVEL, 0.0, 0.005)
    assert np.interp(0.005, depths(0.005, force.shape[1]), force[0]) == pytest.approx(1.0, rel=0.02)


def test_force_grows_with_depth_and_with_what_stands_in_the_way() -> None:
    level = resistance(LEVEL, 0.0, 0.006)[0]
    walled, grooved = LEVEL.copy(), LEVEL.copy()
    walled[:, 45:], grooved[:, 45:] = 0.004, -0.02
    assert (np.diff(level) > 0).all()
    assert (resistance(walled, 0.0, 0.006)[0] > level).all()
    assert (resistance(grooved, 0.0, 0.006)[0][1:] < level[1:]).all()


def test_a_travelling_tool_hangs_free_behind() -> None:
    still, moving = resistance(LEVEL, 0.0, 0.006)[-1], resistance(LEVEL, 0.025, 0.006)[-1]
    assert 0.4 < moving[8] / still[8] < 0.95


def test_what_was_worked_counts_apart_the_more_the_more_it_was() -> None:
    everything, fresh = resistances(LEVEL, LEVEL, 0.02, 0.006)
    assert not fresh.any()
    _, half = resistances(LEVEL, LEVEL + 0.005, 0.02, 0.006)
    _, most = resistances(LEVEL, LEVEL + 1.0, 0.02, 0.006)
    assert np.allclose(half, everything / 2, rtol=1e-4) and np.allclose(most, everything, rtol=0.01)
    ahead = LEVEL.copy()
    ahead[:, 70:] = 0.005  # 15 mm beyond the start
    _, there = resistances(LEVEL, ahead, 0.02, 0.006)
    assert not there[0].any() and there[-1, -1] > 0.3 * everything[-1, -1]


@pytest.mark.parametrize("give_m", [0.0, 0.0005, 0.002])
def test_give_and_force_balance(give_m: float) -> None:
    force = resistance(LEVEL, 0.02, 0.006)
    wanted = 0.006 * np.linspace(0, 1, STATIONS)[None]
    deepest = deepest_m(np.array([0.006]))
    deep = yielded(force[None], deepest, wanted, give_m)
    met = [np.interp(d, depths(0.006, force.shape[1]), f) for d, f in zip(deep[0], force, strict=True)]
    assert np.allclose(wanted[0] - deep[0], give_m * np.array(met), atol=1e-7)
