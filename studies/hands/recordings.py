"""Measured trajectories of people as recordings: motion capture of a marker, a web tablet, Quick, Draw!."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np

from pentimento.handwriting.recording import Recording, recording

TABLET_M = 0.2
"""A canvas unit of the web tablet is taken to be so long; its size was not recorded."""
QUICKDRAW_M = 2.5e-4
"""A pixel of Quick, Draw! is taken to be so long."""


def motion_capture(folder: Path) -> list[Recording]:
    """Strokes of a marker on a sheet of 0.23 × 0.18 m, 200 Hz; heights were not kept."""
    with np.load(folder / "frida_mocap_marker_trajectories.npz", allow_pickle=False) as data:
        points, offsets, session, names = (data[name] for name in ("points", "offsets", "session", "session_name"))
        rate_hz = float(data["rate_hz"])
    found = []
    for number, (begin, end) in enumerate(pairwise(offsets)):
        name = str(names[session[number]])
        xy = points[begin:end].astype(np.float64)
        found.append(recording(name, name, xy, t_s=np.arange(len(xy)) / rate_hz))
    return found


def tablet(folder: Path) -> list[Recording]:
    """Strokes of a web tablet, y down; times were not kept."""
    with np.load(folder / "jspaint_tablet_trajectories.npz", allow_pickle=False) as data:
        points, offsets, session, names = (data[name] for name in ("points", "offsets", "session", "session_name"))
    found = []
    for number, (begin, end) in enumerate(pairwise(offsets)):
        name, part = str(names[session[number]]), points[begin:end].astype(np.float64)
        found.append(
            recording(name, name, part[:, :2] * [TABLET_M, -TABLET_M], t_s=None, z_m=None, pressure=part[:, 2])
        )
    return found


def quickdraw(folder: Path, drawings: int) -> list[Recording]:
    """Strokes of evenly chosen drawings; each drawing is a session of a hand of its own."""
    with np.load(folder / "quickdraw_word_sketches.npz", allow_pickle=False) as data:
        points, strokes, of_drawing = (data[name] for name in ("points", "stroke_offsets", "drawing_offsets"))
    found = []
    for drawing in np.linspace(0, len(of_drawing) - 2, drawings).astype(int):
        for number in range(of_drawing[drawing], of_drawing[drawing + 1]):
            part = points[strokes[number] : strokes[number + 1]].astype(np.float64)
            name = f"drawing_{drawing}"
            found.append(recording(name, name, part[:, :2] * [QUICKDRAW_M, -QUICKDRAW_M], t_s=part[:, 2] / 1e3))
    return found
