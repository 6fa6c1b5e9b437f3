"""The replay of a painting: one HTML file that shows its photographs one after the other, turn by turn."""

from __future__ import annotations

import base64
import json
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.errors import ConfigError
from pentimento.contracts.frames import canvas_to_pixel, pixels_per_m
from pentimento.contracts.images import decode_png, read_image
from pentimento.contracts.strokes import CONTRACT
from pentimento.contracts.tables import read_table
from pentimento.control.recording import RECORD
from pentimento.control.turn import TURNS, Turn, turns_in

Picture = NDArray[np.uint8]

REPLAY: Final = "replay.html"
_QUALITY: Final = 88  # of the JPEGs


@dataclass(frozen=True, eq=False)
class Frame:
    """What a replay shows at once."""

    picture: Picture
    """uint8 sRGB [H, W, 3]"""
    caption: str


def frames_of(folder: Path) -> list[Frame]:
    """The blank sheet, the sheet after each of the person's turns, and after each stroke of the robot's.

    A recorded stroke's photograph shows the sheet around the stroke, and replaces that part of the last frame.

    Raises:
        ConfigError: the folder holds no photographs.
    """
    turns = turns_in(folder)
    if not turns:
        raise ConfigError(
            f"{folder} holds no photographs of a painting's turns, so there is nothing to replay: it was not begun, or "
            "its robot has no camera."
        )
    recorded = any((folder / RECORD).glob("*.parquet"))
    strokes = read_table(folder / RECORD, CONTRACT).table.to_pylist() if recorded else []
    frames: list[Frame] = []
    for number, turn in enumerate(turns):
        frames.append(Frame(read_image(folder / TURNS / f"{turn.number:03d}.png"), _caption(turn)))
        end = turns[number + 1].executed_before if number + 1 < len(turns) else None
        for row in strokes:
            if row["order"] >= turn.executed_before and (end is None or row["order"] < end):
                said = f" for “{turn.words}”" if turn.words else ""
                frames.append(
                    Frame(_with_patch(frames[-1].picture, row), f"The robot’s stroke {row['order'] + 1}{said}")
                )
    return frames


def replay_page(folder: Path) -> str:
    """The replay as one HTML file, which loads nothing else. Raises ConfigError as `frames_of`."""
    frames = [{"picture": _data_url(frame.picture), "caption": frame.caption} for frame in frames_of(folder)]
    template = (resources.files("pentimento.control") / "web" / REPLAY).read_text(encoding="utf-8")
    return template.replace("[/* frames */]", json.dumps(frames).replace("<", "\\u003c"))


def _caption(turn: Turn) -> str:
    if turn.number == 0:
        return f"The sheet at the start{_wish(turn)}"
    return f"Turn {turn.number}, yours{_wish(turn)}"


def _wish(turn: Turn) -> str:
    said = f", said {turn.expression.said}" if turn.expression.said else ""
    return f"; asked for: “{turn.words}”{said}" if turn.words else ""


def _with_patch(sheet: Picture, row: dict[str, Any]) -> Picture:
    """The sheet with the part that a stroke's photograph shows."""
    patch, window = decode_png(row["after"]["bytes"]), row["window_m"]
    scale = pixels_per_m(patch.shape, window)
    whole = (0.0, 0.0, sheet.shape[1] / scale, sheet.shape[0] / scale)
    left, top = (round(place + 0.5) for place in canvas_to_pixel([window[0], window[3]], whole, scale))
    there = slice(top, top + patch.shape[0]), slice(left, left + patch.shape[1])
    shown = sheet.copy()
    shown[there] = patch
    return shown


def _data_url(picture: Picture) -> str:
    _, data = cv2.imencode(".jpg", picture[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    return "data:image/jpeg;base64," + base64.b64encode(data.tobytes()).decode()
