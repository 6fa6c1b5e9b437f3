"""A rig: one robot at its place, with the canvas's pose, the reach, and the settings of its driver.

A rig file holds what a person measures with a ruler or reads off the machine. A calibration (robots/calibration.py)
refines it. Frames: the *robot's frame* is the one in which its controller
takes positions; the *canvas frame* is the project's (origin lower left, x right, y up, z out of the canvas).
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.codec import check_keys, find_toml, from_table, quantities, read_toml
from pentimento.contracts.errors import ConfigError

FloatArray = NDArray[np.float64]

_RIGS: Final = Path(__file__).with_name("rigs")
_LIMITS: Final = {
    **{f"{axis}_{end}": "m" for axis in "xy" for end in ("min", "max")},
    "max_press_depth": "m",
    "max_travel_height": "m",
    "max_speed": "m/s",
    "max_acceleration": "m/s^2",
    "max_yaw": "rad",
    "max_yaw_rate": "rad/s",
    "max_duration": "s",
}
"""Fields of the safety envelope that a rig may narrow, in the canvas frame, with their units."""
_SUFFIX: Final = {"m": "m", "m/s": "m_s", "m/s^2": "m_s2", "rad": "rad", "rad/s": "rad_s", "s": "s"}


@dataclass(frozen=True)
class Palette:
    """Where the paints stand, in the canvas frame; none of them within the canvas."""

    wells_m: tuple[tuple[float, float], ...]
    water_m: tuple[float, float]
    cloth_m: tuple[float, float]
    depth_m: float
    """Depth of the tip below the canvas's height in a well, in the water and on the cloth; negative above it."""


@dataclass(frozen=True)
class Rig:
    """One robot at its place, in SI units."""

    name: str
    driver: str
    """Name of an entry point in the group `pentimento.robots`."""
    canvas_size_m: tuple[float, float]
    origin_m: tuple[float, float, float]
    """The canvas's lower left corner in the robot's frame."""
    turn_rad: tuple[float, float, float]
    """Roll, pitch and yaw of the canvas frame in the robot's: R = Rz(yaw) Ry(pitch) Rx(roll)."""
    reach_m: tuple[tuple[float, float, float], tuple[float, float, float]]
    """Min and max x, y, z that the tip may take, in the robot's frame; the driver refuses all else."""
    travel_height_m: float
    """Above the canvas, between strokes."""
    travel_speed_m_s: float
    palette: Palette | None = None
    camera: int | None = None
    """Number of the camera that looks at the canvas, as OpenCV counts them."""
    park_m: tuple[float, float] | None = None
    """Where the tip goes for a photograph or a scan, at travel height, in the canvas frame; needed for them."""
    scanner: Mapping[str, Any] = field(default_factory=dict)
    """Settings of the scanner that looks at a slab in the canvas's place, with the name of its ``driver``, an entry
    point in the group `pentimento.scanners`, which reads and checks the rest; {} without one."""
    machine: Mapping[str, Any] = field(default_factory=dict)
    """The driver's own settings, as they stand in the file; the driver reads and checks them."""
    limits: Mapping[str, float] = field(default_factory=dict)
    """Bounds of a `control.safety.SafetyEnvelope` at this rig, by field; they only narrow it."""
    surface: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """a, b, c: the real surface lies at z = a + b x + c y of the canvas frame, as a touch calibration found it."""
    digest: str = ""
    """Of the rig file; a calibration belongs to the rig whose digest it bears."""

    @property
    def canvas_to_robot(self) -> FloatArray:
        """[4, 4]: canvas frame -> robot's frame."""
        pose = np.eye(4)
        pose[:3, :3] = rotation_of(*self.turn_rad)
        pose[:3, 3] = self.origin_m
        return pose

    def with_surface(self, surface: tuple[float, float, float]) -> Rig:
        """The rig with the surface that a touch calibration found."""
        return replace(self, surface=surface)


def rotation_of(roll_rad: float, pitch_rad: float, yaw_rad: float) -> FloatArray:
    """[3, 3] Rz(yaw) Ry(pitch) Rx(roll): turns about the fixed axes x, then y, then z."""
    (cr, sr), (cp, sp), (cy, sy) = ((math.cos(a), math.sin(a)) for a in (roll_rad, pitch_rad, yaw_rad))
    about_x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    about_z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1.0]])
    rotation: FloatArray = about_z @ about_y @ about_x
    return rotation


@dataclass(frozen=True)
class _Place:
    """The canvas in the robot's frame: see ``Rig.origin_m`` and ``Rig.turn_rad``."""

    origin_m: tuple[float, float, float]
    turn_rad: tuple[float, float, float]


@dataclass(frozen=True)
class _Reach:
    """See ``Rig.reach_m``."""

    low_m: tuple[float, float, float]
    high_m: tuple[float, float, float]


@dataclass(frozen=True)
class _Travel:
    """Between strokes."""

    height_m: float
    speed_m_s: float
    park_m: tuple[float, float] | None = None


