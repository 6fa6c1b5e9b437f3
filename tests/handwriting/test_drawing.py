"""Marks of paths agree with those of Bézier strokes of the same paths, and so do gradients."""

import numpy as np
import pytest

from pentimento.dynamics.strokes.extended import base_model
from pentimento.handwriting.drawing import TorchPathBrush
from pentimento.planning.strokes.brush import Marks
from pentimento.planning.strokes.memory import commanded
from pentimento.robots.tools import load_tool
from tests.planning.strokes.scenes import PARAMETERS, POINTS, strokes_at


def test_path_marks_agree_with_bezier_marks() -> None:
    tool = load_tool("round_brush")
    brush = TorchPathBrush(base_model(PARAMETERS), tool, POINTS)
    strokes = strokes_at((0.04, 0.03), (0.06, 0.05))
    known, pull_known = brush.marks(strokes, {})
    found, pull = brush.path_marks(commanded(strokes, tool, POINTS), strokes.color, {})
    for one, other in zip(known[:5], found[:5], strict=True):
        np.testing.assert_allclose(one, other, atol=1e-6)
    assert found.pickup is None
    rng = np.random.default_rng(0)
    cotangent = Marks(*(rng.normal(size=a.shape).astype(np.float32) for a in found[:5]), None)
    (of_path, of_color), of_strokes = pull(cotangent), pull_known(cotangent)
    np.testing.assert_allclose(of_color, of_strokes.color, rtol=1e-4)
    assert of_path.shape == (2, POINTS, 5)
    np.testing.assert_allclose(of_path[..., 1:3].sum(1), of_strokes.middle_m, rtol=1e-4)  # a path is moved as a whole
    turned = of_path[..., 2] * (found_x(strokes) - strokes.middle_m[:, :1])
    assert np.isfinite(turned).all()


def found_x(strokes: object) -> np.ndarray:
    return strokes.paths(POINTS)[..., 1]  # type: ignore[attr-defined]


@pytest.mark.parametrize("value", [0.3])
def test_path_gradient_agrees_with_finite_differences(value: float) -> None:
    tool = load_tool("round_brush")
    brush = TorchPathBrush(base_model(PARAMETERS), tool, POINTS)
    strokes = strokes_at((0.04, 0.03))
    path = commanded(strokes, tool, POINTS)
    weights = np.full_like(brush.path_marks(path, strokes.color, {})[0].radius_m, value)
    marks, pull = brush.path_marks(path, strokes.color, {})
    zero = Marks(*(np.zeros_like(a) for a in marks[:5]), None)
    gradient, _ = pull(zero._replace(radius_m=weights))
    moved = path.copy()
    moved[0, 4, 3] -= 1e-4
    change = (brush.path_marks(moved, strokes.color, {})[0].radius_m - marks.radius_m).sum() * value
    assert change == pytest.approx(-1e-4 * gradient[0, 4, 3], rel=1e-2)
