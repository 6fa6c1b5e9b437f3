"""The painting's recording on disk: rows of the `strokes` contract, a shard a batch, whole after every stroke."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from pentimento.calibration.observe import CameraCalibration, rectify
from pentimento.collection.record import record_stroke
from pentimento.contracts.atomic import atomic_write
from pentimento.contracts.frames import image_shape, snap_window, window_around
from pentimento.contracts.photo import Photo
from pentimento.contracts.schema import arrow_schema
from pentimento.contracts.strokes import CONTRACT
from pentimento.control.execute import ExecutedStroke, Session
from pentimento.robots.tools import Tool

PIXELS_PER_M = 2000.0
MARGIN_M = 0.012
"""Paper round each stroke's path that its photographs show."""


class Recording:
    """Rows of one session, in a folder that may hold other sessions' shards."""

    def __init__(
        self, folder: Path, shard: int, session: Session, tool: Tool, canvas_size_m: tuple[float, float]
    ) -> None:
        self._folder, self._session, self._tool, self._canvas_size_m = folder, session, tool, canvas_size_m
        self._rows: list[dict[str, Any]] = []
        self.shard = shard
        """Number of the file that is being written."""

    def add(self, number: int, made: ExecutedStroke, before: Photo, after: Photo, camera: CameraCalibration) -> None:
        """Write the stroke, the painting's ``number``-th, with the others of its batch. Raises OSError."""
        canvas = np.array([0.0, 0.0, *self._canvas_size_m])
        window = snap_window(window_around(made.event.path, MARGIN_M), canvas, image_shape(canvas, PIXELS_PER_M))
        shown, shown_after = (rectify(photo, camera, window, PIXELS_PER_M) for photo in (before, after))
        row = record_stroke(
            self._session, number, number, self._tool, made, window, shown, shown_after, before, after, camera
        )
        # Before it is written, so that a disk that is full leaves the batch as it was.
        rows = [
            *self._rows,
            row | {"surface_id": "sheet_0", "tool_id": f"{self._tool.name}_0", "camera_id": "camera_0"},
        ]
        table = pa.Table.from_pylist(rows, schema=arrow_schema(CONTRACT, include_optional=set(rows[0])))
        written = io.BytesIO()
        pq.write_table(table, written, compression="zstd")
        atomic_write(self._folder / f"part-{self.shard:05d}.parquet", written.getvalue())
        self._rows = rows

    def next_batch(self) -> None:
        """The next row begins another shard, if this one has any."""
        if self._rows:
            self._rows, self.shard = [], self.shard + 1
