"""The robot presses a blind world's design and records it in the `pushes` contract, as the pipeline does."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pentimento.contracts.pushes import CONTRACT
from pentimento.contracts.schema import arrow_schema
from pentimento.robots.sculpting_virtual import VirtualSculptingRobot
from pentimento.runner.collect_pushes import collect_pushes
from pentimento.studio.clay.studio import ClayStudio
from pentimento.studio.clay.world import ClayWorld
from studies.blind.decoys import draw_decoys
from studies.blind_pushes.worlds import Sketch

RECORDED = ("temperature_c", "humidity")
"""What the room's own sensors say: no decoys of these names."""


def recorded_rows(sketch: Sketch, world: ClayWorld, seed: int, pushes: int | None = None) -> list[dict[str, Any]]:
    """Rows of the sketch's design in a world under a seed; `pushes` makes a shorter design without repeats."""
    config = sketch.config
    if pushes is not None:
        config = replace(config, pushes=pushes, repeated=0, times=1)
    scanner = replace(world.scanner, pixels=config.scan_pixels)
    robot = VirtualSculptingRobot(ClayStudio(replace(world, scanner=scanner), seed))
    return collect_pushes(robot, sketch.tool, world.material.name, config, lambda name, value, step: None)


def as_table(rows: list[dict[str, Any]], columns: dict[str, NDArray[np.float64]]) -> pa.Table:
    """Rows as a table of the contract, with the room's columns and further ones [rows] beside it."""
    known = {column.name for column in CONTRACT.columns}
    table = pa.Table.from_pylist(rows, schema=arrow_schema(CONTRACT, include_optional=known & set(rows[0])))
    room = {name: np.array([row[name] for row in rows]) for name in rows[0] if name not in known}
    for name, values in (room | columns).items():
        table = table.append_column(name, pa.array(values.astype(np.float32)))
    return table


def decoys(rows: int, seed: int) -> dict[str, NDArray[np.float64]]:
    """Columns that tell nothing."""
    return {name: values for name, values in draw_decoys(rows, seed).items() if name not in RECORDED}
