"""What is known about one robot at its place: where the canvas lies, where it may go, how it is reached.

A rig file holds what a person measures with a ruler or reads off the machine; what a calibration measures
finer (robots/calibration.py) is laid over it. Frames: the *robot's frame* is the one in which its controller
takes positions; the *canvas frame* is the project's (origin lower left, x right, y up, z out of the canvas).
"""

from __future__ import annotations

import hashlib
import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.errors import ConfigError, UnitError
from pentimento.contracts.units import parse_quantity

FloatArray = NDArray[np.float64]

_REQUIRED = frozenset({"name", "driver", "canvas", "canvas_to_robot", "reach", "travel"})
_OPTIONAL = frozenset({"palette", "camera", "machine", "limits"})
_LIMITS = {
    **{f"{axis}_{end}": "m" for axis in "xy" for end in ("min", "max")},
    "max_press_depth": "m",
    "max_travel_height": "m",
    "max_speed": "m/s",
    "max_acceleration": "m/s^2",
    "max_yaw": "rad",
    "max_yaw_rate": "rad/s",
    "max_duration": "s",
}
"""Of the safety envelope, in the canvas frame, with their units."""


@dataclass(frozen=True)
class Palette:
    """Where the paints stand, in the canvas frame; none of them within the canvas."""

    wells_m: tuple[tuple[float, float], ...]
    water_m: tuple[float, float]
    cloth_m: tuple[float, float]
    depth_m: float
    """How far below the canvas's height the tip goes in a well, in the water and on the cloth (below 0: above it)."""


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
    """Least and greatest x, y, z that the tip may take, in the robot's frame; the driver refuses all else."""
    travel_height_m: float
    """Above the canvas, between strokes."""
    travel_speed_m_s: float
    palette: Palette | None = None
    camera: int | None = None
    """Number of the camera that looks at the canvas, as OpenCV counts them."""
    park_m: tuple[float, float] | None = None
    """Where the tip goes for a photograph, at travel height, in the canvas frame; needed with a camera."""
    machine: Mapping[str, Any] = field(default_factory=dict)
    """The driver's own settings, as they stand in the file; the driver reads and checks them."""
    limits: Mapping[str, float] = field(default_factory=dict)
    """Fields of a `control.safety.SafetyEnvelope` and what they are at most (or least) here: they only narrow it."""
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


