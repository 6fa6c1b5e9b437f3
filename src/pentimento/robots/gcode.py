"""G-code for pen plotters: a timed motion of the tip as lines in millimetres and millimetres a minute.

Only codes that every GRBL-like controller reads: G21, G90, G94, G1, G4, M0, M3. Each line is a straight segment
with its own feed, so that the machine keeps the path's times as far as its accelerations allow.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.atomic import atomic_write
from pentimento.contracts.codec import check_keys
from pentimento.contracts.errors import ConfigError
from pentimento.robots.machine import positions_only
from pentimento.robots.rig import Rig

FloatArray = NDArray[np.float64]

PREAMBLE = ("G21", "G90", "G94")
"""Millimetres, absolute places, feeds in millimetres a minute."""
_SERVO_S = 0.25
"""Time for a servo to raise or lower the pen."""
_NO_BRACKETS = str.maketrans("()", "[]")  # a comment ends at its first bracket
_UPRIGHT = 1e-3  # max slope of the canvas's normal against the machine's z


@dataclass(frozen=True)
class Pen:
    """How the plotter raises its pen: by its z axis, or by a servo on the spindle's output."""

    kind: Literal["z", "servo"]
    up: int = 0
    down: int = 0
    paper_z_m: float = 0.0
    """Height of the sheet in the machine's frame; a servo pen is down where the tip is commanded at or below it."""


def pen_of(machine: Mapping[str, Any], rig: Rig) -> Pen:
    """The pen from a rig's [machine] table. Raises ConfigError for a bad one, and for a canvas that is not level."""
    where = f"[machine] of rig {rig.name}"
    if max(abs(turn) for turn in rig.turn_rad[:2]) > _UPRIGHT:
        raise ConfigError(f"The rig {rig.name}: a plotter's canvas is level; set roll and pitch of its turn to 0 deg.")
    kind, servo = machine.get("pen"), {key: machine.get(key) for key in ("servo_up", "servo_down")}
    if kind == "z" and not any(value is not None for value in servo.values()):
        return Pen("z", paper_z_m=rig.origin_m[2])
    if kind == "servo" and all(isinstance(value, int) and 0 <= value <= 1000 for value in servo.values()):
        up, down = servo["servo_up"] or 0, servo["servo_down"] or 0
        if up >= down:
            raise ConfigError(
                f"{where}: servo_up is {up} and servo_down {down}. At every reset the controller takes the servo to 0, "
                "and that must be above the paper: servo_up is the smaller number; fit the servo's horn the other way "
                "round."
            )
        return Pen("servo", up, down, rig.origin_m[2])
    raise ConfigError(
        f'{where}: pen is {kind!r} with {servo}; it is "z", or "servo" with servo_up and servo_down from 0 to 1000.'
    )


def gcode_of(times_s: FloatArray, places_m: FloatArray, pen: Pen) -> Iterator[str]:
    """Lines for the motion from places_m[0] through places_m[N, 3] (robot's frame) at times_s[N].

    The tip is already at the first place; it makes no line. A servo pen is raised and lowered where the motion crosses
    the sheet's height.
    """
    if pen.kind == "z":
        for (t0, p0), (t1, p1) in pairwise(zip(times_s, places_m, strict=True)):
            yield _line(p1, np.linalg.norm(p1 - p0), t1 - t0, with_z=True)
        return
    down = bool(places_m[0, 2] <= pen.paper_z_m)
    for (t0, p0), (t1, p1) in pairwise(zip(times_s, places_m, strict=True)):
        lands = bool(p1[2] <= pen.paper_z_m)
        length_m = np.linalg.norm((p1 - p0)[:2])
        if lands == down:
            if length_m > 0:
                yield _line(p1, length_m, t1 - t0, with_z=False)
            continue
        share = (p0[2] - pen.paper_z_m) / (p0[2] - p1[2])
        if length_m > 0 and share > 0:
            yield _line(p0 + share * (p1 - p0), share * length_m, share * (t1 - t0), with_z=False)
        yield from servo_lines(pen, lands)
        down = lands
        if length_m > 0 and share < 1:
            yield _line(p1, (1 - share) * length_m, (1 - share) * (t1 - t0), with_z=False)


