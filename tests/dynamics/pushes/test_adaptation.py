"""A push model of several materials, and its adaptation to another one from a few pushes."""

import dataclasses

import pytest
import torch

from pentimento.contracts.errors import ContractError
from pentimento.dynamics.pushes.evaluation import pose_error
from pentimento.dynamics.pushes.pose import PoseSamples, in_pose
from pentimento.dynamics.pushes.push_model import PushModel
from pentimento.dynamics.pushes.training import train
from studies.push_models import adapted, together
from tests.dynamics.pushes.conftest import CONFIG, Trained


def softer(samples: PoseSamples, share: float) -> PoseSamples:
    """The same pushes into a material that keeps another share of each dent."""
    return samples._replace(change=share * samples.change)


@pytest.fixture(scope="module")
def conditioned(trained: Trained) -> PushModel:
    samples = in_pose(trained.training, trained.crop)
    both = together([samples, softer(samples, 0.3)])
    config = dataclasses.replace(CONFIG, members=1, epochs=6)
    return train(
        both, "push", [("firm", "ball"), ("soft", "ball")], crop=trained.crop, config=config, log=lambda *_: None
    )


def test_joined_parts_have_their_own_context(trained: Trained) -> None:
    samples = in_pose(trained.training, trained.crop)
    both = together([samples, samples])
    assert both.context.tolist() == [0] * len(samples.state) + [1] * len(samples.state)
    assert torch.equal(both.change[: len(samples.state)], samples.change)


def test_context_selects_material(trained: Trained, conditioned: PushModel) -> None:
    held_out = in_pose(trained.held_out, trained.crop)
    for share, own, other in ((1.0, 0, 1), (0.3, 1, 0)):
        truth = softer(held_out, share)
        right, wrong = (
            pose_error(conditioned, truth._replace(context=torch.full_like(truth.context, k))) for k in (own, other)
        )
        assert right < 0.6 * wrong


def test_adapts_to_new_material_from_few_pushes(trained: Trained, conditioned: PushModel) -> None:
    few = softer(in_pose(trained.training, trained.crop), 0.65).pick(torch.arange(10))
    truth = softer(in_pose(trained.held_out, trained.crop), 0.65)
    before = min(pose_error(conditioned, truth._replace(context=torch.full_like(truth.context, k))) for k in (0, 1))
    own = adapted(conditioned, few, ("middling", "ball"), 1.0, 0)
    assert own.facts.contexts == (("middling", "ball"),)
    assert pose_error(own, truth) < 0.75 * before
    again = adapted(conditioned, few, ("middling", "ball"), 1.0, 0)
    assert all(torch.equal(value, again.state_dict()[name]) for name, value in own.state_dict().items())


def test_rejects_adaptation_without_pushes(trained: Trained, conditioned: PushModel) -> None:
    nothing = in_pose(trained.training, trained.crop).pick(torch.arange(0))
    with pytest.raises(ContractError, match="no pushes"):
        adapted(conditioned, nothing, ("middling", "ball"), 1.0, 0)
