import numpy as np
import pytest
from numpy.testing import assert_allclose

from pentimento.studio.clay.plough import SECTORS, bearing, heap
from tests.studio.clay.clay_worlds import Array

CELL_M = 0.001


def heaped(forward: float, groove: tuple[slice, slice] | None = None, at: float = 29.5) -> Array:
    """What one metre times cells leaves [60,60] around a round contact of 6 mm, heading to the right."""
    pre = np.full((60, 60), 0.04)
    height = pre.copy()
    if groove is not None:
        height[groove] -= 0.01
    cut = height.copy()
    left = heap(height, pre, at, 29.5, np.array([1.0, 0.0]), np.full(SECTORS, 0.006), CELL_M, 0.004, forward, 1.0)
    assert left == 0.0
    return height - cut


def test_heap_keeps_the_volume_outside_the_contact() -> None:
    change = heaped(0.0)
    row, column = np.mgrid[:60, :60] - 29.5
    assert_allclose(change.sum(), 1.0)
    assert np.all(change[np.hypot(row, column) < 6.0] == 0.0)
    assert_allclose(change, change[::-1], atol=1e-12)
    assert_allclose(change, change.T, atol=1e-12)


def test_moving_tool_heaps_material_ahead_and_beside() -> None:
    change = heaped(1.0)
    assert change[:, 36:].sum() > 5 * change[:, :24].sum()
    assert change[18:22, 29:31].sum() > 0


def test_a_groove_stays_open() -> None:
    groove = (slice(26, 34), slice(0, 25))
    assert heaped(0.0, groove)[groove].sum() < 0.01 * heaped(0.0)[groove].sum()


def test_heap_at_the_wall_stays_in_the_tray() -> None:
    assert_allclose(heaped(0.5, at=1.0).sum(), 1.0)


def test_what_finds_no_place_is_said() -> None:
    tiny = np.full((3, 3), 0.04)
    contact = np.full(SECTORS, 0.006)
    assert heap(tiny, tiny.copy(), 1.0, 1.0, np.array([1.0, 0.0]), contact, CELL_M, 0.004, 0.5, 2.0) == 2.0


@pytest.mark.parametrize(("along", "across", "sector"), [(1.0, 0.0, SECTORS / 2), (0.0, 1.0, 3 * SECTORS / 4)])
def test_sectors_count_from_behind(along: float, across: float, sector: float) -> None:
    assert bearing(along, across) == pytest.approx(sector)
