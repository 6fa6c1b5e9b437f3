"""Executes the design of a simulated world of pushes and records it in the `pushes` contract, as the pipeline does."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pentimento.collection.pushes import PushCollectionConfig, collect_pushes
from pentimento.contracts.height_maps import encode_height_png
from pentimento.contracts.pushes import CONTRACT
from pentimento.contracts.schema import arrow_schema
from pentimento.control.execute_push import HEIGHT_PER_UNIT_M
from pentimento.robots.driver import Push
from pentimento.robots.virtual import VirtualSculptingRobot
from pentimento.studio.clay.studio import ClayStudio
from pentimento.studio.clay.world import ClayWorld
from studies.blind.decoys import draw_decoys
from studies.blind.pushes.worlds import Sketch

RECORDED = ("temperature_c", "humidity")
"""Readings of the room's sensors; there are no decoys of these names."""


def recorded_rows(sketch: Sketch, world: ClayWorld, seed: int) -> list[dict[str, Any]]:
    """Rows of the sketch's design in a world under a seed."""
    return _collected(VirtualSculptingRobot(_studio(sketch, world, seed)), sketch, sketch.config)


def rows_with_and_without(
    sketch: Sketch, world: ClayWorld, seed: int, config: PushCollectionConfig
) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Rows of a design executed in a world under a seed, and their counterfactual rows.

    These have the result of each push on the same surface and with the same random numbers in the sketch's world
    without effects.
    """
    robot = _WithCounterfactuals(_studio(sketch, world, seed), _scanned(sketch, sketch.world))
    loud = _collected(robot, sketch, config)
    quiet = [
        row | {"after": {"bytes": encode_height_png(height_m, HEIGHT_PER_UNIT_M), "path": None}}
        for row, height_m in zip(loud, robot.quiet_m, strict=True)
    ]
    return loud, quiet


class _WithCounterfactuals(VirtualSculptingRobot):
    """A robot that executes each push in another world first, on a copy of the current material."""

    def __init__(self, studio: ClayStudio, other: ClayWorld) -> None:
        super().__init__(studio)
        self._other = other
        self.quiet_m: list[NDArray[np.float64]] = []
        """Height scanned after each push in the other world [H, W]."""

    def push(self, push: Push) -> NDArray[np.float64]:
        counterfactual = VirtualSculptingRobot(self._studio.in_world(self._other))
        counterfactual.push(push)
        self.quiet_m.append(counterfactual.scan().height_m)
        return super().push(push)


def _studio(sketch: Sketch, world: ClayWorld, seed: int) -> ClayStudio:
    return ClayStudio(_scanned(sketch, world), seed)


def _scanned(sketch: Sketch, world: ClayWorld) -> ClayWorld:
    return replace(world, scanner=replace(world.scanner, pixels=sketch.config.scan_pixels))


def _collected(robot: VirtualSculptingRobot, sketch: Sketch, config: PushCollectionConfig) -> list[dict[str, Any]]:
    return collect_pushes(robot, sketch.tool, robot.material_name, config, lambda name, value, step: None)


def as_table(rows: list[dict[str, Any]], columns: dict[str, NDArray[np.float64]]) -> pa.Table:
    """Rows as a table of the contract, with the room's readings and additional columns [rows]."""
    known = {column.name for column in CONTRACT.columns}
    table = pa.Table.from_pylist(rows, schema=arrow_schema(CONTRACT, include_optional=known & set(rows[0])))
    room = {name: np.array([row[name] for row in rows]) for name in rows[0] if name not in known}
    for name, values in (room | columns).items():
        table = table.append_column(name, pa.array(values.astype(np.float32)))
    return table


def decoys(rows: int, seed: int) -> dict[str, NDArray[np.float64]]:
    """Columns that no hidden cause depends on, each float64[rows]."""
    return {name: values for name, values in draw_decoys(rows, seed).items() if name not in RECORDED}
