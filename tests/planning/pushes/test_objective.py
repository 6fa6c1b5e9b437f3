"""Distances to a goal: closed forms, gradients, and what each of the two sees."""

import numpy as np
import pytest

from pentimento.contracts.errors import ContractError
from pentimento.planning.objectives import ClayObjective, Weights

WINDOW_M = (0.0, 0.0, 0.03, 0.02)
K = 1000.0
FLAT = np.zeros((20, 30), np.float32)


def objective(goal: np.ndarray = FLAT, error_3d: float = 1.0, visual: float = 2.0) -> ClayObjective:
    return ClayObjective(goal, WINDOW_M, Weights(error_3d, visual))


def test_offset_plane_has_3d_error_and_no_visual_error() -> None:
    raised = FLAT + np.float32(0.002)
    assert objective().error_3d_mm2(raised) == pytest.approx(4.0)
    assert objective().visual_error(raised) == pytest.approx(0.0, abs=1e-12)


def test_visual_error_of_a_tilted_plane_is_its_squared_slope() -> None:
    x, y = np.meshgrid((np.arange(30) + 0.5) / K, 0.02 - (np.arange(20) + 0.5) / K)
    assert objective().visual_error((0.3 * x - 0.1 * y).astype(np.float32)) == pytest.approx(0.09 + 0.01, rel=1e-4)


def test_thin_line_has_more_visual_than_3d_error() -> None:
    line, bowl = FLAT.copy(), FLAT.copy()
    line[:, 15] = -0.002
    bowl[:] = (-0.002 * np.sqrt(1 / 30)) * np.ones(30)
    bowl[:, :1], bowl[:, -1:] = 0, 0
    assert objective().error_3d_mm2(line) == pytest.approx(objective().error_3d_mm2(bowl), rel=0.1)
    assert objective().visual_error(line) > 5 * objective().visual_error(bowl)


def test_clay_objective_gradient_agrees_with_finite_differences() -> None:
    rng = np.random.default_rng(0)
    height, goal, way = (rng.normal(0, 1e-3, FLAT.shape) for _ in range(3))
    both = objective(goal)
    low, high = (float(both.values(height + sign * 1e-3 * way)) for sign in (-1, 1))
    value, gradient = both(height)
    assert value == pytest.approx(float(both.error_3d_mm2(height)) + 2 * float(both.visual_error(height)))
    assert (high - low) / 2e-3 == pytest.approx(float((gradient * way).sum()), rel=1e-6)


def test_clay_objective_values_of_a_stack_are_those_of_each_map() -> None:
    maps = np.random.default_rng(1).normal(0, 1e-3, (2, 3, *FLAT.shape)).astype(np.float32)
    values = objective().values(maps)
    assert values.shape == (2, 3)
    assert values[1, 2] == pytest.approx(objective()(maps[1, 2])[0])


@pytest.mark.parametrize(
    ("goal", "sentence"),
    [
        (np.full((20, 30), np.nan), "has holes"),
        (np.zeros((2, 30)), "at least 3 x 3"),
        (np.zeros((20, 60)), "must be square"),
    ],
)
def test_clay_objective_rejects_invalid_goals(goal: np.ndarray, sentence: str) -> None:
    with pytest.raises(ContractError, match=sentence):
        objective(goal)


@pytest.mark.parametrize("weights", [(0.0, 0.0), (-1.0, 2.0), (float("nan"), 1.0)])
def test_clay_weights_reject_all_zero_and_negative(weights: tuple[float, float]) -> None:
    with pytest.raises(ValueError, match="one above 0"):
        Weights(*weights)
