"""Recorded strokes for tests: a CSV of paths, and photographs of the whole sheet before and after each stroke."""

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.images import write_png

SHEET_MM = (120, 80)
PIXELS_PER_MM = 5


def sheet() -> NDArray[np.uint8]:
    return np.full((SHEET_MM[1] * PIXELS_PER_MM, SHEET_MM[0] * PIXELS_PER_MM, 3), 240, np.uint8)


def line_mm(number: int, points: int = 6) -> NDArray[np.float64]:
    """x, y (up) in mm of one stroke."""
    start = np.array([25.0 + 9 * (number % 5), 20.0 + 6 * (number % 7)])
    angle = 0.7 * number
    return start + np.linspace(0, 20, points)[:, None] * np.array([np.cos(angle), np.sin(angle)]) * 0.6


def photograph(folder: Path, name: str, line: NDArray[np.float64]) -> None:
    """A blank sheet, and the same with a dark line along the path, y up."""
    folder.mkdir(exist_ok=True)
    write_png(folder / f"{name}_before.png", sheet())
    after = sheet()
    pixels = np.round(line * [1, -1] * PIXELS_PER_MM + [0, SHEET_MM[1] * PIXELS_PER_MM]).astype(np.int32)
    cv2.polylines(after, [pixels], False, (20, 20, 30), thickness=12)
    write_png(folder / f"{name}_after.png", after)


def record(folder: Path, strokes: int, header: str = "stroke,t_s,x_mm,y_mm,press_mm,yaw_deg,color") -> Path:
    """``paths.csv`` and ``photos/`` of some strokes; returns the CSV."""
    rows = [header]
    for number in range(strokes):
        line = line_mm(number)
        photograph(folder / "photos", f"s{number}", line)
        rows += [
            f"s{number},{0.1 * at:.2f},{x:.3f},{y:.3f},{1 + 0.1 * (number % 4)},30,#14141e"
            for at, (x, y) in enumerate(line)
        ]
    return written(folder, rows)


def written(folder: Path, rows: Sequence[str]) -> Path:
    path = folder / "paths.csv"
    path.write_text("\n".join(rows) + "\n")
    return path
