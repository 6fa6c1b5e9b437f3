"""The floor is the scatter of repeats; scores over it mean what they say."""

import numpy as np
import pytest
import torch

from pentimento.contracts.pushes import example_table
from pentimento.dynamics.pushes.evaluation import floor, predict, repeated, score, scores
from pentimento.dynamics.pushes.measured import PushSamples, load_pushes
from tests.dynamics.pushes.conftest import Trained

NOISE_MM = 0.3


def repeated_flat(trained: Trained, actions: int, times: int) -> PushSamples:
    """Actions repeated on flat clay, seen with noise in the later scan only."""
    samples, _ = load_pushes(example_table(actions))
    samples = samples.pick(np.repeat(np.arange(actions), times))
    rng = np.random.default_rng(0)
    flat = np.full_like(samples.before, 0.04)
    noise = rng.normal(0, 1e-3 * NOISE_MM, flat.shape).astype(np.float32)
    return samples._replace(before=flat, after=flat - 1e-3 + noise)


def test_the_floor_is_the_variance_of_repeats(trained: Trained) -> None:
    found = floor(repeated_flat(trained, 6, 3), trained.crop)
    assert found is not None
    assert found.actions == 6
    assert found.window_l_3d_mm2 == pytest.approx(NOISE_MM**2, rel=0.03)
    # central differences halve the noise in each of two directions
    assert found.window_l_viz == pytest.approx(NOISE_MM**2 * 1e-6 * 500**2, rel=0.05)
    assert found.l_3d_mm2 < found.window_l_3d_mm2  # sampling the crop averages pixels


def test_who_knows_the_mean_reaches_the_floor(trained: Trained) -> None:
    samples = repeated_flat(trained, 4, 20)
    known = score(torch.full((80, 60, 60), 0.039), samples, trained.crop)
    lowest = floor(samples, trained.crop)
    assert lowest is not None
    assert known.l_3d_mm2 == pytest.approx(lowest.l_3d_mm2, rel=0.08)
    assert known.window_l_3d_mm2 == pytest.approx(lowest.window_l_3d_mm2, rel=0.05)
    assert known.l_viz == pytest.approx(lowest.l_viz, rel=0.08)


def test_without_repeats_there_is_no_floor(trained: Trained) -> None:
    assert floor(trained.training, trained.crop) is None
    found = scores(trained.model, trained.training, trained.held_out, trained.training)
    assert "floor" not in found
    assert set(found["held_out"]) == {"model", "mean_footprint", "unchanged"}


def test_a_model_is_held_against_the_floor_of_the_same_pushes(trained: Trained) -> None:
    """What repeats scatter little is compared with the error on those pushes, not on others."""
    again = repeated_flat(trained, 3, 4)
    others = trained.held_out._replace(action_id=trained.held_out.action_id + 1000)
    both = PushSamples(
        *(np.concatenate([getattr(again, name), getattr(others, name)]) for name in PushSamples._fields[:5]),
        again.pixels_per_m,
        *(np.concatenate([getattr(again, name), getattr(others, name)]) for name in PushSamples._fields[6:-1]),
        {},
    )
    assert repeated(both).tolist() == [True] * 12 + [False] * len(others.before)
    found = scores(trained.model, trained.training, both, again)["held_out_repeats"]
    assert found["floor"]["actions"] == 3
    error = score(predict(trained.model, again), again, trained.crop)
    assert found["over_floor"]["l_3d_mm2"] == pytest.approx(error.l_3d_mm2 / found["floor"]["l_3d_mm2"], rel=1e-4)


def test_a_perfect_prediction_scores_nothing(trained: Trained) -> None:
    perfect = score(torch.from_numpy(trained.held_out.after), trained.held_out, trained.crop)
    assert perfect.l_3d_mm2 == perfect.l_viz == perfect.window_l_3d_mm2 == 0
    assert perfect.chamfer_mm == perfect.emd_mm == 0
