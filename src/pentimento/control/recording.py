"""Recordings on disk: rows of the `strokes` and `pushes` contracts in shards that are complete after every action."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from pentimento.calibration.observe import CameraCalibration
from pentimento.collection.collect import record_stroke, stroke_views
from pentimento.contracts import pushes, strokes
from pentimento.contracts.atomic import atomic_write
from pentimento.contracts.frames import image_shape, snap_window, window_around
from pentimento.contracts.observations import Photo
from pentimento.contracts.schema import arrow_schema
from pentimento.control.execute import ExecutedStroke, Session
from pentimento.robots.tools import Tool

RECORD = "record"
"""Folder of a painting's recorded strokes."""
PIXELS_PER_M = 2000.0
MARGIN_M = 0.012
"""Paper around each stroke's path that its photographs show."""


class StrokeRecording:
    """Rows of one session, in a folder that may hold other sessions' shards."""

    def __init__(
        self, folder: Path, shard: int, session: Session, *, tool: Tool, canvas_size_m: tuple[float, float]
    ) -> None:
        self._folder, self._session, self._tool, self._canvas_size_m = folder, session, tool, canvas_size_m
        self._rows: list[dict[str, Any]] = []
        self.shard = shard
        """Number of the file that is being written."""

    def add(
        self, number: int, executed: ExecutedStroke, *, before: Photo, after: Photo, camera: CameraCalibration
    ) -> None:
        """Write the painting's ``number``-th stroke with the others of its batch. Raises OSError."""
        canvas = np.array([0.0, 0.0, *self._canvas_size_m])
        window = snap_window(window_around(executed.event.path, MARGIN_M), canvas, image_shape(canvas, PIXELS_PER_M))
        views = stroke_views(before, after, camera, window_m=window, pixels_per_m=PIXELS_PER_M)
        row = record_stroke(self._session, executed, views, order=number, action_id=number, tool=self._tool)
        # Written before it is kept, so that a full disk leaves the batch as it was.
        rows = [
            *self._rows,
            row | {"surface_id": "sheet_0", "tool_id": f"{self._tool.name}_0", "camera_id": "camera_0"},
        ]
        _write_shard(self._folder, self.shard, rows, arrow_schema(strokes.CONTRACT, include_optional=set(rows[0])))
        self._rows = rows

    def next_batch(self) -> None:
        """The next row begins another shard, if this one has any."""
        if self._rows:
            self._rows, self.shard = [], self.shard + 1


def remove_shards(folder: Path, shard: int) -> None:
    """Delete the files of strokes from a number on."""
    for path in folder.glob("part-*.parquet"):
        if int(path.stem.removeprefix("part-")) >= shard:
            path.unlink()


def write_push(folder: Path, row: dict[str, Any]) -> None:
    """Write a row of the ``pushes`` contract as the folder's next shard."""
    schema = arrow_schema(pushes.CONTRACT, include_optional=set(row))
    for name in sorted(row.keys() - set(schema.names)):
        schema = schema.append(pa.field(name, pa.float32()))  # covariates of the room's sensors
    _write_shard(folder, len(list(folder.glob("part-*.parquet"))), [row], schema)


def _write_shard(folder: Path, shard: int, rows: list[dict[str, Any]], schema: pa.Schema) -> None:
    content = io.BytesIO()
    pq.write_table(pa.Table.from_pylist(rows, schema=schema), content, compression="zstd")
    atomic_write(folder / f"part-{shard:05d}.parquet", content.getvalue())