def servo_lines(pen: Pen, down: bool) -> tuple[str, str]:
    """Lower or raise a servo's pen and wait for it."""
    return f"M3 S{pen.down if down else pen.up}", f"G4 P{_SERVO_S:g}"


def _line(place_m: FloatArray, length_m: Any, duration_s: Any, with_z: bool) -> str:
    """One straight segment. Places to a micrometre, feeds to a tenth of a millimetre a minute."""
    x, y, z = (f"{1000 * float(value):.3f}" for value in place_m)
    feed = max(60_000 * float(length_m) / float(duration_s), 0.1)
    return f"G1 X{x} Y{y}" + (f" Z{z}" if with_z else "") + f" F{feed:.1f}"


class GcodeFile:
    """A Machine (see machine.py) that writes the commands for a plotter into a file; nothing moves."""

    def __init__(self, path: Path, pen: Pen, start_m: FloatArray, header: Sequence[str] = ()) -> None:
        """`start_m` [3]: the tip's assumed place at the start, robot's frame, with the pen up. `header`: comments."""
        self._path, self._pen, self._here = path, pen, np.array(start_m, dtype=np.float64)
        x, y, z = (f"{1000 * value:.3f}" for value in self._here)
        rise = [f"G1 Z{z} F600"] if pen.kind == "z" else list(servo_lines(pen, down=False))
        self._lines = [*map(_comment, header), *PREAMBLE, *rise, f"G1 X{x} Y{y} F3000"]

    def where(self) -> FloatArray:
        return positions_only(self._here)

    def follow(self, times_s: FloatArray, poses: FloatArray) -> FloatArray:
        places_m = poses[:, :3, 3]
        self._lines += gcode_of(times_s, places_m, self._pen)
        self._here = places_m[-1].copy()
        return np.full(poses.shape, np.nan)

    def halt(self) -> None:
        """Nothing to do: nothing moves."""

    def close(self) -> None:
        """Write the file, whole or not at all."""
        atomic_write(self._path, self.text().encode("ascii"))

    def text(self) -> str:
        """The commands so far, and the pen up. M5 would take a servo to 0."""
        return "\n".join((*self._lines, *(servo_lines(self._pen, down=False) if self._pen.kind == "servo" else ()), ""))

    def note(self, what: str) -> None:
        """A comment before the commands that follow."""
        self._lines.append(_comment(what))

    def pause(self, why: str) -> None:
        """Wait for the person, where the tool is, until the controller is told to go on."""
        self.note(why)
        self._lines.append("M0")


def connect(rig: Rig) -> GcodeFile:
    """The entry point `gcode`: a file instead of a machine. The rig's [machine] has `file` and the pen."""
    optional = frozenset({"servo_up", "servo_down"})
    check_keys(rig.machine, frozenset({"file", "pen"}), optional, f"[machine] of rig {rig.name}")
    above = rig.canvas_to_robot @ np.array([0.0, 0.0, rig.travel_height_m, 1.0])
    pen = pen_of(rig.machine, rig)
    return GcodeFile(Path(rig.machine["file"]), pen, above[:3], _header(rig, pen))


def _header(rig: Rig, pen: Pen) -> list[str]:
    """What a person checks before sending the file. Axes are in lower case: no reader may take them for commands."""
    lengths_m = (*rig.canvas_size_m, *rig.origin_m, rig.origin_m[2] + rig.travel_height_m)
    width, height, x, y, z, up = (f"{1000 * length_m:.3f}" for length_m in lengths_m)
    heights = f"z {z} mm touches the paper, z {up} mm between strokes"
    if pen.kind == "servo":
        heights = f"no z: a servo lowers the pen by M3 S{pen.down} and raises it by M3 S{pen.up}"
    return [
        f"rig: {rig.name}",
        "units: mm, mm/min; absolute places in machine coordinates",
        f"sheet: {width} x {height} mm, lower left corner at x {x} mm, y {y} mm",
        f"sheet is turned by {math.degrees(rig.turn_rad[2]):.3f} deg about that corner",
        heights,
    ]


def _comment(what: str) -> str:
    """One line of ASCII, which all controllers pass over."""
    return "(" + " ".join(what.translate(_NO_BRACKETS).split()).encode("ascii", "replace").decode() + ")"
