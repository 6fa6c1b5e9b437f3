"""The soft-edge model lowers a residual that it can learn, and is switched off where it cannot."""

from collections.abc import Iterator
from dataclasses import replace

import pytest
import torch

from pentimento.dynamics.strokes.extended import MeasuredStrokes, StrokeModel, base_model, predict_extended
from pentimento.dynamics.strokes.mechanisms.ink_depletion import InkDepletion
from pentimento.dynamics.strokes.samples import StrokeSamples
from pentimento.dynamics.strokes.training import predicted_ink, weighted_l1
from studies.stroke_models.networks import soft_edge
from studies.stroke_models.networks.soft_edge import SoftEdgeModel, fit_soft_edge
from tests.dynamics.strokes.conftest import TRUTH


@pytest.fixture(scope="module", autouse=True)
def _few_steps() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(soft_edge, "_MIN_ACTIONS", 20)
        patch.setattr(soft_edge, "_STEPS", 200)
        patch.setattr(soft_edge, "_STEPS_OF_A_FOLD", 100)
        yield


@pytest.fixture(scope="module")
def learnt(made_by_truth: StrokeSamples, _few_steps: None) -> SoftEdgeModel:
    """What is learnt, with seed 0, of a model in which strokes fade."""
    model, strokes = _fading(made_by_truth)
    return fit_soft_edge(model, strokes, 2.0, 0, _quiet)


def _fading(samples: StrokeSamples) -> tuple[StrokeModel, MeasuredStrokes]:
    """A model whose mechanism makes strokes fade, which they did not."""
    rows = torch.arange(len(samples.path), dtype=torch.float32)
    strokes = MeasuredStrokes(samples, {"ink_since_reload_m": 0.02 * (rows % 4)})
    fading = InkDepletion(torch.tensor([0.6, 0.2]), InkDepletion.reference_of(strokes.context))
    return replace(base_model(TRUTH), mechanisms=(fading,)), strokes


def _alone(model: StrokeModel, strokes: MeasuredStrokes) -> torch.Tensor:
    return predict_extended(model.mark(), model.mechanisms, strokes)


def test_it_lays_what_the_model_takes_too_much(made_by_truth: StrokeSamples, learnt: SoftEdgeModel) -> None:
    model, strokes = _fading(made_by_truth)
    assert learnt.network is not None
    assert learnt.unseen_l1[1] < learnt.unseen_l1[0]
    alone = _alone(model, strokes)
    assert weighted_l1(learnt(strokes), made_by_truth, 2.0) < 0.7 * weighted_l1(alone, made_by_truth, 2.0)
    assert learnt.unseen_l1[0] == pytest.approx(float(weighted_l1(alone, made_by_truth, 2.0)), rel=1e-5)


def test_it_inks_what_lies_beyond_a_mark_that_is_too_thin(made_by_truth: StrokeSamples) -> None:
    thin = replace(TRUTH, thickness_at_contact_m=0.5 * TRUTH.thickness_at_contact_m, softness=0.01)
    model, strokes = base_model(thin), MeasuredStrokes(made_by_truth, {})
    learnt = fit_soft_edge(model, strokes, 2.0, 0, _quiet)
    inked, alone = (predicted_ink(made_by_truth, image) for image in (learnt(strokes), _alone(model, strokes)))
    missed = made_by_truth.ink & ~alone
    assert missed.sum() > 100 and (inked & missed).sum() > 0.5 * missed.sum()


def test_where_nothing_is_left_the_model_stays_as_it_is(made_by_truth: StrokeSamples) -> None:
    model, strokes = base_model(TRUTH), MeasuredStrokes(made_by_truth, {})
    learnt = fit_soft_edge(model, strokes, 2.0, 0, _quiet)
    assert learnt.network is None
    torch.testing.assert_close(learnt(strokes), _alone(model, strokes))


def test_repeats_of_few_actions_say_nothing_of_others(made_by_truth: StrokeSamples) -> None:
    few = made_by_truth._replace(action=made_by_truth.action % 19)
    model, strokes = _fading(few)
    assert fit_soft_edge(model, strokes, 2.0, 0, _quiet).network is None


def test_the_same_seed_learns_the_same(made_by_truth: StrokeSamples, learnt: SoftEdgeModel) -> None:
    model, strokes = _fading(made_by_truth)
    again = fit_soft_edge(model, strokes, 2.0, 0, _quiet)
    torch.testing.assert_close(learnt(strokes), again(strokes), atol=0, rtol=0)


def _quiet(name: str, value: float, step: int) -> None:
    pass
