"""A rehearsal: the commands of a collection drawn with the tool's nominal width, before execution.

Which causes are identifiable is a property of the design (docs/diagnosis.md), and it is cheaper to change a design than
to collect again. A rehearsal has every column of the recording that follows from the commands.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import cv2
import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pentimento.collection.design import CollectionConfig, Command
from pentimento.contracts.colour import to_uint8
from pentimento.contracts.covariates import StrokeEvent, covariates_and_advance, fresh_memory, new_sheet
from pentimento.contracts.frames import canvas_to_pixel, crop, image_shape, snap_window, window_around
from pentimento.contracts.images import encode_png
from pentimento.contracts.schema import arrow_schema
from pentimento.contracts.strokes import CONTRACT
from pentimento.robots.refill import needs_dip
from pentimento.robots.tools import Tool

FloatArray = NDArray[np.float64]

_PIXELS_PER_M = 1000.0
_PAPER = 237
_BETWEEN_S = 4.0
"""Typical time of a robot to reach and photograph a stroke."""
_DIP_S = 8.0
"""Typical time to wipe and dip."""
_SHEET_S = 20.0
"""Typical time to change the sheet."""
_SUBPIXEL = 4  # binary places of cv2's coordinates
_LIGHTEST = 0.6
"""Share of the nominal width at the lightest press."""
_DEEPEST = 1.4
"""Share of the nominal width at the deepest press."""


def rehearse(
    commands: Sequence[Command], tool: Tool, canvas_size_m: tuple[float, float], config: CollectionConfig
) -> pa.Table:
    """Rows of the ``strokes`` contract for the commands, executed without error.

    Photographs show the commanded paths at the tool's nominal width, in full paint on blank sheets; times are about
    those of a robot.
    """
    canvas = np.array([0.0, 0.0, *canvas_size_m])
    shape = image_shape(canvas, _PIXELS_PER_M)
    blank = np.full((*shape, 3), _PAPER, np.uint8)
    memory, sheet, image, clock_s = fresh_memory(canvas_size_m, tool.nominal_width_m), 0, blank.copy(), 0.0
    rows: list[dict[str, Any]] = []
    for order, command in enumerate(commands):
        stroke = command.stroke
        if command.sheet != sheet:
            memory, sheet, image, clock_s = new_sheet(memory), command.sheet, blank.copy(), clock_s + _SHEET_S
        before_s, dip = clock_s, needs_dip(tool, stroke, memory, None)
        start_s = before_s + _BETWEEN_S + _DIP_S * dip
        event = StrokeEvent(stroke.path, start_s, dip, stroke.color_srgb)
        known, memory = covariates_and_advance(memory, event)
        clock_s = start_s + float(stroke.path[-1, 0]) + command.wait_s
        window = snap_window(window_around(stroke.path, config.margin_m), canvas, shape)
        before = crop(image, canvas, window).copy()
        _draw(image, stroke.path, stroke.color_srgb, tool, canvas)
        rows.append(
            {
                "session": f"{tool.name}-{config.seed}",
                "order": order,
                "action_id": command.action_id,
                "tool": tool.name,
                "path": stroke.path.tolist(),
                "window_m": [float(value) for value in window],
                "before": {"bytes": encode_png(before), "path": None},
                "after": {"bytes": encode_png(crop(image, canvas, window)), "path": None},
                "surface_id": f"sheet_{sheet}",
                "color_srgb": [float(value) for value in stroke.color_srgb],
                "t_before_s": before_s,
                "t_start_s": start_s,
                "t_after_s": clock_s,
                **known,
            }
        )
    return pa.Table.from_pylist(rows, schema=arrow_schema(CONTRACT, include_optional=set(rows[0])))


def _draw(image: NDArray[np.uint8], path: FloatArray, color_srgb: FloatArray, tool: Tool, canvas: FloatArray) -> None:
    """Lay the stroke on the sheet, discs and the lines between them."""
    light, deep = tool.press_range_m
    share = np.clip((-path[:, 3] - light) / (deep - light), 0.0, 1.0)
    width_px = tool.nominal_width_m * (_LIGHTEST + (_DEEPEST - _LIGHTEST) * share) * _PIXELS_PER_M
    fixed = np.round(canvas_to_pixel(path[:, 1:3], canvas, _PIXELS_PER_M) * 2**_SUBPIXEL).astype(int)
    color = [int(value) for value in to_uint8(color_srgb)]
    for (start, end), width in zip(pairwise(fixed), width_px[:-1], strict=True):
        line = tuple(map(int, start)), tuple(map(int, end))
        cv2.line(image, *line, color, max(round(width), 1), cv2.LINE_AA, _SUBPIXEL)
