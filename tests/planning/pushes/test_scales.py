"""Plans for scans of another resolution: what is computed on the model's grid equals what the scan's own grid gives."""

from dataclasses import replace

import numpy as np
import pytest

from pentimento.planning.objectives import ClayObjective, Weights
from pentimento.planning.pushes.plan import plan
from pentimento.planning.pushes.rollout import EnsembleRollout
from pentimento.planning.pushes.scales import (
    ScanObjective,
    Spread,
    area_means,
    interpolation,
    plan_for_scan,
    resampled,
)
from tests.planning.pushes.clay import SIDE_PX, SURFACE_M, WINDOW_M, PressedClay
from tests.planning.pushes.settings import CONFIG, REACH

GRID = (SIDE_PX, SIDE_PX)
FINE = (4 * SIDE_PX, 4 * SIDE_PX)
PUSHES = np.array([[0.03, 0.03, 0.5, 0.025, 0.006], [0.07, 0.06, 2.5, 0.02, 0.005]])
BOTH = Weights(1.0, 4.0)


def rough(shape: tuple[int, int], seed: int = 0) -> np.ndarray:
    return (SURFACE_M + np.random.default_rng(seed).normal(0, 6e-5, shape)).astype(np.float32)


def pressed(height_m: np.ndarray, actions: np.ndarray = PUSHES) -> np.ndarray:
    """The clay after pushes, in the tests' model on the map's own pixels."""
    for action in actions:
        height_m = PressedClay().after(height_m, action[None])[0]
    return height_m


def scan_objective(shape: tuple[int, int], weights: Weights = BOTH, grid: tuple[int, int] = GRID):  # type: ignore[no-untyped-def]
    """The objective of a scan, the scan, and the same for clay on the model's grid with where it starts."""
    of_scan, scan = ClayObjective(pressed(np.full(shape, SURFACE_M, np.float32)), WINDOW_M, weights), rough(shape, 1)
    start = resampled(scan, grid)
    return of_scan, scan, ScanObjective(of_scan, scan, start), start


@pytest.mark.parametrize("wanted", [(128, 128), (48, 96), (100, 37), (192, 192), (300, 211)])
def test_resampling_keeps_the_mean_height(wanted: tuple[int, int]) -> None:
    scan = rough((192, 192)) + np.linspace(0, 0.01, 192, dtype=np.float32)
    assert resampled(scan, wanted).mean(dtype=np.float64) == pytest.approx(scan.mean(dtype=np.float64), abs=2e-9)


def test_resampling_keeps_the_place_of_a_slope() -> None:
    """A plane is a plane on every grid, so that nothing is displaced by a part of a pixel."""
    fine, coarse = ((np.arange(side) + 0.5) / side for side in (192, 48))

    def plane(along: np.ndarray) -> np.ndarray:
        return (0.04 + 0.01 * along[:, None] - 0.02 * along[None]).astype(np.float32)

    np.testing.assert_allclose(resampled(plane(fine), GRID), plane(coarse), atol=2e-8)
    inner = slice(2, -2)  # beyond the outermost centres, the finer map is level
    np.testing.assert_allclose(resampled(plane(coarse), (192, 192))[inner, inner], plane(fine)[inner, inner], atol=2e-8)


@pytest.mark.parametrize(("fine", "coarse"), [(512, 128), (48, 48), (50, 48), (37, 8)])
def test_weights_of_each_pixel_sum_to_one(fine: int, coarse: int) -> None:
    np.testing.assert_allclose(area_means(fine, coarse).sum(axis=1), 1.0)
    np.testing.assert_allclose(area_means(fine, coarse).sum(axis=0), coarse / fine)
    np.testing.assert_allclose(interpolation(coarse, fine).sum(axis=1), 1.0)


@pytest.mark.parametrize("shape", [FINE, (70, 50), (30, 200)])
def test_a_change_added_in_its_window_equals_one_added_to_the_whole_map(shape: tuple[int, int]) -> None:
    spread, change, height = Spread(GRID, shape), np.zeros(GRID, np.float32), rough(shape)
    change[11:23, 30:] = np.random.default_rng(2).normal(0, 1e-3, (12, 18))
    whole = height + spread.rows @ change @ spread.columns.T
    spread.add(height, change)
    np.testing.assert_allclose(height, whole, atol=1e-8)
    spread.add(height, np.zeros(GRID, np.float32))
    np.testing.assert_allclose(height, whole, atol=1e-8)


@pytest.mark.parametrize("shape", [FINE, (50, 50), (40, 40)])
def test_the_scan_s_objective_on_the_model_s_grid_is_that_of_the_spread_map(shape: tuple[int, int]) -> None:
    of_scan, scan, objective, start = scan_objective(shape)
    predicted = np.stack([start, pressed(start, PUSHES[:1]), pressed(start)])
    maps = Spread(GRID, shape).maps(scan, predicted)
    np.testing.assert_allclose(objective.error_3d_mm2(predicted), of_scan.error_3d_mm2(maps), rtol=1e-4)
    np.testing.assert_allclose(objective.visual_error(predicted), of_scan.visual_error(maps), rtol=1e-4)
    np.testing.assert_allclose(objective.values(predicted), of_scan.values(maps), rtol=1e-4)
    assert objective(predicted[2])[0] == pytest.approx(float(of_scan.values(maps[2])), rel=1e-4)


