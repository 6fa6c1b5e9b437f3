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


def test_a_raised_plane_is_wrong_in_3d_and_right_to_the_eye() -> None:
    raised = FLAT + np.float32(0.002)
    assert objective().error_3d_mm2(raised) == pytest.approx(4.0)
    assert objective().visual_error(raised) == pytest.approx(0.0, abs=1e-12)


def test_a_tilted_plane_is_wrong_to_the_eye_by_its_squared_slopes() -> None:
    x, y = np.meshgrid((np.arange(30) + 0.5) / K, 0.02 - (np.arange(20) + 0.5) / K)
    assert objective().visual_error((0.3 * x - 0.1 * y).astype(np.float32)) == pytest.approx(0.09 + 0.01, rel=1e-4)


def test_a_thin_line_is_more_to_the_eye_than_in_3d() -> None:
    line, bowl = FLAT.copy(), FLAT.copy()
    line[:, 15] = -0.002
    bowl[:] = (-0.002 * np.sqrt(1 / 30)) * np.ones(30)
    bowl[:, :1], bowl[:, -1:] = 0, 0
    assert objective().error_3d_mm2(line) == pytest.approx(objective().error_3d_mm2(bowl), rel=0.1)
    assert objective().visual_error(line) > 5 * objective().visual_error(bowl)


def test_the_gradient_is_that_of_finite_differences() -> None:
    rng = np.random.default_rng(0)
    height, goal, way = (rng.normal(0, 1e-3, FLAT.shape) for _ in range(3))
    both = objective(goal)
    low, high = (float(both.values(height + sign * 1e-3 * way)) for sign in (-1, 1))
    value, gradient = both(height)
    assert value == pytest.approx(float(both.error_3d_mm2(height)) + 2 * float(both.visual_error(height)))
    assert (high - low) / 2e-3 == pytest.approx(float((gradient * way).sum()), rel=1e-6)


def test_many_maps_have_the_values_of_each() -> None:
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
def test_goals_that_mean_nothing_are_sentences(goal: np.ndarray, sentence: str) -> None:
    with pytest.raises(ContractError, match=sentence):
        objective(goal)


@pytest.mark.parametrize("weights", [(0.0, 0.0), (-1.0, 2.0), (float("nan"), 1.0)])
def test_weights_must_ask_for_something(weights: tuple[float, float]) -> None:
    with pytest.raises(ValueError, match="one above 0"):
        Weights(*weights)
