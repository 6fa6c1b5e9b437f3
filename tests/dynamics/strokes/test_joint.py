"""The joint fit finds base and cause together, and leaves the base alone where the cause does not help."""

import dataclasses

import pytest
import torch

from pentimento.dynamics.strokes.extended import MeasuredStrokes, StrokeTiming, predict_extended
from pentimento.dynamics.strokes.joint import JointFit, fit_jointly
from pentimento.dynamics.strokes.mechanisms.ink_depletion import InkDepletion
from pentimento.dynamics.strokes.mechanisms.path_offset import PathOffset
from pentimento.dynamics.strokes.mechanisms.path_scale import PathScale
from pentimento.dynamics.strokes.samples import StrokeSamples
from pentimento.dynamics.strokes.simulation import Mechanism
from pentimento.dynamics.strokes.training import TrainingConfig
from pentimento.dynamics.strokes.traj2stroke import Traj2Stroke, Traj2StrokeParameters
from tests.dynamics.strokes.conftest import TRUTH

CONFIG = TrainingConfig(12, 1000.0, 0.05, 20, 6, 0.05, 2.0, 0.25, 0)
NO_WAIT = StrokeTiming(0.0, 0.0)
LOSS = torch.tensor([0.3, 0.1])


@pytest.fixture(scope="module")
def fading(made_by_truth: StrokeSamples) -> MeasuredStrokes:
    """Strokes of TRUTH that fade with the ink used since the last dip."""
    rows = torch.arange(len(made_by_truth.path), dtype=torch.float32)
    strokes = MeasuredStrokes(made_by_truth, {"ink_since_reload_m": 0.02 * (rows % 4)})
    cause = InkDepletion(LOSS, InkDepletion.reference_of(strokes.context))
    after = predict_extended(Traj2Stroke(TRUTH).requires_grad_(False), [cause], strokes)
    return strokes._replace(samples=made_by_truth._replace(after=after))


def halves(strokes: MeasuredStrokes) -> tuple[MeasuredStrokes, MeasuredStrokes]:
    return strokes.pick(torch.arange(18)), strokes.pick(torch.arange(18, 24))


def fitted(
    base: Traj2StrokeParameters,
    causes: list[Mechanism],
    strokes: MeasuredStrokes,
    *,
    timing: StrokeTiming = NO_WAIT,
    config: TrainingConfig = CONFIG,
) -> JointFit:
    training, validation = halves(strokes)
    return fit_jointly(base, causes, training, validation=validation, timing=timing, config=config, log=lambda *_: None)


def half_known(strokes: MeasuredStrokes) -> InkDepletion:
    return InkDepletion(0.5 * LOSS, InkDepletion.reference_of(strokes.context))


def test_joint_fit_recovers_base_and_cause(fading: MeasuredStrokes) -> None:
    base = dataclasses.replace(TRUTH, opacity=0.75, thickness_at_contact_m=1.3e-3)  # as if they had made up for it
    own = [PathOffset(torch.tensor(TRUTH.offset_m), {}), PathScale(torch.tensor(TRUTH.scale) - 1, {})]
    config = dataclasses.replace(CONFIG, epochs=40)
    found = fitted(base, [half_known(fading), *own], fading, timing=StrokeTiming(3.0, 5.0), config=config)
    assert found.kept
    assert found.validation_l1[1] < 0.3 * found.validation_l1[0]
    assert [m.cause for m in found.model.mechanisms] == ["ink_depletion"]  # the base has the others itself
    torch.testing.assert_close(found.model.mechanisms[0].values, LOSS, atol=0.05, rtol=0)
    assert found.model.parameters.opacity == pytest.approx(TRUTH.opacity, abs=0.04)
    assert list(found.model.fitted) == ["ink_since_reload_m"]
    assert found.model.timing == StrokeTiming(3.0, 5.0)


def test_a_cause_that_does_not_help_leaves_the_base(made_by_truth: StrokeSamples, fading: MeasuredStrokes) -> None:
    steady = fading._replace(samples=made_by_truth)
    found = fitted(TRUTH, [half_known(steady)], steady)
    assert not found.kept
    assert found.validation_l1[1] >= found.validation_l1[0]
    assert (found.model.parameters, found.model.mechanisms) == (TRUTH, ())


def test_causes_that_the_base_has_itself_change_nothing(fading: MeasuredStrokes) -> None:
    offset = PathOffset(torch.tensor([1e-3, 0.0]), {})
    found = fitted(TRUTH, [offset], fading)
    assert (found.kept, found.model.parameters, found.model.mechanisms) == (False, TRUTH, ())
