"""Pushes in the constant pose."""

import numpy as np
import torch

from pentimento.dynamics.pushes.posed_samples import in_pose
from tests.dynamics.pushes.conftest import Trained


def test_the_constant_pose_holds_the_push_and_knows_where_it_sees(trained: Trained) -> None:
    samples, crop = trained.training, trained.crop
    seen = in_pose(samples, crop)
    along, across = crop.places_m().unbind(-1)
    for number in range(4):
        length = float(seen.length_m[number])
        on_line = (across.abs() < 2e-3) & (along > 0.5 * length - 1e-3) & (along < length + 1e-3)
        beside = (across.abs() > 0.03) & seen.known[number]
        assert seen.change[number][on_line].mean() < -1e-3
        assert seen.change[number][beside].abs().mean() < 3e-4
    edge = samples.pick(np.array([0]))._replace(action=np.array([[0.005, 0.06, 0.0, 0.02, 0.005]]))
    known = in_pose(edge, crop).known[0]
    assert not known[:, along[0] < -0.007].any()
    assert known[10:30, along[0] > -0.004].all()


def test_a_mirror_image_is_the_push_at_the_mirrored_place(trained: Trained) -> None:
    """The crop's left and right change places; applied to a mirrored table it is the same crop."""
    seen = in_pose(trained.training, trained.crop)
    mirrored = seen.mirrored(torch.ones(len(seen.state), dtype=torch.bool))
    x, y, theta, length, depth = trained.training.action.T
    other = trained.training._replace(
        before=trained.training.before[:, ::-1].copy(),
        after=trained.training.after[:, ::-1].copy(),
        action=np.stack([x, 0.12 - y, -theta, length, depth], axis=1),
    )
    torch.testing.assert_close(in_pose(other, trained.crop).state, mirrored.state, atol=1e-6, rtol=0)
    torch.testing.assert_close(in_pose(other, trained.crop).change, mirrored.change, atol=1e-6, rtol=0)