@pytest.mark.parametrize("weights", [BOTH, Weights(1.0, 0.0), Weights(0.0, 1.0)])
def test_values_from_windows_equal_those_of_whole_maps(weights: Weights) -> None:
    of_scan, _, on_grid, start = scan_objective(FINE, weights)
    rng = np.random.default_rng(3)
    for objective, before in ((of_scan, rough(FINE, 4)), (on_grid, pressed(start, PUSHES[:1]))):
        after = np.repeat(before[None], 5, axis=0)
        height, width = before.shape
        for number, part in enumerate(
            ((0, 6, 0, 9), (height - 3, height, 20, width), (10, 30, 5, 40), (0, height, 0, width))
        ):
            after[number, part[0] : part[1], part[2] : part[3]] += rng.normal(
                0, 1e-3, (part[1] - part[0], part[3] - part[2])
            )
        np.testing.assert_allclose(objective.values_from(before, after), objective.values(after), rtol=2e-5)
    assert len(of_scan.values_from(rough(FINE), np.zeros((0, *FINE), np.float32))) == 0


def test_gradient_at_512_pixels_agrees_with_finite_differences() -> None:
    _, _, objective, start = scan_objective((512, 512), grid=(128, 128))
    _, gradient = objective(start)
    way = np.random.default_rng(5).normal(0, 1e-5, start.shape)
    low, high = (float(objective.values(start.astype(np.float64) + sign * way)) for sign in (-1, 1))
    assert 0.5 * (high - low) == pytest.approx(float((gradient * way).sum()), rel=1e-4)
    foresight = EnsembleRollout([PressedClay()], objective, 0.0)
    off = PUSHES + np.array([0.003, -0.002, 0.2, -0.004, -0.002])
    _, of_actions = foresight.value_and_gradient(start, off)
    step = np.random.default_rng(6).normal(0, 1, off.shape) * [1e-4, 1e-4, 1e-2, 1e-4, 1e-4]
    low, high = (foresight.value(foresight.roll_out(start, off + sign * step)) for sign in (-1, 1))
    assert 0.5 * (high - low) == pytest.approx(float((of_actions * step).sum()), rel=0.02)


def test_a_plan_for_a_scan_is_what_the_model_on_the_scan_s_own_pixels_predicts() -> None:
    """Within 0.05 mm (rms, the scan's noise) over a depth of 6 mm, and within 2 % of the error that it leaves."""
    of_scan = ClayObjective(pressed(np.full(FINE, SURFACE_M, np.float32)), WINDOW_M, BOTH)
    scan = rough(FINE)
    made = plan_for_scan(
        scan, EnsembleRollout([PressedClay()], of_scan, 0.0), REACH, grid=GRID, config=CONFIG, count=4, item=(0,)
    )
    assert len(made.actions) >= 2 and made.predicted_m.shape == (len(made.actions) + 1, *FINE)
    np.testing.assert_array_equal(made.predicted_m[0], scan)
    np.testing.assert_allclose(made.values, of_scan.values(made.predicted_m), rtol=1e-4)
    on_its_pixels = pressed(scan, made.actions)
    assert np.sqrt(np.square(made.predicted_m[-1] - on_its_pixels).mean()) < 5e-5
    left, before = float(of_scan.values(on_its_pixels)), float(of_scan.values(scan))
    assert left < 0.5 * before and abs(made.values[-1] - left) < 0.02 * before


def test_a_scan_on_the_model_s_grid_is_planned_on_as_it_is() -> None:
    scan = rough(GRID)
    foresight = EnsembleRollout([PressedClay()], ClayObjective(pressed(scan), WINDOW_M, BOTH), 0.0)
    config = replace(CONFIG, iterations=1)
    one = plan(scan, foresight, REACH, config=config, count=2, item=(0,))
    other = plan_for_scan(scan, foresight, REACH, grid=GRID, config=config, count=2, item=(0,))
    np.testing.assert_array_equal(one.actions, other.actions)
    np.testing.assert_array_equal(one.predicted_m, other.predicted_m)


def test_a_coarser_scan_is_planned_on_the_model_s_grid() -> None:
    shape = (24, 24)
    of_scan = ClayObjective(pressed(np.full(shape, SURFACE_M, np.float32)), WINDOW_M, BOTH)
    made = plan_for_scan(
        rough(shape),
        EnsembleRollout([PressedClay()], of_scan, 0.0),
        REACH,
        grid=GRID,
        config=CONFIG,
        count=3,
        item=(0,),
    )
    assert made.predicted_m.shape[1:] == shape and made.values[-1] < 0.5 * made.values[0]
