"""A pen goes where it is led."""

from dataclasses import replace

import pytest
import torch

from pentimento.contracts.strokes import example_table
from pentimento.dynamics.strokes.evaluation import predict_with
from pentimento.dynamics.strokes.samples import StrokeSamples
from pentimento.dynamics.strokes.traj2stroke import Traj2StrokeParameters
from studies.stroke_models.as_commanded import is_pressed, train_unscaled
from studies.stroke_models.candidates import ANALYTIC, load_strokes


def test_a_pen_is_not_pressed() -> None:
    path = torch.zeros(2, 5, 5)
    assert not is_pressed(path)
    path[1, 3, 3] = 0.001  # above the paper
    assert not is_pressed(path)
    path[1, 3, 3] = -0.001
    assert is_pressed(path)


def test_offset_and_width_are_learnt_and_the_scale_is_not() -> None:
    samples: StrokeSamples = load_strokes(example_table(16)).samples
    truth = Traj2StrokeParameters((1.0, 1.0), (4e-4, -6e-4), 1e-4, 1.2e-3, 0.3, 0.9)
    after = predict_with(truth, samples)
    drawn = samples._replace(after=after, ink=(samples.before - after).mean(-1) > 0.3)
    found = train_unscaled(drawn, replace(ANALYTIC, epochs=40, batch=4), lambda *_: None)
    assert found.scale == (1.0, 1.0)
    assert found.offset_m == pytest.approx(truth.offset_m, abs=2e-4)
    assert found.thickness_at_contact_m == pytest.approx(1.2e-3, abs=3e-4)
