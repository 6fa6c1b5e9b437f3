"""The pictures in a painting's folder, which its page shows."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.frames import canvas_to_pixel
from pentimento.contracts.images import write_png
from pentimento.contracts.plan import PlannedStroke
from pentimento.control.checkpoint import PaintingState
from pentimento.control.painter import PaintContext, as_picture, commands, predict_canvas
from pentimento.planning.strokes.memory import Start

Picture = NDArray[np.uint8]

GOAL: Final = "goal.png"
GOALS: Final = "goals"
"""Folder of the goals to choose from, ``1.png`` and so on."""
PLAN: Final = "plan.png"
"""The finished painting as predicted by the first plan."""
CANVAS: Final = "canvas.png"
"""The canvas as observed last."""
PREVIEW: Final = "preview.png"
"""The finished painting as predicted now."""
PHOTOGRAPH: Final = "painting.png"
"""The canvas as photographed last, enlarged to be looked at."""
NEXT: Final = "next.png"
"""The next strokes, drawn over the canvas."""

_MIN_SIDE: Final = 800
"""Pixels of the photograph's shorter side, at least."""
_ENLARGED: Final = 3
_SUBPIXEL_BITS: Final = 4  # binary places of OpenCV's coordinates
_LINE = (214, 40, 57)  # sRGB
_DOT = (20, 90, 160)


def draw_strokes(canvas: Picture, strokes: Sequence[PlannedStroke], canvas_size_m: tuple[float, float]) -> Picture:
    """The canvas [H, W, 3], enlarged three times and paler, with each stroke as a line that begins with a dot."""
    height, width = canvas.shape[:2]
    large = cv2.resize(canvas, (_ENLARGED * width, _ENLARGED * height), interpolation=cv2.INTER_LINEAR)
    picture = np.ascontiguousarray(127 + large // 2)
    window, scale = (0.0, 0.0, *canvas_size_m), picture.shape[1] / canvas_size_m[0]
    for stroke in strokes:
        places = canvas_to_pixel(stroke.path[:, 1:3], window, scale)
        fixed = np.rint(places * 2**_SUBPIXEL_BITS).astype(np.int32)
        cv2.polylines(picture, [fixed.reshape(-1, 1, 2)], False, _LINE, 2, cv2.LINE_AA, _SUBPIXEL_BITS)
        column, row = (int(value) for value in fixed[0])
        cv2.circle(picture, (column, row), 5 << _SUBPIXEL_BITS, _DOT, -1, cv2.LINE_AA, _SUBPIXEL_BITS)
    return np.asarray(picture, dtype=np.uint8)


def enlarged(picture: Picture) -> Picture:
    """A picture [H, W, 3] with sides that are a multiple of its own, the shorter one of at least 800 pixels."""
    times = -(-_MIN_SIDE // min(picture.shape[:2]))
    return np.asarray(cv2.resize(picture, None, fx=times, fy=times, interpolation=cv2.INTER_CUBIC), dtype=np.uint8)


def write_pictures(folder: Path, context: PaintContext, state: PaintingState, count: int) -> None:
    """Write the pictures of the canvas, the goal, the predicted painting and the next ``count`` strokes."""
    start = Start(state.memory, state.clock_s, state.executed)
    next_strokes = commands(context, state.remaining.pick(slice(0, count)))
    write_png(folder / CANVAS, state.canvas)
    write_png(folder / GOAL, state.goal)
    write_png(folder / PREVIEW, as_picture(predict_canvas(context, state.remaining, state.canvas, start)))
    write_png(folder / NEXT, draw_strokes(state.canvas, next_strokes, context.canvas_size_m))
