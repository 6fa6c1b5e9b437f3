"""Self-generated pushes: the robot presses into its own clay by design and scans it before and after (thesis 7.3.4)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pentimento.collection.push_design import PushCollectionConfig, design_pushes
from pentimento.control.execute import Session
from pentimento.control.execute_push import execute_push, levelled_m, record_push
from pentimento.robots.end_effectors import EndEffector
from pentimento.robots.sculpting import SculptingRobot

FloatArray = NDArray[np.float64]


def collect_pushes(
    robot: SculptingRobot,
    end_effector: EndEffector,
    material: str,
    config: PushCollectionConfig,
    log: Callable[[str, float, int], None],
) -> list[dict[str, Any]]:
    """Make the pushes of ``design_pushes``; rows of the ``pushes`` contract in their order.

    ``log("change_mm2", mean squared change, i)`` is called after every push.
    """
    robot.change_tool(end_effector)
    commands = design_pushes(end_effector, robot.area_m, config)
    session = Session(f"{material}-{end_effector.name}-{config.seed}", robot.clock_s)
    rows: list[dict[str, Any]] = []
    smoothings, since, surface_m = -1, 0, float("nan")
    for order, command in enumerate(commands):
        if command.smooth:
            robot.smooth()
            smoothings, since = smoothings + 1, 0
        before = robot.scan()
        if command.smooth:
            surface_m = float(np.nanmedian(levelled_m(before)))
        executed = execute_push(
            robot,
            end_effector,
            command.action,
            before=before,
            speed_m_s=command.speed_m_s,
            dwell_s=command.dwell_s,
            retract_speed_m_s=command.retract_speed_m_s,
        )
        row = record_push(
            session, order, command.action_id, end_effector=end_effector, material=material, executed=executed
        )
        rows.append(
            row
            | {
                "surface_height_m": surface_m,
                "reset_id": smoothings,
                "pushes_since_reset": since,
                "tool_id": f"{end_effector.name}_0",
            }
        )
        since += 1
        change_mm = 1000 * (executed.after.height_m - before.height_m)
        log("change_mm2", float(np.nanmean(change_mm**2)), order)
    return rows
