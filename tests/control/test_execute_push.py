from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from pentimento.contracts.errors import ContractError
from pentimento.contracts.height_maps import decode_height_m
from pentimento.contracts.observations import Scan
from pentimento.control.execute import Session
from pentimento.control.execute_push import HEIGHT_PER_UNIT_M, aimed_push, execute_push, levelled_m, record_push
from pentimento.robots.tools import load_end_effector
from pentimento.robots.virtual import virtual_sculpting_robot

BALL = load_end_effector("ball")
WINDOW = np.array([0.0, 0.0, 0.1, 0.1])
ACTION = np.array([0.05, 0.05, 0.3, 0.02, 0.006])
STEP = np.where(np.arange(50)[:, None] < 25, 0.045, 0.040) * np.ones((50, 50))


def scan(height_m: np.ndarray, plane: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Scan:
    return Scan(height_m, WINDOW, np.array(plane), "scanner", 1.0)


def test_aimed_push_depth_counts_from_the_scanned_surface() -> None:
    for y_m, surface_m in ((0.08, 0.045), (0.02, 0.040)):
        push = aimed_push(
            BALL, np.array([0.05, y_m, 0, 0.01, 0.005]), scan(STEP), speed_m_s=0.02, dwell_s=0.5, retract_speed_m_s=0.05
        )
        assert_allclose(push.surface_m, surface_m)


def test_aimed_push_levels_a_tilted_table() -> None:
    x_m = (np.arange(50) + 0.5) * 0.002
    y_m = 0.1 - (np.arange(50) + 0.5) * 0.002
    tilted = scan(0.04 + 0.02 * x_m[None, :] - 0.01 * y_m[:, None] + 0.003, (0.02, -0.01, 0.003))
    assert_allclose(levelled_m(tilted), 0.04, atol=1e-12)
    assert_allclose(
        aimed_push(BALL, ACTION, tilted, speed_m_s=0.02, dwell_s=0.0, retract_speed_m_s=0.05).surface_m, 0.04
    )
    unknown = replace(tilted, table_plane=np.full(3, np.nan))
    assert levelled_m(unknown) is unknown.height_m


def test_aimed_push_rejects_start_in_a_hole_or_outside() -> None:
    holed = STEP.copy()
    holed[14:36, 14:36] = np.nan
    with pytest.raises(ContractError, match="hole"):
        aimed_push(BALL, ACTION, scan(holed), speed_m_s=0.02, dwell_s=0.0, retract_speed_m_s=0.05)
    with pytest.raises(ContractError, match="outside"):
        aimed_push(
            BALL, ACTION + np.array([0.1, 0, 0, 0, 0]), scan(STEP), speed_m_s=0.02, dwell_s=0.0, retract_speed_m_s=0.05
        )


def test_record_push_row_has_command_and_scans() -> None:
    robot = virtual_sculpting_robot("foam", 64, seed=1)
    robot.change_tool(BALL)
    robot.wait(100.0)
    executed = execute_push(
        robot, BALL, ACTION, before=robot.scan(), speed_m_s=0.02, dwell_s=0.5, retract_speed_m_s=0.05
    )
    row = record_push(Session("s", 50.0), 3, 7, end_effector=BALL, material="foam", executed=executed)
    assert_allclose(row["action"], ACTION)
    assert (row["order"], row["action_id"], row["tool"], row["material"], row["kind"]) == (3, 7, "ball", "foam", "push")
    seen = decode_height_m(row["after"]["bytes"], row["height_per_unit_m"])
    assert_allclose(seen, executed.after.height_m, atol=HEIGHT_PER_UNIT_M)
    assert 50.0 < row["t_before_s"] <= row["t_start_s"] < row["t_after_s"]
    assert row["temperature_c"] == pytest.approx(21.5, abs=5)


def test_record_push_rejects_scans_of_different_size() -> None:
    robot = virtual_sculpting_robot("foam", 64, seed=1)
    robot.change_tool(BALL)
    executed = execute_push(
        robot, BALL, ACTION, before=robot.scan(), speed_m_s=0.02, dwell_s=0.5, retract_speed_m_s=0.05
    )
    with pytest.raises(ContractError, match="with one shape and window"):
        record_push(
            Session("s", 0.0), 0, 0, end_effector=BALL, material="foam", executed=replace(executed, before=scan(STEP))
        )
