"""Scenes of pushes: pixel places, surface at the start, history, and the surface's resistance."""

from __future__ import annotations

import numpy as np
import pytest

from pentimento.contracts.errors import ContractError
from pentimento.contracts.frames import canvas_to_stroke, pixel_to_canvas
from pentimento.contracts.height_maps import surface_at_m
from pentimento.dynamics.pushes.measured_scene import scene_of, smoothed_periods, usual_half_width_m
from pentimento.planning.pushes.analytic.scene import (
    STATIONS,
    deepest_m,
    distance_from_path,
    local_places,
    resistance_of,
    surface_at_start,
    swept_m,
    yielded,
)
from tests.dynamics.pushes.played_pushes import HALF_WIDTH_M, PIXELS, blank, played

PIXEL_M, SIDE, HALF_M = 0.0005, 120, 0.008
LEVEL = np.zeros((SIDE, SIDE))


def test_local_places_match_contract_frames() -> None:
    samples = blank(5, 1)
    along, across = local_places(
        samples.window_m, (PIXELS, PIXELS), action=samples.action, pixels_per_m=samples.pixels_per_m
    )
    pixels = np.array([[3, 50], [40, 7]])  # column, row
    for b, (x, y, theta, *_) in enumerate(samples.action):
        places = pixel_to_canvas(pixels, samples.window_m[b], samples.pixels_per_m)
        local = canvas_to_stroke(places, x, y, theta)
        found = np.stack([along[b, pixels[:, 1], pixels[:, 0]], across[b, pixels[:, 1], pixels[:, 0]]], axis=1)
        assert np.allclose(found, local, atol=1e-7)


def test_distance_from_path_beside_and_beyond_ends() -> None:
    scene = scene_of(blank(5, 1), HALF_WIDTH_M)
    length, distance = scene.action[:, 3, None, None], distance_from_path(scene) * HALF_WIDTH_M
    beside, behind = (scene.along > 0) & (scene.along < length), scene.along < 0
    assert np.allclose(distance[beside], np.abs(scene.across)[beside], atol=1e-6)
    assert np.allclose(distance[behind], np.hypot(scene.along, scene.across)[behind], atol=1e-6)
    beyond = scene.along > length
    assert np.allclose(distance[beyond], np.hypot(scene.along - length, scene.across)[beyond], atol=1e-6)


def test_surface_at_start_matches_robot_reading() -> None:
    samples = played(actions=8, repeats=2)
    along, across = local_places(
        samples.window_m, (PIXELS, PIXELS), action=samples.action, pixels_per_m=samples.pixels_per_m
    )
    assert surface_at_start(samples.before, along, across) == pytest.approx(samples.surface_m, abs=1e-6)


def test_rejects_push_starting_outside_window() -> None:
    samples = blank(3, 1)
    samples.action[1, 0] = 0.5
    with pytest.raises(ContractError, match=r"outside its window .*Row 1 \(counted from 0\)"):
        scene_of(samples)


def test_a_start_between_the_centres_of_coarse_pixels_is_inside_its_window() -> None:
    """Of pixels of 5 mm, the nearest centre may be 3.5 mm away."""
    window, action = np.array([[0.0, 0.0, 0.04, 0.04]]), np.array([[0.02, 0.02, 0.3, 0.01, 0.005]])
    heights = np.full((1, 8, 8), 0.01)
    heights[0, 3:5, 3:5] = [[0.02, 0.03], [0.04, 0.05]]
    along, across = local_places(window, (8, 8), action=action, pixels_per_m=200.0)
    assert surface_at_start(heights, along, across) == pytest.approx([0.035])
    assert surface_at_m(heights[0], tuple(window[0]), 0.02, 0.02) == pytest.approx(0.035)


def test_scene_rejects_pinches() -> None:
    samples = blank(3, 1)
    kind = samples.kind.copy()
    kind[1] = "pinch"
    with pytest.raises(ContractError, match="pinches"):
        scene_of(samples._replace(kind=kind.astype(np.str_)))


def test_estimates_footprint_half_width_from_scans() -> None:
    wide, narrow = (usual_half_width_m(played(actions=12, repeats=2, seed=seed)) for seed in (1, 2))
    assert wide == pytest.approx(narrow, rel=0.3)
    assert 0.5 * HALF_WIDTH_M < wide < 2 * HALF_WIDTH_M


