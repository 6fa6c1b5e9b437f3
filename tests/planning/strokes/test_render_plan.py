"""What a plan will look like, and its gradients through all that lies between."""

from dataclasses import replace

import numpy as np
import pytest

from pentimento.planning.strokes.bezier import Strokes
from pentimento.planning.strokes.brush import Brush, Marks, Pull
from pentimento.planning.strokes.config import ExecutionNoise
from pentimento.planning.strokes.render_plan import (
    Fault,
    coverages,
    expected_fault,
    faults,
    render_and_back,
    render_plan,
)
from pentimento.planning.strokes.scene import objective_for
from tests.planning.strokes.scenes import (
    CONFIG,
    RATES,
    SIZE_M,
    WHITE,
    Array,
    brush,
    scene,
    strokes_at,
)

STEPS = (RATES.middle_m, RATES.theta_rad, RATES.length_m, RATES.bend_m, RATES.press_m, RATES.color)
"""What is a small move of each array."""


class Seen:
    """A brush in the strokes' own precision, seen by a camera that dims the right of the canvas if told to, and that
    picks up wet paint if told to."""

    def __init__(self, of: Brush, dimmed: bool, pickup: float | None) -> None:
        self._brush, self._dimmed, self._pickup = of, dimmed, pickup
        self.fitted, self.timing, self.path_points = of.fitted, of.timing, of.path_points
        self.depletion = of.depletion

    def marks(self, strokes: Strokes, inherited: dict[str, Array]) -> tuple[Marks, Pull]:
        marks, pull = self._brush.marks(strokes, inherited)
        share = None if self._pickup is None else np.full(len(strokes), self._pickup)
        fields = (*marks[:-1], share)
        return Marks(*(None if field is None else field.astype(strokes.middle_m.dtype) for field in fields)), pull

    def gain(self, places_m: Array) -> Array | None:
        return np.repeat(1 - 2 * places_m[:, :1], 3, axis=1) if self._dimmed else None


def some_strokes() -> Strokes:
    strokes = strokes_at((0.03, 0.02), (0.05, 0.03), (0.08, 0.05), (0.07, 0.05), (0.04, 0.06))
    strokes.bend_m[:] = np.linspace(-2e-3, 2e-3, len(strokes))
    strokes.color[:] = np.random.default_rng(0).uniform(0.2, 0.8, strokes.color.shape)
    return strokes


@pytest.mark.parametrize("which", range(6), ids=["middle", "theta", "length", "bend", "press", "color"])
@pytest.mark.parametrize("kind", ["plain", "dimmed", "picks_up", "fault"])
def test_plan_gradient_agrees_with_finite_differences(kind: str, which: int) -> None:
    seen = Seen(brush(), kind == "dimmed", 0.3 if kind == "picks_up" else None)
    task = replace(scene(), brush=seen, target=scene().target.astype(np.float64))
    fault = Fault(np.full((5, 1), 0.8), np.full((5, 1, 2), 1e-3)) if kind == "fault" else None
    fine = Strokes(*(array.astype(np.float64) for array in some_strokes().arrays()))
    objective, white = objective_for(task, CONFIG), WHITE.astype(np.float64)
    image, back = render_and_back(fine, white, task, fault)
    slope = back(objective(image)[1])[which]
    way = STEPS[which] * np.random.default_rng(which).standard_normal(slope.shape)
    ends = []
    for step in (-1e-6, 1e-6):
        there = fine.pick(slice(None))
        there.arrays()[which][:] += step * way
        ends.append(objective(render_plan(there, white, task, fault))[0])
    size = float(np.linalg.norm(slope) * np.linalg.norm(way))
    assert (ends[1] - ends[0]) / 2e-6 == pytest.approx(float((slope * way).sum()), abs=1e-3 * size)


def test_camera_gain_multiplies_the_picture() -> None:
    task = scene()
    dimmed = replace(task, brush=Seen(task.brush, True, None))
    strokes = some_strokes()
    plain, seen = (render_plan(strokes, WHITE, one) for one in (task, dimmed))
    x = (np.arange(60) + 0.5) / 60 * SIZE_M[0]
    np.testing.assert_allclose(seen, plain * (1 - 2 * x[:, None]), rtol=1e-5)


def test_rendering_no_strokes_keeps_the_canvas() -> None:
    none = some_strokes().pick(slice(0, 0))
    image, back = render_and_back(none, WHITE, scene())
    assert image is WHITE and all(len(gradient) == 0 for gradient in back(np.ones_like(WHITE)))


def test_faults_have_the_expected_mean() -> None:
    execution_noise, many = ExecutionNoise(0.4, 2e-3), 4000
    drawn, expected = faults(many, execution_noise, np.random.default_rng(0)), expected_fault(many, execution_noise)
    assert drawn.narrowing.min() >= 0.6 and drawn.narrowing.max() <= 1
    assert drawn.narrowing.mean() == pytest.approx(expected.narrowing.mean(), abs=0.01)
    assert drawn.shift_m.std() == pytest.approx(2e-3, rel=0.05)
    np.testing.assert_allclose(drawn.shift_m.mean((0, 1)), expected.shift_m.mean((0, 1)), atol=2e-4)


def test_fault_shift_moves_the_mark() -> None:
    stroke, away = strokes_at((0.05, 0.04)), np.array([0.01, -0.02], np.float32)
    shifted = render_plan(stroke, WHITE, scene(), Fault(np.ones((1, 1), np.float32), away[None, None]))
    there = strokes_at((0.06, 0.02))
    np.testing.assert_allclose(shifted, render_plan(there, WHITE, scene()), atol=1e-4)


def test_coverage_is_independent_of_other_strokes() -> None:
    strokes = some_strokes()
    together = coverages(strokes, scene(), 60)
    for s in range(len(strokes)):
        np.testing.assert_array_equal(coverages(strokes.pick(slice(s, s + 1)), scene(), 60)[0], together[s])
