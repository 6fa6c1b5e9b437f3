"""Training: accuracy over trivial baselines, reproducibility, splits and configuration."""

import dataclasses

import numpy as np
import pytest
import torch

from pentimento.contracts.errors import ContractError
from pentimento.contracts.pushes import example_table
from pentimento.dynamics.pushes.evaluation import mean_footprint, predict, score, unchanged
from pentimento.dynamics.pushes.measured import load_pushes
from pentimento.dynamics.pushes.pose import in_pose
from pentimento.dynamics.pushes.training import TrainingConfig, crop_for, split_by_action, train
from tests.dynamics.pushes.conftest import CONFIG, Trained


def test_trained_model_beats_trivial_baselines(trained: Trained) -> None:
    held_out, crop = trained.held_out, trained.crop
    found = [
        score(predicted, held_out, crop)
        for predicted in (
            predict(trained.model, held_out), mean_footprint(trained.training, held_out, crop), unchanged(held_out)
        )
    ]  # fmt: skip
    assert found[0].l_3d_mm2 < 0.5 * found[1].l_3d_mm2 < 0.5 * found[2].l_3d_mm2
    assert found[0].window_l_3d_mm2 < 0.5 * found[1].window_l_3d_mm2
    assert found[0].l_viz < found[1].l_viz < found[2].l_viz
    assert found[0].chamfer_mm < found[2].chamfer_mm
    assert found[0].emd_mm < found[2].emd_mm
    assert trained.losses[9] < trained.losses[0]
    assert len(trained.losses) == 10


def test_training_is_reproducible(trained: Trained) -> None:
    short = dataclasses.replace(CONFIG, epochs=1)
    samples = in_pose(trained.training, trained.crop)
    first, second = (
        train(samples, "push", [("foam", "ball")], crop=trained.crop, config=short, log=lambda *_: None).state_dict()
        for _ in range(2)
    )
    assert all(torch.equal(first[name], second[name]) for name in first)


def test_ensemble_members_differ(trained: Trained) -> None:
    samples = in_pose(trained.held_out, trained.crop)
    changes = trained.model.change(samples.state, samples.length_m, samples.depth_m, samples.context)
    assert changes.std(0).max() > 1e-6


def test_split_keeps_repeats_together() -> None:
    samples, _ = load_pushes(example_table(12))
    samples = samples._replace(action_id=samples.action_id // 3)
    training, held_out = split_by_action(samples, 0.25, 0)
    assert not set(training.action_id) & set(held_out.action_id)
    assert len(training.before) + len(held_out.before) == 12
    mixed = samples._replace(action_id=np.array([0, 0, 1, 1, 2, 2, 3, 3, 4, 5, 6, 7]))
    apart = split_by_action(mixed, 0.25, 0)[1].action_id
    assert len(apart) == 3  # one of the four repeated actions, and one of the four others
    with pytest.raises(ContractError, match="none trained on"):
        split_by_action(samples.pick(samples.action_id == 0), 0.25, 0)


def test_model_is_rotation_equivariant(trained: Trained) -> None:
    some = trained.held_out.pick(np.arange(3))
    x, y, theta, length, depth = some.action.T
    turned = some._replace(
        before=np.rot90(some.before, 1, (1, 2)).copy(),
        after=np.rot90(some.after, 1, (1, 2)).copy(),
        action=np.stack([0.12 - y, x, theta + np.pi / 2, length, depth], axis=1),
    )
    one, other = predict(trained.model, some), predict(trained.model, turned)
    torch.testing.assert_close(one.rot90(1, (1, 2)), other, atol=2e-6, rtol=0)
    assert (other - torch.from_numpy(turned.before)).amin((1, 2)).max() < -5e-4


def test_crop_for_rejects_mixed_kinds() -> None:
    samples, _ = load_pushes(example_table(4))
    mixed = samples._replace(kind=np.array(["push", "pinch", "push", "push"]))
    with pytest.raises(ContractError, match="each kind"):
        crop_for(mixed, CONFIG)
    pinches = samples._replace(kind=np.array(["pinch"] * 4))
    assert crop_for(pinches, CONFIG).behind_m == pytest.approx(0.04)


@pytest.mark.parametrize(
    ("field", "value"),
    [("epochs", 0), ("members", 0), ("side_px", 4), ("behind_m", 0.0), ("learning_rate", 0.0), ("visual_weight", -1.0),
     ("held_out", 1.0), ("held_out", 0.0), ("seed", -1), ("channels", 0), ("batch", 0)],
)  # fmt: skip
def test_rejects_invalid_training_config(field: str, value: float) -> None:
    with pytest.raises(ValueError, match=field):
        dataclasses.replace(CONFIG, **{field: value})
    assert isinstance(CONFIG, TrainingConfig)
