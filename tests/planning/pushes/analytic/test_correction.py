"""Correction of a push network by causes that it cannot see."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from pentimento.contracts.errors import ContractError
from pentimento.dynamics.pushes.measured_scene import scene_of
from pentimento.planning.pushes.analytic.correction import (
    FILE,
    CorrectedClay,
    Correction,
    Range,
    corrected,
    correction_as_json,
    read_correction,
    split_hidden,
)
from pentimento.planning.pushes.analytic.mechanisms.far_field import FarField
from pentimento.planning.pushes.analytic.mechanisms.tool_backlash import ToolBacklash
from pentimento.planning.pushes.analytic.model import first_model, identity
from pentimento.planning.pushes.memory import FRESH, PushMemory
from pentimento.planning.pushes.rollout import Array, FloatArray, Pull
from tests.dynamics.pushes.played_pushes import HALF_WIDTH_M, PIXELS, SIDE_M, blank

WINDOW_M = np.array([0.0, 0.0, SIDE_M, SIDE_M])


class UniformClay:
    """A push model that lowers the whole surface by a tenth of the depth."""

    window_m = WINDOW_M
    end_effector = "ball"

    def after(self, height_m: Array, actions: FloatArray, memory: PushMemory = FRESH) -> Array:
        return np.stack([height_m - np.float32(0.1 * action[4]) for action in actions])

    def step(self, height_m: Array, action: FloatArray, memory: PushMemory = FRESH) -> tuple[Array, Pull]:
        def pull(cotangent: Array) -> tuple[Array, FloatArray]:
            return cotangent, np.array([0.0, 0.0, 0.0, 0.0, -0.1 * cotangent.sum()])

        return self.after(height_m, action[None])[0], pull


@pytest.fixture(scope="module")
def correction() -> Correction:
    """Backlash of 1 mm along x, which is hidden, and a swell, which is visible."""
    scene = scene_of(blank(12, 1), HALF_WIDTH_M)
    base = first_model(scene)
    backlash = ToolBacklash(np.array([0.001, 0.0]), {})
    swell = FarField(np.array([0.2]), {})
    return Correction(base.plus(swell, backlash), base.plus(swell), HALF_WIDTH_M, {"dwell_s": Range(0.0, 1.0, 2.0)})


def test_correction_excludes_visible_causes(correction: Correction) -> None:
    height = np.full((PIXELS, PIXELS), 0.04, np.float32)
    actions = np.array([[0.07, 0.05, np.pi / 2, 0.02, 0.006], [0.05, 0.07, 0.0, 0.02, 0.006]])
    north, east = correction.planned(height, WINDOW_M, actions)
    assert np.abs(north).max() < 1e-6  # no backlash along y
    assert np.abs(east).max() > 1e-4


def test_corrected_model_adds_correction_and_its_gradient(correction: Correction) -> None:
    clay = CorrectedClay(UniformClay(), correction)
    rng = np.random.default_rng(0)
    height = np.full((PIXELS, PIXELS), 0.04, np.float32)
    action = np.array([0.05, 0.07, 0.3, 0.02, 0.006])
    after, pull = clay.step(height, action)
    assert np.allclose(after, clay.after(height, action[None])[0], atol=1e-6)
    cotangent = rng.standard_normal(height.shape).astype(np.float32)
    _, found = pull(cotangent)
    for number, step in enumerate((3e-4, 3e-4, 5e-3, 3e-4, 2e-4)):
        moved = action + np.outer((1, -1), step * (np.arange(5) == number))
        up, down = (float((clay.after(height, one[None])[0].astype(np.float64) * cotangent).sum()) for one in moved)
        assert found[number] == pytest.approx((up - down) / (2 * step), rel=0.25, abs=0.3)


def test_corrected_model_accepts_no_actions(correction: Correction) -> None:
    class EmptyClay(UniformClay):
        def after(self, height_m: Array, actions: FloatArray, memory: PushMemory = FRESH) -> Array:
            return np.zeros((len(actions), *height_m.shape), np.float32)

    height = np.zeros((PIXELS, PIXELS), np.float32)
    assert CorrectedClay(EmptyClay(), correction).after(height, np.zeros((0, 5))).shape == (0, PIXELS, PIXELS)


def test_correction_round_trips_through_file_and_is_optional(correction: Correction, tmp_path: Path) -> None:
    clay = UniformClay()
    assert corrected(clay, tmp_path) is clay
    (tmp_path / FILE).write_text(json.dumps(correction_as_json(correction)))
    again = read_correction(tmp_path / FILE)
    height = np.full((PIXELS, PIXELS), 0.04, np.float32)
    actions = np.array([[0.05, 0.07, 0.4, 0.02, 0.006]])
    assert np.array_equal(again.planned(height, WINDOW_M, actions), correction.planned(height, WINDOW_M, actions))
    assert isinstance(corrected(clay, tmp_path), CorrectedClay)


def test_rejects_invalid_correction_file(tmp_path: Path) -> None:
    (tmp_path / FILE).write_text("{}")
    with pytest.raises(ContractError, match="not the correction"):
        corrected(UniformClay(), tmp_path)


def test_split_hidden_removes_only_hidden_causes() -> None:
    scene = scene_of(blank(12, 1), HALF_WIDTH_M)
    base = first_model(scene)
    swell, backlash = (identity(kind, scene) for kind in (FarField, ToolBacklash))
    assert split_hidden(base.plus(swell), lambda model: model) is None
    both = split_hidden(base.plus(swell, backlash), lambda model: model)
    assert both is not None
    assert [len(model.mechanisms) for model in both] == [2, 1]


def test_a_covariate_is_never_extrapolated() -> None:
    known = Range(10.0, 20.0, 40.0)
    assert [known.expected(value) for value in (None, float("nan"), 5.0, 30.0, 90.0)] == [20.0, 20.0, 10.0, 30.0, 40.0]