def load_rig(name_or_path: str | Path) -> Rig:
    """Read a rig by the name of a bundled file (`plotter`) or by the path of a TOML file.

    Raises ConfigError for a file that is missing or unreadable, and for an unknown, missing or bad entry.
    """
    folder = resources.files("pentimento.robots") / "rigs"
    bundled = sorted(entry.name.removesuffix(".toml") for entry in folder.iterdir() if entry.name.endswith(".toml"))
    path = Path(name_or_path)
    if path.suffix == ".toml":
        if not path.is_file():
            raise ConfigError(f"The rig file {path} does not exist; give a .toml file or one of {bundled}.")
        data = path.read_bytes()
    elif str(name_or_path) in bundled:
        data = (folder / f"{name_or_path}.toml").read_bytes()
    else:
        raise ConfigError(
            f"There is no rig named {str(name_or_path)!r}; choose one of {bundled} or give the path of a .toml file."
        )
    try:
        table = tomllib.loads(data.decode("utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigError(f"The rig file {name_or_path} is not valid TOML: {error}.") from error
    rig = _parse(table, f"rig {name_or_path}")
    return replace(rig, digest=hashlib.sha256(data).hexdigest())


def lengths(value: Any, count: int, where: str, unit: str = "m") -> tuple[float, ...]:
    """`count` quantities with their units, in SI; `where` names the entry in the ConfigError."""
    if not isinstance(value, list) or len(value) != count:
        raise ConfigError(f'{where} is {value!r}; give a list of {count} quantities such as "20 mm".')
    return tuple(quantity(item, unit, where) for item in value)


def quantity(value: Any, unit: str, where: str) -> float:
    """One quantity with its unit, in SI; `where` names the entry in the ConfigError."""
    try:
        return parse_quantity(value, unit)
    except UnitError as error:
        raise ConfigError(f"{where}: {error}") from error


def check_keys(table: Any, required: frozenset[str], optional: frozenset[str], where: str) -> None:
    """Raise ConfigError unless `table` is a table that has all the required keys and no unknown ones."""
    if not isinstance(table, dict):
        raise ConfigError(f"{where} is {table!r}; write it as a table.")
    missing, unknown = sorted(required - table.keys()), sorted(table.keys() - required - optional)
    if missing or unknown:
        raise ConfigError(
            f"{where}: missing keys {missing}, unknown keys {unknown}; it has {sorted(required)} "
            f"and may have {sorted(optional)}."
        )


def _parse(table: Mapping[str, Any], where: str) -> Rig:
    check_keys(table, _REQUIRED, _OPTIONAL, f"The {where}")
    place, reach, travel = table["canvas_to_robot"], table["reach"], table["travel"]
    check_keys(place, frozenset({"origin", "turn"}), frozenset(), f"[canvas_to_robot] of {where}")
    check_keys(reach, frozenset({"low", "high"}), frozenset(), f"[reach] of {where}")
    check_keys(travel, frozenset({"height", "speed"}), frozenset({"park"}), f"[travel] of {where}")
    machine, camera = table.get("machine", {}), table.get("camera")
    for key in ("name", "driver"):
        if not isinstance(table[key], str) or not table[key]:
            raise ConfigError(f"The {where}: {key} is {table[key]!r}; it must be a non-empty string.")
    if not isinstance(machine, dict):
        raise ConfigError(f"The {where}: machine is {machine!r}; write the driver's settings as a table [machine].")
    if camera is not None and (isinstance(camera, bool) or not isinstance(camera, int) or camera < 0):
        raise ConfigError(f"The {where}: camera is {camera!r}; it is a number from 0 on.")
    width, height = lengths(table["canvas"], 2, f"canvas of {where}")
    low, high = (lengths(reach[key], 3, f"reach.{key} of {where}") for key in ("low", "high"))
    rig = Rig(
        name=table["name"],
        driver=table["driver"],
        canvas_size_m=(width, height),
        origin_m=_three(lengths(place["origin"], 3, f"canvas_to_robot.origin of {where}")),
        turn_rad=_three(lengths(place["turn"], 3, f"canvas_to_robot.turn of {where}", "rad")),
        reach_m=(_three(low), _three(high)),
        travel_height_m=quantity(travel["height"], "m", f"travel.height of {where}"),
        travel_speed_m_s=quantity(travel["speed"], "m/s", f"travel.speed of {where}"),
        palette=_palette(table["palette"], f"[palette] of {where}") if "palette" in table else None,
        camera=camera,
        park_m=_two(lengths(travel["park"], 2, f"travel.park of {where}")) if "park" in travel else None,
        machine=machine,
        limits=_limits(table.get("limits", {}), f"[limits] of {where}"),
    )
    _check(rig, where)
    return rig


def _limits(table: Any, where: str) -> dict[str, float]:
    check_keys(table, frozenset(), frozenset(_LIMITS), where)
    suffix = {"m": "m", "m/s": "m_s", "m/s^2": "m_s2", "rad": "rad", "rad/s": "rad_s", "s": "s"}
    return {
        f"{key}_{suffix[_LIMITS[key]]}": quantity(value, _LIMITS[key], f"{key} in {where}")
        for key, value in table.items()
    }


def _palette(table: Any, where: str) -> Palette:
    check_keys(table, frozenset({"wells", "water", "cloth", "depth"}), frozenset(), where)
    if not isinstance(table["wells"], list) or not table["wells"]:
        raise ConfigError(f"{where}: wells is {table['wells']!r}; list the place of each paint.")
    wells = [lengths(well, 2, f"wells in {where}") for well in table["wells"]]
    water, cloth = (lengths(table[key], 2, f"{key} in {where}") for key in ("water", "cloth"))
    return Palette(
        wells_m=tuple(_two(well) for well in wells),
        water_m=_two(water),
        cloth_m=_two(cloth),
        depth_m=quantity(table["depth"], "m", f"depth in {where}"),
    )


def _check(rig: Rig, where: str) -> None:
    positive = {
        "canvas": min(rig.canvas_size_m),
        "travel.height": rig.travel_height_m,
        "travel.speed": rig.travel_speed_m_s,
    }
    for key, value in positive.items():
        if not value > 0:
            raise ConfigError(f"The {where}: {key} must be above zero.")
    if rig.camera is not None and rig.park_m is None:
        raise ConfigError(
            f"The {where}: with a camera, [travel] needs park, a place beside the canvas from where the arm does not "
            "cover it."
        )
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
            f"to {high.tolist()} m; correct the canvas's "
            "place or the reach."
        )
    width, height = rig.canvas_size_m
    if rig.palette is not None:
        for x, y in (*rig.palette.wells_m, rig.palette.water_m, rig.palette.cloth_m):
            if 0 <= x <= width and 0 <= y <= height:
                raise ConfigError(
                    f"The {where}: the palette's place ({x:g}, {y:g}) m lies on the canvas; move it beside."
                )


def canvas_corners(rig: Rig, height_m: float) -> FloatArray:
    """[4, 3]: the canvas's corners, `height_m` above it, in the robot's frame."""
    width, height = rig.canvas_size_m
    corners = np.array([[x, y, height_m, 1.0] for x in (0.0, width) for y in (0.0, height)])
    placed: FloatArray = (corners @ rig.canvas_to_robot.T)[:, :3]
    return placed


def _two(values: tuple[float, ...]) -> tuple[float, float]:
    x, y = values
    return x, y


def _three(values: tuple[float, ...]) -> tuple[float, float, float]:
    x, y, z = values
    return x, y, z
