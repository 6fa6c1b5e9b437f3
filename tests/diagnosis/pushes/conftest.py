"""Shared diagnosis of a session whose truth is the base model with volume loss."""

from __future__ import annotations

from typing import NamedTuple

import pytest

from pentimento.diagnosis.diagnose import diagnose
from pentimento.diagnosis.pushes.measured import MeasuredPushes, measure
from pentimento.diagnosis.pushes.problem import PushResult, push_problem
from pentimento.dynamics.pushes.measured import PushSamples
from pentimento.planning.pushes.analytic.mechanisms.far_field import FarField
from pentimento.planning.pushes.analytic.mechanisms.tool_backlash import ToolBacklash
from pentimento.planning.pushes.analytic.mechanisms.volume_loss import VolumeLoss
from tests.dynamics.pushes.played_pushes import blank, mechanism, played

ACTIONS, LOST = 28, 0.5


class Played(NamedTuple):
    samples: PushSamples
    measured: MeasuredPushes
    result: PushResult


@pytest.fixture(scope="session")
def lossy() -> Played:
    given = blank(ACTIONS)
    samples = played([mechanism(VolumeLoss, given, lost_share=LOST)], ACTIONS)
    measured = measure(samples)
    problem = push_problem(measured, (VolumeLoss, FarField, ToolBacklash), 0)
    return Played(samples, measured, diagnose(problem, seed=0, log=lambda line: None))
