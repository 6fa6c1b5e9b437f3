import numpy as np
from numpy.testing import assert_allclose, assert_array_equal

from pentimento.studio.clay.recovery import run_off, slide
from tests.studio.clay.clay_worlds import Array

CELL_M = 0.001


def steepest(height: Array) -> float:
    return max(float(np.abs(np.diff(height, axis=axis)).max()) / CELL_M for axis in (0, 1))


def cone(slope: float) -> Array:
    row, column = np.mgrid[:41, :41] - 20
    return np.maximum(0.01 - slope * CELL_M * np.hypot(row, column), 0.0)


def test_a_steep_heap_runs_down_to_its_repose_and_keeps_its_volume() -> None:
    heap = cone(1.5)
    volume = heap.sum()
    slide(heap, np.full(heap.shape, 0.6), 1.1, CELL_M)
    assert_allclose(heap.sum(), volume, rtol=1e-12)
    assert steepest(heap) < 0.6 * 1.1 + 0.01
    assert_allclose(heap, heap[::-1], atol=4e-4)
    assert_allclose(heap, heap.T, atol=4e-4)


def test_what_is_below_the_trigger_stays() -> None:
    heap = cone(0.63)
    before = heap.copy()
    slide(heap, np.full(heap.shape, 0.6), 1.1, CELL_M)
    assert_array_equal(heap, before)


def test_slide_continues_below_the_trigger_slope() -> None:
    """Between repose and trigger a slope holds; disturbed at one place, it comes down there."""
    calm, stirred = cone(0.63), cone(0.63)
    stirred[20, 20] += 0.004
    slide(stirred, np.full(stirred.shape, 0.6), 1.1, CELL_M)
    assert np.abs(stirred - calm)[18:23, 18:23].max() > 1e-4


def test_run_off_keeps_cells_far_from_the_change() -> None:
    height = np.zeros((80, 80))
    height[20, 20] = 0.005
    height[70, 70] = 0.005
    changed = np.zeros(height.shape, np.bool_)
    changed[20, 20] = True
    run_off(height, changed, np.full(height.shape, 0.6), 1.0, CELL_M)
    assert height[20, 20] < 0.005 == height[70, 70]
    assert_allclose(height.sum(), 0.01)


def test_fine_cells_come_to_the_same_rest_as_coarse_ones() -> None:
    row, column = np.mgrid[:160, :160] - 79.5
    fine = np.maximum(0.01 - 1.5 * 0.00025 * np.hypot(row, column), 0.0)
    volume = fine.sum()
    everywhere = np.ones(fine.shape, np.bool_)
    run_off(fine, everywhere, np.full(fine.shape, 0.6), 1.1, 0.00025)
    coarse = np.maximum(0.01 - 1.5 * 0.001 * np.hypot(*(np.mgrid[:40, :40] - 19.5)), 0.0)
    run_off(coarse, everywhere[:40, :40], np.full(coarse.shape, 0.6), 1.1, 0.001)
    assert_allclose(fine.sum(), volume, rtol=1e-12)
    assert_allclose(fine.reshape(40, 4, 40, 4).mean(axis=(1, 3)), coarse, atol=5e-4)
    assert steepest(fine) * CELL_M / 0.00025 < 0.6 * 1.1 + 0.02
