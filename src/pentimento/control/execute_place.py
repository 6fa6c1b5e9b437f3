"""Executing planned pellets: a place becomes a pellet on the surface as scanned, then a row of the `pushes` table."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.height_maps import surface_at_m
from pentimento.contracts.observations import Scan
from pentimento.contracts.pushes import PLACE
from pentimento.control.execute import Session
from pentimento.control.execute_push import levelled_m, scans_of_row
from pentimento.robots.driver import Place, SculptingRobot
from pentimento.robots.tools import Feeder

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ExecutedPlace:
    """One placed pellet."""

    place: Place
    before: Scan
    after: Scan
    t_start_s: float
    """The robot's clock at its start."""
    ambient: dict[str, float]
    """Readings of the room's sensors at its start."""


def execute_place(robot: SculptingRobot, feeder: Feeder, place: FloatArray, before: Scan) -> ExecutedPlace:
    """Set one pellet, float64[3] x_m, y_m, volume_m3, on the surface in `before`, then scan.

    Raises:
        ContractError: the place lies outside the scan or in a hole of it.
    """
    x_m, y_m, volume_m3 = (float(value) for value in place)
    surface_m = surface_at_m(levelled_m(before), before.window_m, x_m, y_m)
    pellet = Place(x_m, y_m, volume_m3, surface_m, feeder.press_m(volume_m3))
    ambient, t_start_s = robot.ambient(), robot.clock_s
    robot.place(pellet)
    return ExecutedPlace(pellet, before, robot.scan(), t_start_s, ambient)


def record_place(
    session: Session, order: int, action_id: int, *, feeder: Feeder, material: str, executed: ExecutedPlace
) -> dict[str, Any]:
    """One row of the `pushes` contract as Python values, with the room's covariates as further columns.

    Raises ContractError if the two scans differ in shape or window.
    """
    place = executed.place
    return {
        "session": session.name,
        "order": order,
        "action_id": action_id,
        "tool": feeder.name,
        "material": material,
        "kind": PLACE,
        "action": [place.x_m, place.y_m, 0.0, 0.0, 0.0],
        "volume_m3": place.volume_m3,
        **scans_of_row(executed.before, executed.after, session),
        "t_start_s": executed.t_start_s - session.started_s,
        **executed.ambient,
    }
