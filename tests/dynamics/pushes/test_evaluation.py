"""Scores of push models: noise floor, cloud distances, pictures."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from pentimento.contracts.pushes import example_table
from pentimento.dynamics.pushes.evaluation import (
    chamfer,
    cloud,
    comparison,
    earth_movers,
    floor,
    hillshade,
    predict,
    repeated,
    score,
    scores,
    thinned,
)
from pentimento.dynamics.pushes.measured import PushSamples, load_pushes
from tests.dynamics.pushes.conftest import Trained

NOISE_MM = 0.3
FLAT = cloud(np.full((10, 12), 0.04), np.ones((10, 12), dtype=bool), 500.0)


def repeated_flat(trained: Trained, actions: int, times: int) -> PushSamples:
    """Repeated actions on flat clay, with noise in the later scan only."""
    samples, _ = load_pushes(example_table(actions))
    samples = samples.pick(np.repeat(np.arange(actions), times))
    rng = np.random.default_rng(0)
    flat = np.full_like(samples.before, 0.04)
    noise = rng.normal(0, 1e-3 * NOISE_MM, flat.shape).astype(np.float32)
    return samples._replace(before=flat, after=flat - 1e-3 + noise)


def test_floor_is_variance_of_repeats(trained: Trained) -> None:
    found = floor(repeated_flat(trained, 6, 3), trained.crop)
    assert found is not None
    assert found.actions == 6
    assert found.window_l_3d_mm2 == pytest.approx(NOISE_MM**2, rel=0.03)
    # central differences halve the noise in each of two directions
    assert found.window_l_viz == pytest.approx(NOISE_MM**2 * 1e-6 * 500**2, rel=0.05)
    assert found.l_3d_mm2 < found.window_l_3d_mm2  # sampling the crop averages pixels


def test_predicting_the_mean_reaches_noise_floor(trained: Trained) -> None:
    samples = repeated_flat(trained, 4, 20)
    known = score(torch.full((80, 60, 60), 0.039), samples, trained.crop)
    lowest = floor(samples, trained.crop)
    assert lowest is not None
    assert known.l_3d_mm2 == pytest.approx(lowest.l_3d_mm2, rel=0.08)
    assert known.window_l_3d_mm2 == pytest.approx(lowest.window_l_3d_mm2, rel=0.05)
    assert known.l_viz == pytest.approx(lowest.l_viz, rel=0.08)


def test_no_floor_without_repeats(trained: Trained) -> None:
    assert floor(trained.training, trained.crop) is None
    found = scores(trained.model, trained.training, trained.held_out, all_samples=trained.training)
    assert "floor" not in found
    assert set(found["held_out"]) == {"model", "mean_footprint", "unchanged"}


def test_ratio_to_floor_uses_the_same_pushes(trained: Trained) -> None:
    again = repeated_flat(trained, 3, 4)
    others = trained.held_out._replace(action_id=trained.held_out.action_id + 1000)
    both = PushSamples(
        *(np.concatenate([getattr(again, name), getattr(others, name)]) for name in PushSamples._fields[:5]),
        again.pixels_per_m,
        *(np.concatenate([getattr(again, name), getattr(others, name)]) for name in PushSamples._fields[6:-1]),
        {},
    )
    assert repeated(both).tolist() == [True] * 12 + [False] * len(others.before)
    found = scores(trained.model, trained.training, both, all_samples=again)["held_out_repeats"]
    assert found["floor"]["actions"] == 3
    error = score(predict(trained.model, again), again, trained.crop)
    assert found["over_floor"]["l_3d_mm2"] == pytest.approx(error.l_3d_mm2 / found["floor"]["l_3d_mm2"], rel=1e-4)


def test_perfect_prediction_has_zero_error(trained: Trained) -> None:
    perfect = score(torch.from_numpy(trained.held_out.after), trained.held_out, trained.crop)
    assert perfect.l_3d_mm2 == perfect.l_viz == perfect.window_l_3d_mm2 == 0
    assert perfect.chamfer_mm == perfect.emd_mm == 0


def test_cloud_distances_of_small_lift() -> None:
    lifted = FLAT + np.array([0.0, 0.0, 5e-4])
    assert chamfer(FLAT, lifted) == pytest.approx(1e-3)  # both directions
    assert earth_movers(FLAT, lifted) == pytest.approx(5e-4)


def test_earth_movers_distance_of_single_outlier() -> None:
    moved = FLAT.copy()
    moved[7] += [0.0, 0.0, 0.1]
    assert earth_movers(FLAT, moved) == pytest.approx(0.1 / 120)
    assert earth_movers(FLAT, FLAT[::-1]) == pytest.approx(0.0)


def test_earth_movers_accepts_clouds_of_different_size() -> None:
    assert 0 < earth_movers(FLAT, FLAT[:60] + 1e-4) < 0.03


def test_cloud_skips_unknown_pixels() -> None:
    known = np.ones((10, 12), dtype=bool)
    known[2, 3] = False
    assert len(cloud(np.full((10, 12), 0.04), known, 500.0)) == 119


def test_cloud_y_axis_points_up() -> None:
    height = np.zeros((10, 12))
    height[0, 5] = 1.0
    points = cloud(height, np.ones((10, 12), dtype=bool), 500.0)
    assert points[points[:, 2].argmax(), 1] == points[:, 1].max()


def test_thinning_keeps_noisy_surface_in_one_layer() -> None:
    rng = np.random.default_rng(0)
    noisy = FLAT + np.array([0, 0, 1]) * rng.normal(0, 1e-4, (120, 1))
    thin = thinned(noisy, 5e-3, np.median(noisy, axis=0))
    area_voxels = (12 / 500 / 5e-3 + 2) * (10 / 500 / 5e-3 + 2)
    assert len(thin) <= area_voxels
    assert thin[:, 2].std() < 1e-4


def test_hillshade_lights_upper_left_slopes() -> None:
    row, column = np.mgrid[:41, :41].astype(float) - 20
    bump = 3e-3 * np.exp(-(row**2 + column**2) / 60)
    shaded = hillshade(bump, 500.0).astype(int)
    flat = shaded[0, 0]
    assert shaded[15, 15] > flat > shaded[25, 25]  # row 15 is above the middle
    np.testing.assert_array_equal(shaded, shaded.T)


def test_comparison_colours_error_sign_and_holes() -> None:
    flat = np.full((1, 8, 10), 0.04)
    predicted = flat.copy()
    predicted[0, 2, 3], predicted[0, 5, 6], predicted[0, 7, 9] = 0.043, 0.037, 0.05
    known = np.ones((1, 8, 10), dtype=bool)
    known[0, 7, 9] = False
    picture = comparison(flat, flat, predicted, known=known, pixels_per_m=500.0)
    assert picture.shape == (8, 4 * 10 + 3 * 3, 3)
    error = picture[:, -10:].astype(int)
    assert error[2, 3, 0] > 2 * error[2, 3, 2]
    assert error[5, 6, 2] > 2 * error[5, 6, 0]
    assert (error[7, 9] == 255).all()
    assert (error[0, 0] == 255).all()