@dataclass(frozen=True)
class _RigFile:
    """A rig file's tables."""

    name: str
    driver: str
    canvas_m: tuple[float, float]
    canvas_to_robot: _Place
    reach: _Reach
    travel: _Travel
    palette: Palette | None = None
    camera: int | None = None
    scanner: dict[str, Any] = field(default_factory=dict)
    machine: dict[str, Any] = field(default_factory=dict)
    limits: dict[str, Any] = field(default_factory=dict)


def load_rig(name_or_path: str | Path) -> Rig:
    """Read a rig by the name of a shipped file (`plotter`) or by the path of a TOML file.

    Raises:
        ConfigError: a file that is missing or unreadable, or an unknown, missing or bad entry.
    """
    path, where = find_toml(name_or_path, _RIGS, "rig"), f"rig {name_or_path}"
    stored = from_table(_RigFile, read_toml(path, "rig"), f"The {where}")
    check_keys(stored.limits, frozenset(), frozenset(_LIMITS), f"[limits] of {where}")
    rig = Rig(
        name=stored.name,
        driver=stored.driver,
        canvas_size_m=stored.canvas_m,
        origin_m=stored.canvas_to_robot.origin_m,
        turn_rad=stored.canvas_to_robot.turn_rad,
        reach_m=(stored.reach.low_m, stored.reach.high_m),
        travel_height_m=stored.travel.height_m,
        travel_speed_m_s=stored.travel.speed_m_s,
        palette=stored.palette,
        camera=stored.camera,
        park_m=stored.travel.park_m,
        scanner=stored.scanner,
        machine=stored.machine,
        limits={
            f"{key}_{_SUFFIX[_LIMITS[key]]}": quantities(value, _LIMITS[key], f"{key} in [limits] of {where}")
            for key, value in stored.limits.items()
        },
        digest=hashlib.sha256(path.read_bytes()).hexdigest(),
    )
    _check(rig, where)
    return rig


def lengths(value: Any, count: int, where: str, unit: str = "m") -> tuple[float, ...]:
    """`count` quantities with their units, in SI; `where` names the entry in the ConfigError."""
    if not isinstance(value, list) or len(value) != count:
        raise ConfigError(f'{where} is {value!r}; give a list of {count} quantities such as "20 mm".')
    return tuple(quantities(value, unit, where))


def _check(rig: Rig, where: str) -> None:
    for key, text in (("name", rig.name), ("driver", rig.driver)):
        if not text:
            raise ConfigError(f"The {where}: {key} must be a non-empty text.")
    if rig.camera is not None and rig.camera < 0:
        raise ConfigError(f"The {where}: camera is {rig.camera}; it is a number from 0 on.")
    positive = {
        "canvas": min(rig.canvas_size_m),
        "travel.height": rig.travel_height_m,
        "travel.speed": rig.travel_speed_m_s,
    }
    for key, value in positive.items():
        if not value > 0:
            raise ConfigError(f"The {where}: {key} must be above zero.")
    if (rig.camera is not None or rig.scanner) and rig.park_m is None:
        raise ConfigError(
            f"The {where}: with a camera or a scanner, [travel] needs park, a place outside the canvas from where the "
            "arm does not cover it."
        )
    if rig.scanner and not isinstance(rig.scanner.get("driver"), str):
        raise ConfigError(f'[scanner] of {where} needs driver = "NAME", such as "folder".')
    _check_reach(rig, where)
    if rig.palette is not None:
        _check_palette(rig.palette, rig.canvas_size_m, where)


def _check_reach(rig: Rig, where: str) -> None:
    low, high = np.array(rig.reach_m)
    if not np.all(low < high):
        raise ConfigError(f"The {where}: reach.low must lie below reach.high in x, y and z.")
    corners = canvas_corners(rig, rig.travel_height_m)
    if rig.park_m is not None:
        park = rig.canvas_to_robot @ np.array([*rig.park_m, rig.travel_height_m, 1.0])
        corners = np.vstack((corners, park[:3]))
    outside = np.any((corners < low) | (corners > high), axis=1)
    if outside.any():
        raise ConfigError(
            f"The {where}: a corner of the canvas, or the parking place, at travel height lies at "
            f"{np.round(corners[outside][0], 4).tolist()} m in the robot's frame, out of its reach from {low.tolist()} "
            f"to {high.tolist()} m; correct the canvas's place or the reach."
        )


def _check_palette(palette: Palette, canvas_size_m: tuple[float, float], where: str) -> None:
    width, height = canvas_size_m
    if not palette.wells_m:
        raise ConfigError(f"[palette] of {where}: wells is empty; list the place of each paint.")
    for x, y in (*palette.wells_m, palette.water_m, palette.cloth_m):
        if 0 <= x <= width and 0 <= y <= height:
            raise ConfigError(f"The {where}: the palette's place ({x:g}, {y:g}) m lies on the canvas; move it outside.")


def canvas_corners(rig: Rig, height_m: float) -> FloatArray:
    """[4, 3]: the canvas's corners, `height_m` above it, in the robot's frame."""
    width, height = rig.canvas_size_m
    corners = np.array([[x, y, height_m, 1.0] for x in (0.0, width) for y in (0.0, height)])
    placed: FloatArray = (corners @ rig.canvas_to_robot.T)[:, :3]
    return placed