def test_history_sums_earlier_pushes_since_smoothing() -> None:
    samples = blank(20, 2)
    scene = scene_of(samples, HALF_WIDTH_M)
    since, reset = samples.covariates["pushes_since_reset"], samples.covariates["reset_id"]
    assert scene.history_known and not scene.worked[since == 0].any()
    row = int(np.flatnonzero(since == 2)[0])
    expected = np.zeros((PIXELS, PIXELS))
    for other in np.flatnonzero((reset == reset[row]) & (samples.covariates["order"] < row)):
        one = samples.action[other : other + 1]
        along, across = local_places(
            samples.window_m[:1], (PIXELS, PIXELS), action=one, pixels_per_m=samples.pixels_per_m
        )
        expected += swept_m(along, across, length_m=one[:, 3], depth_m=one[:, 4], half_width_m=HALF_WIDTH_M)[0]
    assert np.allclose(scene.worked[row], expected, atol=1e-7) and expected.any()


def test_smoothed_periods_follow_either_column_or_are_unknown() -> None:
    samples = blank(20, 2)
    by_reset = smoothed_periods(samples)
    columns = {name: v for name, v in samples.covariates.items() if name != "reset_id"}
    by_count = smoothed_periods(samples._replace(covariates=columns))
    assert by_reset is not None and by_count is not None
    assert len(set(zip(by_reset.tolist(), by_count.tolist(), strict=True))) == len(set(by_reset.tolist()))
    del columns["pushes_since_reset"]
    assert smoothed_periods(samples._replace(covariates=columns)) is None


def resistances(before: np.ndarray, worked_m: np.ndarray, length_m: float, depth_m: float) -> np.ndarray:
    """[2, STATIONS, depths] of one push along the middle row: total, and of worked material."""
    x = (np.arange(SIDE) + 0.5) * PIXEL_M - 0.02
    along, across = np.meshgrid(x, (np.arange(SIDE)[::-1] + 0.5) * PIXEL_M - 0.03)
    surface, u, v, worked = (m[None].astype(np.float32) for m in (before, along, across, worked_m))
    return resistance_of(
        surface,
        u,
        v,
        worked=worked,
        action=np.array([[0.0, 0.0, 0.0, length_m, depth_m]]),
        pixel_m=PIXEL_M,
        half_width_m=HALF_M,
    )[:, 0]


def resistance(before: np.ndarray, length_m: float, depth_m: float) -> np.ndarray:
    """Total, [STATIONS, depths]."""
    return resistances(before, LEVEL, length_m, depth_m)[0]


def depths(depth_m: float, count: int) -> np.ndarray:
    return np.linspace(0.0, float(deepest_m(np.array([depth_m]))[0]), count)


def test_unit_force_is_ball_pressed_5_mm_into_level_surface() -> None:
    force = resistance(LEVEL, 0.0, 0.005)
    assert np.interp(0.005, depths(0.005, force.shape[1]), force[0]) == pytest.approx(1.0, rel=0.02)


def test_force_grows_with_depth_and_walls() -> None:
    level = resistance(LEVEL, 0.0, 0.006)[0]
    walled, grooved = LEVEL.copy(), LEVEL.copy()
    walled[:, 45:], grooved[:, 45:] = 0.004, -0.02
    assert (np.diff(level) > 0).all()
    assert (resistance(walled, 0.0, 0.006)[0] > level).all()
    assert (resistance(grooved, 0.0, 0.006)[0][1:] < level[1:]).all()


def test_travelling_tool_has_no_resistance_behind() -> None:
    still, moving = resistance(LEVEL, 0.0, 0.006)[-1], resistance(LEVEL, 0.025, 0.006)[-1]
    assert 0.4 < moving[8] / still[8] < 0.95


def test_worked_material_resistance_saturates_with_work() -> None:
    total, fresh = resistances(LEVEL, LEVEL, 0.02, 0.006)
    assert not fresh.any()
    _, half = resistances(LEVEL, LEVEL + 0.005, 0.02, 0.006)
    _, saturated = resistances(LEVEL, LEVEL + 1.0, 0.02, 0.006)
    assert np.allclose(half, total / 2, rtol=1e-4) and np.allclose(saturated, total, rtol=0.01)
    ahead = LEVEL.copy()
    ahead[:, 70:] = 0.005  # 15 mm beyond the start
    _, there = resistances(LEVEL, ahead, 0.02, 0.006)
    assert not there[0].any() and there[-1, -1] > 0.3 * total[-1, -1]


@pytest.mark.parametrize("give_m", [0.0, 0.0005, 0.002])
def test_compliance_balances_force(give_m: float) -> None:
    force = resistance(LEVEL, 0.02, 0.006)
    target = 0.006 * np.linspace(0, 1, STATIONS)[None]
    deepest = deepest_m(np.array([0.006]))
    depth = yielded(force[None], deepest, target, give_m)
    force_at_depth = [np.interp(d, depths(0.006, force.shape[1]), f) for d, f in zip(depth[0], force, strict=True)]
    assert np.allclose(target[0] - depth[0], give_m * np.array(force_at_depth), atol=1e-7)
