import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from pentimento.studio.clay.plough import plough, underside_m
from tests.studio.clay.clay_worlds import Array

CELL_M = 0.001
BALL = np.array([0.008, 0.008, 0.008, 6.0, 0.0])


def ploughed(
    depth_m: float = 0.006,
    travel_m: float = 0.02,
    shape: Array = BALL,
    heading: tuple[float, float] = (1.0, 0.0),
    give: float = 0.0,
    hardness_pa: float = 2e4,
    crush: float = 0.0,
    far: float = 0.0,
) -> tuple[Array, Array, Array, Array]:
    """Change of height [80,80], plastic strain, tip's heights [M] and volumes [2] of a push through the middle."""
    pre = np.full((80, 80), 0.04)
    height, strain, volume = pre.copy(), np.zeros_like(pre), np.zeros(2)
    s = np.append(np.linspace(0, 1, 41), np.ones(6))
    way = (s - 0.5) * travel_m / CELL_M
    line = np.column_stack([39.5 + way * heading[0], 39.5 + way * heading[1], 0.04 - s * depth_m])
    tips = plough(
        height, pre, np.full_like(pre, hardness_pa), strain, line, np.array(heading), shape, CELL_M, give, 0.003,
        0.004, 0.85, crush, 0.5, far, 1.0, 6, volume,
    )  # fmt: skip
    return height - pre, strain, tips, volume


def test_the_underside_of_a_ball_is_a_sphere_up_to_its_shank() -> None:
    r = np.linspace(0, 0.97 * 0.008, 9)
    assert_allclose([underside_m(x, 0.0, BALL) for x in r], 0.008 - np.sqrt(0.008**2 - r**2))
    assert_allclose([underside_m(0.0, -x, BALL) for x in r], 0.008 - np.sqrt(0.008**2 - r**2))
    assert_allclose(underside_m(0.010, 0.0, BALL) - underside_m(0.009, 0.0, BALL), 6.0 * 0.001)


def test_a_flat_tool_is_flat_up_to_its_rounded_edge() -> None:
    flat = np.array([0.010, 0.004, 0.001, 6.0, 0.0])
    assert underside_m(0.009, 0.003, flat) == 0.0
    assert underside_m(0.0095, 0.0, flat) > 0.0
    assert underside_m(0.0, 0.0045, flat) > underside_m(0.0, 0.0035, flat) > 0.0


def test_a_rigid_tool_leaves_its_own_shape_where_it_rests() -> None:
    change, *_ = ploughed(travel_m=0.0)
    for column, row in ((39, 39), (42, 39), (39, 44)):
        distance = math.hypot(column - 39.5, row - 39.5) * CELL_M
        assert_allclose(change[row, column], underside_m(distance, 0.0, BALL) - 0.006, atol=2e-6)


@pytest.mark.parametrize("travel_m", [0.0, 0.008, 0.02])
@pytest.mark.parametrize("crush", [0.0, 0.6])
@pytest.mark.parametrize("far", [0.0, 0.3])
def test_volume_balances(travel_m: float, crush: float, far: float) -> None:
    change, _, _, volume = ploughed(travel_m=travel_m, crush=crush, far=far)
    assert -change.sum() * CELL_M**2 == pytest.approx(volume.sum(), rel=1e-9, abs=1e-18)
    assert (volume[0] > 0) == (crush > 0)
    assert (volume[1] > 0) == (far > 0)


def test_a_push_is_symmetric_about_its_way() -> None:
    change, *_ = ploughed()
    assert_allclose(change, change[::-1], atol=3e-5)  # cells on a border between sectors


def test_a_push_turned_by_a_right_angle_is_the_same_push() -> None:
    right, *_ = ploughed()
    down, *_ = ploughed(heading=(0.0, 1.0))
    assert_allclose(down, right.T, atol=2e-4)  # sectors of the contact begin at another place
    assert_allclose(np.corrcoef(down.ravel(), right.T.ravel())[0, 1], 1.0, atol=1e-3)


def test_the_groove_deepens_and_material_heaps_up_ahead_more_than_behind() -> None:
    change, *_ = ploughed()
    trough = change[39:41].mean(axis=0)
    assert np.all(np.diff(trough[32:49]) < 1e-4)
    assert change[:, 60:].max() > 3 * change[:, :24].max()
    assert np.unravel_index(change.argmin(), change.shape)[1] == pytest.approx(49.5, abs=3)


def test_a_harder_material_and_a_softer_arm_keep_the_tool_up() -> None:
    hard, soft = (ploughed(give=5e-4, hardness_pa=pa)[2][-1] for pa in (4e4, 1e4))
    stiff = ploughed(give=1e-5)[2][-1]
    assert 0.034 < stiff < soft < hard < 0.040


def test_a_soft_pad_flattens() -> None:
    pad = BALL.copy()
    pad[4] = 1.6e-7
    rigid, soft = ploughed(travel_m=0.0)[0], ploughed(travel_m=0.0, shape=pad)[0]
    assert rigid.min() < soft.min() < 0
    assert soft[39, 44] / soft[39, 39] > rigid[39, 44] / rigid[39, 39]


def test_worked_material_swallows_less() -> None:
    _, strain, _, _ = ploughed(crush=0.6)
    assert strain[39, 48] > 0.05 > strain[5, 5] == 0.0
