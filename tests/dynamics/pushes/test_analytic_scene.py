"""Where pixels lie about a push, and what its surface and its history are."""

from __future__ import annotations

import numpy as np
import pytest

from pentimento.contracts.errors import ContractError
from pentimento.contracts.frames import canvas_to_stroke, pixel_to_canvas
from pentimento.dynamics.pushes.analytic_scene import (
    from_way,
    local_places,
    scene_of,
    smoothed_periods,
    surface_at_start,
    swept_m,
    usual_half_width_m,
)
from tests.dynamics.pushes.played_pushes import HALF_WIDTH_M, PIXELS, blank, played


def test_pixels_lie_where_the_contracts_frames_say() -> None:
    samples = blank(5, 1)
    along, across = local_places(samples.window_m, (PIXELS, PIXELS), samples.action, samples.pixels_per_m)
    pixels = np.array([[3, 50], [40, 7]])  # column, row
    for b, (x, y, theta, *_) in enumerate(samples.action):
        places = pixel_to_canvas(pixels, samples.window_m[b], samples.pixels_per_m)
        local = canvas_to_stroke(places, x, y, theta)
        found = np.stack([along[b, pixels[:, 1], pixels[:, 0]], across[b, pixels[:, 1], pixels[:, 0]]], axis=1)
        assert np.allclose(found, local, atol=1e-7)


def test_places_beside_the_way_are_told_from_those_beyond_its_ends() -> None:
    scene = scene_of(blank(5, 1), HALF_WIDTH_M)
    length, away = scene.action[:, 3, None, None], from_way(scene) * HALF_WIDTH_M
    beside, behind = (scene.along > 0) & (scene.along < length), scene.along < 0
    assert np.allclose(away[beside], np.abs(scene.across)[beside], atol=1e-6)
    assert np.allclose(away[behind], np.hypot(scene.along, scene.across)[behind], atol=1e-6)
    beyond = scene.along > length
    assert np.allclose(away[beyond], np.hypot(scene.along - length, scene.across)[beyond], atol=1e-6)


def test_the_surface_at_the_start_is_the_one_that_the_robot_reads() -> None:
    samples = played(actions=8, repeats=2)
    along, across = local_places(samples.window_m, (PIXELS, PIXELS), samples.action, samples.pixels_per_m)
    assert surface_at_start(samples.before, along, across) == pytest.approx(samples.surface_m, abs=1e-6)


def test_a_push_that_starts_outside_its_window_is_named() -> None:
    samples = blank(3, 1)
    samples.action[1, 0] = 0.5
    with pytest.raises(ContractError, match="outside its window"):
        scene_of(samples)


def test_pinches_are_refused() -> None:
    samples = blank(3, 1)
    kind = samples.kind.copy()
    kind[1] = "pinch"
    with pytest.raises(ContractError, match="pinches"):
        scene_of(samples._replace(kind=kind.astype(np.str_)))


def test_the_footprints_half_width_is_read_off_the_scans() -> None:
    wide, narrow = (usual_half_width_m(played(actions=12, repeats=2, seed=seed)) for seed in (1, 2))
    assert wide == pytest.approx(narrow, rel=0.3)
    assert 0.5 * HALF_WIDTH_M < wide < 2 * HALF_WIDTH_M


def test_history_holds_what_earlier_pushes_since_the_smoothing_did_and_nothing_else() -> None:
    samples = blank(20, 2)
    scene = scene_of(samples, HALF_WIDTH_M)
    since, reset = samples.covariates["pushes_since_reset"], samples.covariates["reset_id"]
    assert scene.history_known and not scene.worked[since == 0].any()
    row = int(np.flatnonzero(since == 2)[0])
    expected = np.zeros((PIXELS, PIXELS))
    for other in np.flatnonzero((reset == reset[row]) & (samples.covariates["order"] < row)):
        one = samples.action[other : other + 1]
        along, across = local_places(samples.window_m[:1], (PIXELS, PIXELS), one, samples.pixels_per_m)
        expected += swept_m(along, across, one[:, 3], one[:, 4], HALF_WIDTH_M)[0]
    assert np.allclose(scene.worked[row], expected, atol=1e-7) and expected.any()


def test_periods_are_told_by_either_column_or_are_unknown() -> None:
    samples = blank(20, 2)
    by_reset = smoothed_periods(samples)
    columns = {name: v for name, v in samples.covariates.items() if name != "reset_id"}
    by_count = smoothed_periods(samples._replace(covariates=columns))
    assert by_reset is not None and by_count is not None
    assert len(set(zip(by_reset.tolist(), by_count.tolist(), strict=True))) == len(set(by_reset.tolist()))
    del columns["pushes_since_reset"]
    assert smoothed_periods(samples._replace(covariates=columns)) is None
