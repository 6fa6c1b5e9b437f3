"""Executing planned pushes: an action becomes a push into the surface as scanned, then a row of the `pushes` table."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.errors import ContractError
from pentimento.contracts.height_maps import encode_height_png, level, surface_at_m
from pentimento.contracts.observations import Scan
from pentimento.control.execute import Session
from pentimento.robots.driver import Push, SculptingRobot
from pentimento.robots.tools import EndEffector

FloatArray = NDArray[np.float64]

HEIGHT_PER_UNIT_M = 1e-6
"""One unit of the recorded height maps: a micrometre, so that 16 bits reach 65 mm."""


@dataclass(frozen=True, eq=False)
class ExecutedPush:
    """One executed push."""

    push: Push
    before: Scan
    after: Scan
    t_start_s: float
    """The robot's clock at its start."""
    measured_path: FloatArray
    """[N, 5] as the robot measured it; NaN where it did not."""
    ambient: dict[str, float]
    """Readings of the room's sensors at its start."""


def levelled_m(scan: Scan) -> FloatArray:
    """Heights above the table [H, W] of a scan; unchanged where the table's plane is unknown."""
    if np.isnan(scan.table_plane).all():
        return scan.height_m
    return level(scan.height_m, scan.window_m, scan.table_plane)


def aimed_push(
    end_effector: EndEffector,
    action: FloatArray,
    before: Scan,
    *,
    speed_m_s: float,
    dwell_s: float,
    retract_speed_m_s: float,
) -> Push:
    """The push of an action, float64[5], whose depth counts from the surface at its start, as scanned in `before`.

    Raises:
        ContractError: the start lies outside the scan or in a hole of it.
    """
    surface_m = surface_at_m(levelled_m(before), before.window_m, float(action[0]), float(action[1]))
    return Push(end_effector.kind, action, surface_m, speed_m_s, dwell_s, retract_speed_m_s)


def execute_push(
    robot: SculptingRobot,
    end_effector: EndEffector,
    action: FloatArray,
    before: Scan,
    *,
    speed_m_s: float,
    dwell_s: float,
    retract_speed_m_s: float,
) -> ExecutedPush:
    """Execute one push from the surface in `before`, then scan.

    Raises:
        ContractError: the start lies outside the scan or in a hole of it.
    """
    push = aimed_push(
        end_effector, action, before, speed_m_s=speed_m_s, dwell_s=dwell_s, retract_speed_m_s=retract_speed_m_s
    )
    ambient, t_start_s = robot.ambient(), robot.clock_s
    measured = robot.push(push)
    return ExecutedPush(push, before, robot.scan(), t_start_s, measured, ambient)


def record_push(
    session: Session,
    order: int,
    action_id: int,
    *,
    end_effector: EndEffector,
    material: str,
    executed: ExecutedPush,
) -> dict[str, Any]:
    """One row of the `pushes` contract as Python values, with the room's covariates as further columns.

    What was not measured is null. The caller adds what it knows, such as reset_id and tool_id.

    Raises ContractError if the two scans differ in shape or window.
    """
    push = executed.push
    return {
        "session": session.name,
        "order": order,
        "action_id": action_id,
        "tool": end_effector.name,
        "material": material,
        "kind": push.kind,
        "action": [float(value) for value in push.action],
        "speed_m_s": push.speed_m_s,
        "retract_speed_m_s": push.retract_speed_m_s,
        "dwell_s": push.dwell_s,
        **scans_of_row(executed.before, executed.after, session),
        "t_start_s": executed.t_start_s - session.started_s,
        **executed.ambient,
    }


def scans_of_row(before: Scan, after: Scan, session: Session) -> dict[str, Any]:
    """The scans before and after an action as columns of the `pushes` contract.

    Raises ContractError if they differ in shape or window.
    """
    if before.height_m.shape != after.height_m.shape or not np.allclose(before.window_m, after.window_m):
        raise ContractError(
            f"The scan before is {before.height_m.shape} over {before.window_m} m and after "
            f"{after.height_m.shape} over {after.window_m} m; scan both with one shape and window."
        )
    return {
        "window_m": [float(value) for value in before.window_m],
        "before": {"bytes": encode_height_png(before.height_m, HEIGHT_PER_UNIT_M), "path": None},
        "after": {"bytes": encode_height_png(after.height_m, HEIGHT_PER_UNIT_M), "path": None},
        "height_per_unit_m": HEIGHT_PER_UNIT_M,
        "t_before_s": before.t_s - session.started_s,
        "t_after_s": after.t_s - session.started_s,
        "table_plane": [float(value) for value in after.table_plane],
        "scanner_id": before.scanner_id,
    }
